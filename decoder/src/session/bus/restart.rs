//! How nodes start anew, and what explains that they do.

use crate::profile::Effect;
use crate::wire::NodeId;

/// How thoroughly a node starts anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) enum Restart {
    /// NMT reset communication.
    Communication,
    /// NMT reset node.
    Node,
    /// Not commanded: a power-on, or a restart of the node's own.
    PowerOn,
}

impl Restart {
    /// Whether a value that waits for this takes effect.
    pub(in crate::session) const fn brings(self, effect: Effect) -> bool {
        match effect {
            Effect::ResetCommunication => true,
            Effect::ResetNode => matches!(self, Self::Node | Self::PowerOn),
            Effect::PowerOn => matches!(self, Self::PowerOn),
            _ => false,
        }
    }
}

/// What may explain a restart of a node besides a command to it.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct RestartEvidence {
    /// Frame of the last reset of all nodes: it also means those that did not send yet.
    pub(in crate::session) reset_of_all: Option<(u64, Restart)>,
    /// Last boot sign without a command: monotonic time and node.
    pub(in crate::session) last_boot: Option<(i64, NodeId)>,
    /// Monotonic time at which the last silence of the bus ended.
    pub(in crate::session) silent_until: Option<i64>,
}
