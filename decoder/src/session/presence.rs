//! Presence of a node: last frame, loss and return.

use crate::event::{EventKind, MonitoringMethod, NodeSilence};
use crate::frame::Frame;
use crate::session::bus::Node;
use crate::session::context::MachineContext;
use crate::wire::NodeId;

/// Registers a frame of the node other than its error control. If guarding had reported it as lost, only the responses
/// to guarding are missing; otherwise a lost node is back.
pub(in crate::session) fn mark_alive(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let unanswered = node.guarding.last_reply.filter(|_| node.lost && node.guarding.is_reported);
    if let Some(last) = unanswered {
        node.lost = false;
        node.refresh_attention();
        let silence = build_silence(node, now.saturating_sub(last), MonitoringMethod::Guarding);
        let silence = NodeSilence { others_continue: true, ..silence };
        cx.emit_event(frame, id, false, EventKind::NodeLost(silence));
    }
    mark_returned(id, frame, cx);
}

/// Registers a frame of the node; a lost node is back.
pub(in crate::session) fn mark_returned(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    if std::mem::replace(&mut node.lost, false) {
        let gap = now.saturating_sub(node.last_received);
        let is_guarded = node.guarding.last_reply.is_some();
        let monitored_by = if is_guarded { MonitoringMethod::Guarding } else { MonitoringMethod::Heartbeat };
        let kind = EventKind::NodeBack(build_silence(node, gap, monitored_by));
        node.heartbeat.missing_since = None;
        node.refresh_attention();
        cx.emit_event(frame, id, false, kind);
    }
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    node.last_frame = frame.number;
    if node.first_frame == 0 {
        node.first_frame = frame.number;
    }
    node.last_seen = frame.time;
    node.last_received = now;
}

/// Reports a node that is silent longer than its monitoring time.
pub(in crate::session) fn emit_node_lost(
    id: NodeId,
    gap: i64,
    monitored_by: MonitoringMethod,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    if std::mem::replace(&mut node.lost, true) {
        return;
    }
    node.refresh_attention();
    let silence = build_silence(node, gap, monitored_by);
    cx.emit_event(frame, id, false, EventKind::NodeLost(silence));
}

/// Reports at `frame` that the heartbeat of a node is missing at the monotonic time `now` while its PDOs continue, or that
/// it is back.
pub(in crate::session) fn emit_heartbeat_gap(
    id: NodeId,
    is_missing: bool,
    now: i64,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let rebooted = node.heartbeat.rebooted.map(|(time, _)| time);
    let since = if is_missing { node.heartbeat.last.or(rebooted) } else { node.heartbeat.missing_since };
    node.heartbeat.missing_since = since.filter(|_| is_missing);
    let gap = since.map_or(0, |since| now.saturating_sub(since));
    let silence = build_silence(node, gap, MonitoringMethod::Heartbeat);
    let silence = NodeSilence { others_continue: true, ..silence };
    let kind = if is_missing { EventKind::NodeLost(silence) } else { EventKind::NodeBack(silence) };
    cx.emit_event(frame, id, false, kind);
}

/// Reports that a node responds to guarding again, after only these responses were missing.
pub(in crate::session) fn emit_guarding_return(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.known_node_mut(id) else { return };
    let last = node.guarding.last_reply.filter(|_| node.guarding.is_reported && !node.lost);
    if let Some(last) = last {
        let silence = build_silence(node, now.saturating_sub(last), MonitoringMethod::Guarding);
        let silence = NodeSilence { others_continue: true, ..silence };
        cx.emit_event(frame, id, false, EventKind::NodeBack(silence));
    }
}

fn build_silence(node: &Node, gap: i64, monitored_by: MonitoringMethod) -> NodeSilence {
    NodeSilence {
        last_frame: node.last_frame,
        last_state: node.nmt.map(|nmt| nmt.state),
        last_emcy: node.errors.last,
        gap,
        monitored_by,
        others_continue: false,
        boot_frame: node.heartbeat.rebooted.map(|(_, frame)| frame),
    }
}
