//! J1939 messages whose meaning depends on devices and addresses.

use crate::session::context::MachineContext;
use crate::session::timers::DeadlineSubject;

/// Resets J1939 messages after a change of devices or addresses: new layouts apply, no message is overdue.
pub(in crate::session) fn refresh_messages(cx: &mut MachineContext<'_>) {
    for (slot, cadence) in cx.bus.routes.refresh_messages() {
        cx.timers.remove_subject(DeadlineSubject::Message(slot));
        if let Some(node) = cx.bus.nodes.node_mut(cadence.node) {
            node.behaviour.overdue.retain(|overdue| *overdue != cadence.name);
        }
    }
}
