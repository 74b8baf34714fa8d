//! Heartbeat, boot-up, node guarding: who is alive.

use crate::event::{EventKind, PowerSign, Silence, StateCause};
use crate::frame::{Frame, FrameFlags};
use crate::session::timers::Subject;
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::canopen::error_control::{self, ErrorControl};
use crate::wire::canopen::{NmtState, ObjectAddress};

/// A heartbeat is missed after this many intervals.
const LOST_AFTER: i64 = 2;

/// Nodes of one machine boot within this time of each other, in nanoseconds.
const TOGETHER: i64 = 2_000_000_000;

/// Guarding requests without reply after which a node counts as lost, where its life time factor (100D)
/// is unknown.
const UNANSWERED: u8 = 3;

impl Bus {
    pub(in crate::session) fn on_error_control(&mut self, id: NodeId, frame: &Frame, out: &mut dyn Observer) {
        if frame.flags.contains(FrameFlags::REMOTE) {
            return self.on_guard_request(id, frame, out);
        }
        let parsed = error_control::parse(frame.data());
        match parsed {
            Ok(message) if frame.length == 1 && message.state.is_some() => self.belief.support(),
            _ => self.belief.contradict(),
        }
        if parsed.is_ok_and(|message| message.state.is_none()) && !self.belief.is_believed() {
            return self.undecoded(frame, None, out);
        }
        if !self.is_decoded(frame, out) {
            return;
        }
        let message = match parsed {
            Ok(message) => message,
            Err(error) => return self.malformed(frame, id, error, "error control has one byte", out),
        };
        self.clock.saw_periodic();
        // A node whose heartbeat is on leaves guarding requests unanswered (CiA 301 §7.5.2.20): what comes behind
        // one is its next heartbeat.
        let is_reply = message.toggle
            || self.node(id).is_some_and(|node| {
                node.guarding.is_open && node.heartbeat.configured.is_none_or(|time| time == 0)
            });
        if message.state == Some(NmtState::Initialising) && !message.toggle {
            self.on_boot_up(id, frame, out);
        } else if is_reply {
            self.on_guard_reply(id, message, frame, out);
        } else {
            self.on_heartbeat(id, message, frame, out);
        }
    }

    fn on_heartbeat(&mut self, id: NodeId, message: ErrorControl, frame: &Frame, out: &mut dyn Observer) {
        self.heard(id, frame, out);
        let kind = EventKind::Heartbeat { state: message.state, code: message.code };
        // A known state is told by the state's event; an unknown one only here.
        self.emit(frame, id, message.state.is_some(), kind, out);
        self.rearm_heartbeat(id);
        if let Some(state) = message.state {
            self.confirm_state(id, state, StateCause::Heartbeat, frame, out);
        }
    }

    fn on_boot_up(&mut self, id: NodeId, frame: &Frame, out: &mut dyn Observer) {
        self.take_node_id(id, frame, out);
        let cause = self.boot_cause(id);
        self.heard(id, frame, out);
        let lost = self.settings_lost(id);
        let Some(node) = self.node_mut(id) else { return };
        node.active_errors.clear();
        node.guarding.toggle = None;
        node.guarding.is_open = false;
        node.guarding.missed = 0;
        node.heartbeat.last = None;
        node.heartbeat.intervals = [0; 4];
        node.heartbeat.deadline = None;
        self.emit(frame, id, false, EventKind::BootUp { cause, lost }, out);
        self.restarted(id, cause, frame, out);
        self.confirm_state(id, NmtState::PreOperational, StateCause::BootUp, frame, out);
    }

    /// What makes a power-on of the machine likelier than a restart of this node alone.
    pub(in crate::session) fn power_sign(&self, id: NodeId) -> Option<PowerSign> {
        if !self.clock.runs() {
            return None;
        }
        let is_recent = |time: i64| self.clock.now().saturating_sub(time) < TOGETHER;
        if self.last_boot.is_some_and(|(time, node)| node != id && is_recent(time)) {
            return Some(PowerSign::OtherNodesToo);
        }
        self.silent_until.filter(|time| is_recent(*time)).map(|_| PowerSign::BusWasSilent)
    }

    fn on_guard_request(&mut self, id: NodeId, frame: &Frame, out: &mut dyn Observer) {
        if !self.is_decoded(frame, out) {
            return;
        }
        let now = self.clock.now();
        let life_factor = self.number(id, ObjectAddress::new(0x100D, 0));
        let Some(node) = self.node_mut(id) else { return };
        let guarding = &mut node.guarding;
        let first = !std::mem::replace(&mut guarding.seen, true);
        let unanswered = std::mem::replace(&mut guarding.is_open, true);
        guarding.missed = if unanswered { guarding.missed.saturating_add(1) } else { 0 };
        let limit = life_factor.and_then(|factor| u8::try_from(factor).ok()).filter(|factor| *factor > 0);
        let is_lost =
            guarding.missed >= limit.unwrap_or(UNANSWERED) && guarding.last_reply.is_some() && !node.lost;
        let gap = guarding.last_reply.map_or(0, |last| now.saturating_sub(last));
        self.emit(frame, id, !first, EventKind::GuardRequest, out);
        if is_lost {
            self.lose(id, gap, "guarding", frame, out);
        }
    }

    fn on_guard_reply(&mut self, id: NodeId, message: ErrorControl, frame: &Frame, out: &mut dyn Observer) {
        self.heard(id, frame, out);
        let now = self.clock.now();
        let Some(node) = self.node_mut(id) else { return };
        let guarding = &mut node.guarding;
        let first = guarding.last_reply.is_none();
        guarding.is_open = false;
        guarding.missed = 0;
        guarding.last_reply = Some(now);
        let before = guarding.toggle.replace(message.toggle);
        // The toggle bit of the first reply after boot-up is 0 (CiA 301 §7.2.8.3.2.1); mid-run it is any.
        let toggle_error = before == Some(message.toggle);
        let kind = EventKind::GuardReply {
            state: message.state,
            code: message.code,
            toggle: message.toggle,
            toggle_error,
        };
        self.emit(frame, id, !first && !toggle_error && message.state.is_some(), kind, out);
        if let Some(state) = message.state {
            self.confirm_state(id, state, StateCause::GuardReply, frame, out);
        }
    }

    /// Sets the next heartbeat's deadline.
    fn rearm_heartbeat(&mut self, id: NodeId) {
        if !self.clock.runs() {
            return;
        }
        let now = self.clock.now();
        let Some(node) = self.node_mut(id) else { return };
        let heartbeat = &mut node.heartbeat;
        if let Some(last) = heartbeat.last.replace(now) {
            let [newest, second, third, _] = heartbeat.intervals;
            heartbeat.intervals = [now.saturating_sub(last).max(1), newest, second, third];
        }
        heartbeat.deadline =
            heartbeat.expected().map(|interval| now.saturating_add(interval.saturating_mul(LOST_AFTER)));
        if let (Some(deadline), false) = (heartbeat.deadline, heartbeat.queued) {
            heartbeat.queued = true;
            self.timers.add(deadline, Subject::Heartbeat(id));
        }
    }

    /// A heartbeat's entry in the timer queue came due.
    pub(in crate::session) fn heartbeat_deadline(&mut self, id: NodeId, now: i64, out: &mut dyn Observer) {
        let Some(node) = self.node_mut(id) else { return };
        node.heartbeat.queued = false;
        let Some(deadline) = node.heartbeat.deadline else { return };
        if deadline >= now {
            node.heartbeat.queued = true;
            return self.timers.add(deadline, Subject::Heartbeat(id));
        }
        node.heartbeat.deadline = None;
        let gap = node.heartbeat.last.map_or(0, |last| deadline.saturating_sub(last));
        // The deadline's own time, and the node's last frame as the evidence.
        let mut frame = Frame { number: node.last_frame, ..Frame::EMPTY };
        frame.time = self.clock.stamp_of(deadline);
        self.lose(id, gap, "heartbeat", &frame, out);
    }

    fn lose(
        &mut self,
        id: NodeId,
        gap: i64,
        monitored_by: &'static str,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(node) = self.node_mut(id) else { return };
        if std::mem::replace(&mut node.lost, true) {
            return;
        }
        node.refresh_attention();
        let silence = silence(node, gap, monitored_by);
        self.emit(frame, id, false, EventKind::NodeLost(silence), out);
    }

    /// A frame of this node was seen: it lives.
    pub(in crate::session) fn heard(&mut self, id: NodeId, frame: &Frame, out: &mut dyn Observer) {
        let now = self.clock.now();
        let Some(node) = self.node_mut(id) else { return };
        if std::mem::replace(&mut node.lost, false) {
            let gap = now.saturating_sub(node.last_heard);
            let monitored_by = if node.guarding.last_reply.is_some() { "guarding" } else { "heartbeat" };
            let kind = EventKind::NodeBack(silence(node, gap, monitored_by));
            node.refresh_attention();
            self.emit(frame, id, false, kind, out);
        }
        let Some(node) = self.node_mut(id) else { return };
        node.last_frame = frame.number;
        if node.first_frame == 0 {
            node.first_frame = frame.number;
        }
        node.last_seen = frame.time;
        node.last_heard = now;
    }
}

fn silence(node: &crate::session::Node, gap: i64, monitored_by: &'static str) -> Silence {
    Silence {
        last_frame: node.last_frame,
        last_state: node.nmt.map(|nmt| nmt.state),
        last_emcy: node.last_error,
        gap,
        monitored_by,
    }
}
