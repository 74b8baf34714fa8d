//! Traffic on identifiers of no known service that suggests entries of a bus file.

use super::sdo_dialogues::{SdoDialogues, SdoPairHint};
use super::unnamed_uds::{UdsPairHint, UdsSuspects};

/// Dialogues of one bus that the user may state in a bus file.
#[derive(Debug, Clone, Default)]
pub struct BusHints {
    /// UDS traffic between identifiers missing from the bus file.
    pub(in crate::session) unnamed: UdsSuspects,
    /// SDO-like dialogues on identifiers of no channel.
    pub(in crate::session) dialogues: SdoDialogues,
}

impl BusHints {
    /// Pairs of identifiers that look like UDS and are missing from the bus file.
    pub fn unnamed_uds(&self) -> Vec<UdsPairHint> {
        self.unnamed.pair_hints()
    }

    /// Pairs of identifiers without a channel that exchange messages like SDO client and server.
    pub fn sdo_dialogues(&self) -> Vec<SdoPairHint> {
        self.dialogues.pair_hints()
    }
}
