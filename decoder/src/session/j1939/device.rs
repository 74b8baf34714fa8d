//! What is remembered of a node as a J1939 device.

use super::dtc::Faults;
use crate::wire::j1939::{Name, SpnConversion};

/// State that belongs to the device, whatever its address.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct J1939State {
    /// Its NAME, once it claimed an address.
    pub(super) name: Option<Name>,
    /// Another one that wants its address, and since when (monotonic); until it answers.
    pub(super) challenged: Option<(Name, i64)>,
    /// How it codes old SPNs, as the bus file says.
    pub(in crate::session) conversion: Option<SpnConversion>,
    /// Its trouble codes.
    pub(in crate::session) faults: Faults,
}

impl J1939State {
    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        size_of::<Self>() + self.faults.footprint()
    }
}
