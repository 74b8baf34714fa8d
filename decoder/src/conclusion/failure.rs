//! A conclusion about a bus.

use crate::finding::FindingSubject;
use crate::wire::NodeId;

/// A failure of a part of the machine.
#[derive(Debug, Clone)]
pub(crate) struct Conclusion {
    /// Name of its row.
    pub(crate) hypothesis: &'static str,
    /// The node; `None` for a group of nodes, the controller and the bus.
    pub(crate) node: Option<NodeId>,
    /// All nodes that fail.
    pub(crate) nodes: Vec<NodeId>,
    /// The message that fails, if it is only one.
    pub(crate) about: FindingSubject,
    /// What the capture shows.
    pub(crate) text: String,
    /// Monotonic time of the last sign of normal work, and its frame.
    pub(crate) began: (i64, u64),
    /// It may be intended: only a note.
    pub(crate) is_note: bool,
    /// End, and its frame; `None` if it lasts to the end of the capture.
    pub(crate) ended: Option<(i64, u64)>,
}

/// Time around a failure in which its consequences begin, in ns.
const AROUND: i64 = 1_000_000_000;

impl Conclusion {
    /// Times between which its consequences begin.
    pub(super) fn range(&self) -> (i64, i64) {
        let end = self.ended.map_or(i64::MAX, |ended| ended.0);
        (self.began.0.saturating_sub(AROUND), end.saturating_add(AROUND))
    }
}
