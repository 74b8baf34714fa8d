//! Restarts of nodes and their possible causes.

use crate::profile::WriteEffect;
use crate::wire::NodeId;

/// Type of restart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) enum RestartType {
    /// NMT reset communication.
    Communication,
    /// NMT reset node.
    Node,
    /// Not commanded: power cycle or self-reset.
    PowerOn,
}

impl RestartType {
    /// Whether this restart applies a value that waits for `effect`.
    pub(in crate::session) const fn applies_value(self, effect: WriteEffect) -> bool {
        match effect {
            WriteEffect::ResetCommunication => true,
            WriteEffect::ResetNode => matches!(self, Self::Node | Self::PowerOn),
            WriteEffect::PowerOn => matches!(self, Self::PowerOn),
            _ => false,
        }
    }
}

/// Evidence for the cause of a restart, other than a command to the node itself.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct RestartEvidence {
    /// Frame of the last reset of all nodes; it also applies to nodes that have not sent a frame yet.
    pub(in crate::session) reset_of_all: Option<(u64, RestartType)>,
    /// Last boot sign without a command: monotonic time and node.
    pub(in crate::session) last_boot: Option<(i64, NodeId)>,
    /// Monotonic time at which the last silence of the bus ended.
    pub(in crate::session) silent_until: Option<i64>,
}
