//! Contradictions between a node and its device file that were emitted.

use std::collections::BTreeSet;

use crate::wire::canopen::ObjectAddress;

/// Contradictions already emitted; each is emitted only once.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct EmittedConflicts {
    /// Objects, and hashes of the contradicting values.
    pub(in crate::session) reported: BTreeSet<(ObjectAddress, u64)>,
    /// Objects that were written: their value may differ from the device file.
    pub(in crate::session) written: BTreeSet<ObjectAddress>,
    pub(in crate::session) is_full: bool,
}

impl EmittedConflicts {
    /// Bytes held by the sets.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.reported.len() * size_of::<(ObjectAddress, u64)>()
            + self.written.len() * size_of::<ObjectAddress>()
    }
}
