//! Behaviour of a node that can suggest its profile.

use crate::profile::PdoName;

/// Maximum number of PDOs per node whose length is stored.
const PDOS: usize = 16;

/// Maximum number of EMCY codes stored per node.
const CODES: usize = 16;

/// Behaviour of a node that can suggest its profile, or contradict it.
#[derive(Debug, Clone, Default)]
pub(crate) struct ProfileSigns {
    /// Whether the node sent an EMCY without data.
    pub(crate) is_ready_sent: bool,
    /// Whether the node sent a boot-up message.
    pub(crate) is_boot_up_sent: bool,
    /// Lengths of PDOs; `None` for varying length.
    pub(crate) pdos: Vec<(PdoName, Option<u8>)>,
    /// Codes of errors that the node reported.
    pub(crate) codes: Vec<u16>,
}

impl ProfileSigns {
    /// Records the length of a PDO.
    pub(crate) fn note_pdo(&mut self, name: PdoName, length: u8) {
        let has_room = self.pdos.len() < PDOS;
        match self.pdos.iter_mut().find(|(known, _)| *known == name) {
            Some((_, known)) => *known = known.filter(|known| *known == length),
            None if has_room => self.pdos.push((name, Some(length))),
            None => {}
        }
    }

    /// Records the code of a reported error.
    pub(crate) fn note_emcy(&mut self, code: u16) {
        if code != 0 && self.codes.len() < CODES && !self.codes.contains(&code) {
            self.codes.push(code);
        }
    }

    /// Length of a PDO, `Some(None)` if it varies; `None` if not yet received.
    #[expect(clippy::option_option, reason = "not received, varying and fixed are three cases")]
    pub(crate) fn pdo_length(&self, name: &str) -> Option<Option<u8>> {
        let mut pdos = self.pdos.iter();
        pdos.find(|(known, _)| known.to_string() == name).map(|(_, length)| *length)
    }

    /// Whether anything was recorded that a hint can match.
    pub(crate) fn is_any(&self) -> bool {
        self.is_ready_sent || !self.pdos.is_empty() || !self.codes.is_empty()
    }
}
