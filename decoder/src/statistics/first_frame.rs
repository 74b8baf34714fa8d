//! Meaning of the first frame of a node.

use crate::event::{BootCause, Event, EventKind, SdoOutcome};
use crate::profile::PdoDirection;

/// First frame of a CANopen node in the capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FirstFrame {
    /// A boot sign, without an NMT reset before.
    PowerOn,
    /// A boot sign after an NMT reset.
    Reset,
    /// Another message: the node was running.
    Running,
}

impl FirstFrame {
    /// Meaning of a message of the node; `None` for messages to the node.
    pub(super) fn meaning_of(event: &Event) -> Option<Self> {
        let start = |cause: &BootCause| match cause {
            BootCause::Commanded { .. } => Self::Reset,
            BootCause::PresumedPowerOn { .. } => Self::PowerOn,
        };
        match &event.kind {
            EventKind::BootUp { cause, .. } => Some(start(cause)),
            EventKind::Emcy(emergency) => Some(emergency.boot.as_ref().map_or(Self::Running, start)),
            EventKind::Heartbeat { .. } | EventKind::GuardReply { .. } => Some(Self::Running),
            EventKind::Pdo(pdo) if pdo.name.direction == PdoDirection::Transmit && !pdo.is_request => {
                Some(Self::Running)
            }
            EventKind::SdoTransfer(transfer)
                if transfer.outcome == SdoOutcome::Complete || transfer.awaits_client =>
            {
                Some(Self::Running)
            }
            _ => None,
        }
    }
}
