//! NMT error control: heartbeat, boot-up and node guarding.

use super::boot::on_boot_up;
use super::nmt::confirm_state;
use crate::event::{EventKind, MonitoringMethod, StateCause};
use crate::frame::{Frame, FrameFlags};
use crate::session::bus::{Bus, UNANSWERED};
use crate::session::context::MachineContext;
use crate::session::machine::{ProtocolMachine, TimedMachine};
use crate::session::presence::{emit_guarding_return, emit_heartbeat_gap, emit_node_lost, mark_returned};
use crate::session::timers::DeadlineSubject;
use crate::wire::canopen::error_control::{self, ErrorControlByte as Message};
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::{MalformedPayload, NodeId};

/// Intervals without a heartbeat after which the node is lost.
const LOST_AFTER: i64 = 2;

/// Heartbeat and guarding of all nodes; the state of each is in the node.
#[derive(Debug, Clone)]
pub(in crate::session) struct ErrorControlMachine;

impl ProtocolMachine for ErrorControlMachine {
    type Route<'a> = NodeId;
    type Product = ();

    fn on_silence(&mut self, delay: i64, bus: &mut Bus) {
        for node in bus.nodes.all_mut() {
            // The interval that contains the silence is not a period of the node, and its responses before and
            // after the silence do not follow each other.
            for time in [&mut node.heartbeat.deadline, &mut node.heartbeat.last].into_iter().flatten() {
                *time = time.saturating_add(delay);
            }
            node.guarding.toggle = None;
            node.guarding.interval = 0;
        }
    }

    fn on_frame(&mut self, id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
        if frame.flags.contains(FrameFlags::REMOTE) {
            return on_guard_request(id, frame, cx);
        }
        let parsed = error_control::parse(frame.data());
        match parsed {
            Ok(message) if frame.length == 1 && message.state.is_some() => {
                cx.bus.protocols.canopen.add_evidence();
            }
            _ => {
                cx.bus.protocols.canopen.add_contradiction();
                let is_byte = frame.length == 1;
                let expected =
                    if is_byte { "the value 00, 04, 05 or 7F, toggle bit apart" } else { "1 byte" };
                cx.emit_contradicted_name(id, frame, expected);
            }
        }
        if parsed.is_ok_and(|message| message.state.is_none()) && !cx.is_settled(Some(id)) {
            return cx.emit_undecoded(frame, None);
        }
        if !cx.is_decoded(Some(id), frame) {
            return;
        }
        let message = match parsed {
            Ok(message) => message,
            Err(error) => return cx.emit_malformed(frame, id, error, "error control has one byte"),
        };
        // A node with enabled heartbeat does not respond to guarding requests (CiA 301 §7.5.2.20): the
        // message after a request is its next heartbeat.
        let is_reply = message.toggle
            || cx.bus.node(id).is_some_and(|node| {
                node.guarding.is_open && node.heartbeat.configured.is_none_or(|time| time == 0)
            });
        if message.state == Some(NmtState::Initialising) && !message.toggle {
            if let Some(node) = cx.bus.nodes.node_mut(id) {
                node.signs.is_boot_up_sent = true;
            }
            on_boot_up(id, frame, cx);
        } else if is_reply {
            on_guard_reply(id, message, frame, cx);
        } else {
            on_heartbeat(id, message, frame, cx);
        }
        if frame.length > 1 {
            let error =
                MalformedPayload { layer: "error-control", offset: 1, needed: 0, available: frame.length };
            cx.emit_malformed(frame, id, error, "error control has one byte");
        }
    }
}

impl TimedMachine for ErrorControlMachine {
    type Deadline = NodeId;

    fn on_deadline(&mut self, id: NodeId, now: i64, cx: &mut MachineContext<'_>) {
        let Some(node) = cx.bus.nodes.node_mut(id) else { return };
        node.heartbeat.queued = false;
        let Some(deadline) = node.heartbeat.deadline else { return };
        if deadline >= now {
            node.heartbeat.queued = true;
            return cx.timers.add_deadline(deadline, DeadlineSubject::Heartbeat(id));
        }
        node.heartbeat.deadline = None;
        let last_frame = node.last_frame;
        let rebooted = node.heartbeat.rebooted.map(|(time, _)| time);
        // Any frame after the boot-up shows that only the heartbeat is missing.
        let is_alive = rebooted.is_some_and(|boot| node.last_received > boot);
        if is_alive || cx.bus.routes.sends_pdos(id, deadline) {
            let mut frame = Frame { number: last_frame, ..Frame::EMPTY };
            frame.time = cx.bus.clock.stamp_of(deadline);
            return emit_heartbeat_gap(id, true, deadline, &frame, cx);
        }
        let Some(node) = cx.bus.nodes.known_node_mut(id) else { return };
        // A silence of the whole bus postpones the heartbeat, but not the last frame of the node.
        let last = node.heartbeat.last.or(rebooted).map(|last| last.min(node.last_received));
        let gap = last.map_or(0, |last| deadline.saturating_sub(last));
        // The event has the time of the deadline, and the last frame of the node as evidence.
        let mut frame = Frame { number: node.last_frame, ..Frame::EMPTY };
        frame.time = cx.bus.clock.stamp_of(deadline);
        emit_node_lost(id, gap, MonitoringMethod::Heartbeat, &frame, cx);
    }
}

fn on_heartbeat(id: NodeId, message: Message, frame: &Frame, cx: &mut MachineContext<'_>) {
    if cx.bus.node(id).is_some_and(|node| node.heartbeat.missing_since.is_some()) {
        let now = cx.bus.clock.now();
        emit_heartbeat_gap(id, false, now, frame, cx);
    }
    mark_returned(id, frame, cx);
    let kind = EventKind::Heartbeat { state: message.state, code: message.code };
    // A defined state has an event of its own; only an undefined one is not routine.
    cx.emit_event(frame, id, message.state.is_some(), kind);
    rearm_heartbeat(id, cx);
    if let Some(state) = message.state {
        confirm_state(id, state, StateCause::Heartbeat, frame, cx);
    }
}

fn on_guard_request(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    if !cx.is_decoded(Some(id), frame) {
        return;
    }
    let now = cx.bus.clock.now();
    let life_factor = cx.bus.nodes.object_number(id, ObjectAddress::new(0x100D, 0));
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let last_received = node.last_received;
    let guarding = &mut node.guarding;
    let first = !std::mem::replace(&mut guarding.seen, true);
    let unanswered = std::mem::replace(&mut guarding.is_open, true);
    guarding.missed = if unanswered { guarding.missed.saturating_add(1) } else { 0 };
    let limit = life_factor.and_then(|factor| u8::try_from(factor).ok()).filter(|factor| *factor > 0);
    if !unanswered {
        guarding.unanswered_since = Some(now);
    }
    let is_lost = guarding.shows_loss(limit.unwrap_or(UNANSWERED), last_received, now) && !node.lost;
    guarding.is_reported |= is_lost;
    let gap = guarding.last_reply.map_or(0, |last| now.saturating_sub(last.max(last_received)));
    cx.emit_event(frame, id, !first, EventKind::GuardRequest);
    if is_lost {
        emit_node_lost(id, gap, MonitoringMethod::Guarding, frame, cx);
    }
}

fn on_guard_reply(id: NodeId, message: Message, frame: &Frame, cx: &mut MachineContext<'_>) {
    emit_guarding_return(id, frame, cx);
    mark_returned(id, frame, cx);
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let is_renewed = node.guarding.missed >= UNANSWERED || node.guarding.has_outlived(&node.store, now);
    let guarding = &mut node.guarding;
    let last = guarding.last_reply.replace(now);
    let first = last.is_none();
    guarding.is_open = false;
    guarding.missed = 0;
    (guarding.unanswered_since, guarding.is_reported) = (None, false);
    guarding.interval = if is_renewed { 0 } else { last.map_or(0, |last| now.saturating_sub(last)) };
    let before = guarding.toggle.replace(message.toggle).filter(|_| !is_renewed);
    // The first response after boot-up has toggle 0 (CiA 301 §7.2.8.3.2.1); a capture may start later.
    let toggle_error = before == Some(message.toggle);
    let kind = EventKind::GuardReply {
        state: message.state,
        code: message.code,
        toggle: message.toggle,
        toggle_error,
    };
    cx.emit_event(frame, id, !first && !toggle_error && message.state.is_some(), kind);
    if let Some(state) = message.state {
        confirm_state(id, state, StateCause::GuardReply, frame, cx);
    }
}

/// Sets the deadline of the next heartbeat.
fn rearm_heartbeat(id: NodeId, cx: &mut MachineContext<'_>) {
    if !cx.bus.clock.has_timestamps() {
        return;
    }
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let heartbeat = &mut node.heartbeat;
    heartbeat.rebooted = None;
    if let Some(last) = heartbeat.last.replace(now) {
        let [newest, second, third, _] = heartbeat.intervals;
        heartbeat.intervals = [now.saturating_sub(last).max(1), newest, second, third];
    }
    heartbeat.deadline =
        heartbeat.expected_interval().map(|interval| now.saturating_add(interval.saturating_mul(LOST_AFTER)));
    if let (Some(deadline), false) = (heartbeat.deadline, heartbeat.queued) {
        heartbeat.queued = true;
        cx.timers.add_deadline(deadline, DeadlineSubject::Heartbeat(id));
    }
}
