//! What stores and restores parameters: shared by the rules that judge its outcome.

use crate::event::{BootCause, Direction, Event, EventKind, Outcome, SdoTransfer};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;

/// Where communication objects end: reset communication starts these anew, and no others (CiA 301 §7.3.2.2.2).
pub(super) const COMMUNICATION_END: u16 = 0x2000;

/// Objects remembered of a node; a node with more of them is not judged.
pub(super) const OBJECT_LIMIT: usize = 1024;

/// Whether a sub-index of 1010 or 1011 means an object. What those of the maker mean is not known.
pub(super) fn covers(sub: u8, index: u16) -> bool {
    match sub {
        1 => index >= 0x1000,
        2 => (0x1000..COMMUNICATION_END).contains(&index),
        3 => (0x6000..0xA000).contains(&index),
        _ => false,
    }
}

/// A download that was confirmed from its first frame on.
pub(super) fn written(transfer: &SdoTransfer) -> Option<ObjectAddress> {
    let is_whole = transfer.outcome == Outcome::Complete && !transfer.cut_start && !transfer.truncated;
    transfer.object.filter(|_| is_whole && transfer.direction == Some(Direction::Download))
}

/// An upload that was answered, with its data whole.
pub(super) fn read(transfer: &SdoTransfer) -> Option<ObjectAddress> {
    let is_whole = transfer.outcome == Outcome::Complete && !transfer.cut_start && !transfer.truncated;
    transfer.object.filter(|_| is_whole && transfer.direction == Some(Direction::Upload))
}

/// The last reset of each node was one of the communication only.
#[derive(Default)]
pub(super) struct Resets {
    communication_only: crate::rules::NodeSet,
}

impl Resets {
    /// Takes in a command.
    pub(super) fn command(&mut self, service: NmtService, target: u8) {
        let is_partial = match service {
            NmtService::ResetCommunication => true,
            NmtService::ResetNode => false,
            _ => return,
        };
        for number in (1..=127).filter(|number| target == 0 || target == *number) {
            let node = NodeId::Canopen(number);
            if is_partial {
                self.communication_only.insert(node);
            } else {
                self.communication_only.remove(node);
            }
        }
    }

    /// Whether a start concerns communication objects only; the command is used up.
    pub(super) fn is_partial(&mut self, node: NodeId, cause: BootCause) -> bool {
        self.communication_only.remove(node) && matches!(cause, BootCause::Commanded { .. })
    }
}

/// How a node started, where an event tells it.
pub(super) fn boot(event: &Event) -> Option<BootCause> {
    match &event.kind {
        EventKind::BootUp { cause, .. } => Some(*cause),
        EventKind::Emcy(emergency) => emergency.boot,
        _ => None,
    }
}
