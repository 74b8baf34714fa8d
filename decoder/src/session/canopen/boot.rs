//! Restarts of nodes: cause, and effect on the state of the node.

use super::nmt::confirm_state;
use crate::event::{BootCause, EventKind, PowerSign, StateCause};
use crate::frame::Frame;
use crate::session::bus::{Bus, RestartType};
use crate::session::context::MachineContext;
use crate::session::device::on_device_restart;
use crate::session::identity::apply_node_id_change;
use crate::session::objects::{count_lost_settings, emit_restart_changes, restart_values};
use crate::session::presence::mark_returned;
use crate::session::timers::DeadlineSubject;
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

/// Time in ns within which all nodes of one machine boot.
const TOGETHER: i64 = 2_000_000_000;

/// Handles a boot-up message.
pub(in crate::session) fn on_boot_up(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    apply_node_id_change(id, frame, cx);
    let cause = boot_cause(&mut cx.bus, id);
    mark_returned(id, frame, cx);
    let lost = count_lost_settings(&cx.bus, id);
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    node.errors.clear_all();
    let limit = node.heartbeat.restart_limit().filter(|_| matches!(cause, BootCause::PresumedPowerOn { .. }));
    node.guarding.restart_series();
    node.heartbeat.restart_series();
    cx.emit_event(frame, id, false, EventKind::BootUp { cause, lost });
    on_restart(id, cause, frame, cx);
    if let Some(limit) = limit.filter(|_| cx.bus.clock.has_timestamps()) {
        expect_heartbeat(id, limit, frame, cx);
    }
}

/// Monitors the first heartbeat after a boot-up; it must follow within `limit` ns.
fn expect_heartbeat(id: NodeId, limit: i64, frame: &Frame, cx: &mut MachineContext<'_>) {
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let deadline = now.saturating_add(limit);
    node.heartbeat.rebooted = Some((now, frame.number));
    node.heartbeat.deadline = Some(deadline);
    if !std::mem::replace(&mut node.heartbeat.queued, true) {
        cx.timers.add_deadline(deadline, DeadlineSubject::Heartbeat(id));
    }
}

/// Handles a restart, after any boot sign.
pub(in crate::session) fn on_restart(
    id: NodeId,
    cause: BootCause,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    if matches!(cause, BootCause::PresumedPowerOn { .. }) {
        cx.bus.restarts.last_boot = Some((cx.bus.clock.now(), id));
    }
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    node.boots = node.boots.saturating_add(1);
    node.just_booted = true;
    let changes = restart_values(&mut cx.bus, id, frame);
    on_device_restart(&mut cx.bus, id, frame);
    emit_restart_changes(id, changes, frame, cx);
    confirm_state(id, NmtState::PreOperational, StateCause::BootUp, frame, cx);
}

/// Cause of the present restart; the command that caused it is cleared.
pub(in crate::session) fn boot_cause(bus: &mut Bus, id: NodeId) -> BootCause {
    let sign = power_sign(bus, id);
    // A reset of all nodes also applies to a node that sent nothing after it.
    let before = bus.node(id).map_or(0, |node| node.last_frame);
    let reset_of_all = bus.restarts.reset_of_all.filter(|(reset, _)| *reset > before);
    let Some(node) = bus.nodes.node_mut(id) else { return BootCause::PresumedPowerOn { sign } };
    let commanded = node.reset_frame.take().or(reset_of_all);
    node.restart = commanded.map_or(RestartType::PowerOn, |(_, restart)| restart);
    match commanded {
        Some((frame, _)) => BootCause::Commanded { frame },
        None => BootCause::PresumedPowerOn { sign },
    }
}

/// Evidence that the machine had a power cycle, not this node alone.
fn power_sign(bus: &Bus, id: NodeId) -> Option<PowerSign> {
    if !bus.clock.has_timestamps() {
        return None;
    }
    let is_recent = |time: i64| bus.clock.now().saturating_sub(time) < TOGETHER;
    if bus.restarts.last_boot.is_some_and(|(time, node)| node != id && is_recent(time)) {
        return Some(PowerSign::OtherNodesToo);
    }
    bus.restarts.silent_until.filter(|time| is_recent(*time)).map(|_| PowerSign::BusWasSilent)
}
