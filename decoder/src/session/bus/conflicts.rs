//! Contradictions between a node and its device file that were emitted.

use std::collections::BTreeSet;

use crate::wire::canopen::ObjectAddress;

/// Contradictions that were told, so that each is told once.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Conflicts {
    /// Objects and hashes of their values.
    pub(in crate::session) told: BTreeSet<(ObjectAddress, u64)>,
    /// Objects a file wants a value of that were written: they need not have it any more.
    pub(in crate::session) written: BTreeSet<ObjectAddress>,
    pub(in crate::session) is_full: bool,
}

impl Conflicts {
    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.told.len() * size_of::<(ObjectAddress, u64)>() + self.written.len() * size_of::<ObjectAddress>()
    }
}
