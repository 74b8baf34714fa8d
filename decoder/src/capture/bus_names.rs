//! Names of the buses of one capture.

use crate::frame::BusIndex;

/// Maximum number of buses in one capture; frames of further buses are unreadable.
pub const MAX_BUSES: usize = 64;

/// Maximum length of a bus name in bytes; longer names are cut.
pub const MAX_BUS_NAME: usize = 32;

/// Names of the buses of one capture, in order of appearance.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BusNames(Vec<String>);

impl BusNames {
    /// Names in order of their index.
    pub fn names(&self) -> &[String] {
        &self.0
    }

    /// Name of a bus; empty if it has none.
    pub fn name_of(&self, bus: BusIndex) -> &str {
        self.0.get(usize::from(bus.0)).map_or("", String::as_str)
    }

    /// Index of `name`, added if new; `None` if [`MAX_BUSES`] names exist. Names longer than [`MAX_BUS_NAME`]
    /// bytes are cut; bytes that are not valid UTF-8 are replaced.
    pub fn index_of(&mut self, name: &[u8]) -> Option<BusIndex> {
        let name = String::from_utf8_lossy(name.get(..MAX_BUS_NAME).unwrap_or(name));
        let index = match self.0.iter().position(|known| *known == name) {
            Some(index) => index,
            None if self.0.len() < MAX_BUSES => {
                self.0.push(name.into_owned());
                self.0.len() - 1
            }
            None => return None,
        };
        u8::try_from(index).ok().map(BusIndex)
    }
}
