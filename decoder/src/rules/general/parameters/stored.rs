//! Store and restore commands, and their effect at a restart.

use crate::event::{BootCause, Event, EventKind, SdoDirection, SdoOutcome, SdoTransfer};
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::{NodeId, NodeSet};

/// End of the communication objects. A communication reset affects only these (CiA 301 §7.3.2.2.2).
pub(super) const COMMUNICATION_END: u16 = 0x2000;

/// Maximum number of objects per node; a node with more objects is not checked.
pub(super) const OBJECT_LIMIT: usize = 1024;

/// Whether a sub-index of 1010 or 1011 covers an object; manufacturer sub-indices are unknown.
pub(super) fn covers_object(sub: u8, index: u16) -> bool {
    match sub {
        1 => index >= 0x1000,
        2 => (0x1000..COMMUNICATION_END).contains(&index),
        3 => (0x6000..0xA000).contains(&index),
        _ => false,
    }
}

/// Object of a completely captured, confirmed download.
pub(super) fn written_object(transfer: &SdoTransfer) -> Option<ObjectAddress> {
    let is_whole = transfer.outcome == SdoOutcome::Complete && !transfer.cut_start && !transfer.truncated;
    transfer.object.filter(|_| is_whole && transfer.direction == Some(SdoDirection::Download))
}

/// Object of a completely captured upload.
pub(super) fn read_object(transfer: &SdoTransfer) -> Option<ObjectAddress> {
    let is_whole = transfer.outcome == SdoOutcome::Complete && !transfer.cut_start && !transfer.truncated;
    transfer.object.filter(|_| is_whole && transfer.direction == Some(SdoDirection::Upload))
}

/// Nodes whose latest reset was a communication reset.
#[derive(Default)]
pub(super) struct CommunicationResets {
    communication_only: NodeSet,
}

impl CommunicationResets {
    /// Records an NMT command.
    pub(super) fn on_command(&mut self, service: NmtService, target: u8) {
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

    /// Whether a boot-up affects communication objects only. Clears the recorded command.
    pub(super) fn is_partial(&mut self, node: NodeId, cause: BootCause) -> bool {
        self.communication_only.remove(node) && matches!(cause, BootCause::Commanded { .. })
    }
}

/// Cause of the boot-up that an event reports.
pub(super) fn boot_cause(event: &Event) -> Option<BootCause> {
    match &event.kind {
        EventKind::BootUp { cause, .. } => Some(*cause),
        EventKind::Emcy(emergency) => emergency.boot,
        _ => None,
    }
}
