//! NMT commands and states.
//!
//! Commands are never acknowledged, so a state that follows from one is presumed until the node says it
//! or shows it.

use crate::event::{Certainty, Event, EventKind, StateCause, StateChange};
use crate::frame::Frame;
use crate::session::device::Restart;
use crate::session::node::NmtStatus;
use crate::session::{Bus, Observer};
use crate::wire::canopen::NmtState;
use crate::wire::canopen::nmt::{self, NmtService};
use crate::wire::{Malformed, NodeId};

/// After a change, messages the node had already queued still come (in nanoseconds).
const QUEUED: i64 = 20_000_000;

const fn state_after(service: NmtService) -> Option<NmtState> {
    match service {
        NmtService::Start => Some(NmtState::Operational),
        NmtService::Stop => Some(NmtState::Stopped),
        NmtService::EnterPreOperational => Some(NmtState::PreOperational),
        NmtService::ResetNode | NmtService::ResetCommunication => Some(NmtState::Initialising),
        NmtService::Unknown(_) => None,
    }
}

/// How thoroughly a reset starts a node anew.
const fn restart(service: NmtService) -> Restart {
    match service {
        NmtService::ResetCommunication => Restart::Communication,
        _ => Restart::Node,
    }
}

impl Bus {
    pub(in crate::session) fn on_nmt(&mut self, frame: &Frame, out: &mut dyn Observer) {
        let parsed = nmt::parse(frame.data());
        // Exactly two bytes and a known command to an existing node-ID: nothing else on this identifier.
        let is_valid = frame.length == 2
            && frame.flags.is_classic_data()
            && parsed.is_ok_and(|command| command.target <= 127 && state_after(command.service).is_some());
        if is_valid {
            self.belief.support();
        } else {
            self.belief.contradict();
        }
        if !is_valid && !self.belief.is_believed() {
            return self.undecoded(frame, None, out);
        }
        if !self.is_decoded(frame, out) {
            return;
        }
        let command = match parsed {
            Ok(command) => command,
            Err(error) => return self.malformed(frame, None, error, "an NMT command has two bytes", out),
        };
        let to = state_after(command.service);
        let from = self.node(command.target).and_then(|node| node.nmt).map(|nmt| nmt.state);
        let kind = EventKind::NmtCommand { service: command.service, target: command.target, from, to };
        // A target above 127 addresses nobody.
        let target = NodeId::Canopen(command.target);
        self.emit(frame, Some(target).filter(|target| target.is_valid()), false, kind, out);
        if frame.length > 2 {
            let error = Malformed { layer: "nmt", offset: 2, needed: 0, available: frame.length };
            self.malformed(frame, None, error, "an NMT command has two bytes", out);
        }
        let Some(to) = to else { return };
        if command.target == 0 && to == NmtState::Initialising {
            self.reset_all = Some((frame.number, restart(command.service)));
        }
        let targets = if command.target == 0 { 1..=127 } else { command.target..=command.target };
        for id in targets {
            if command.target != 0 || self.node(id).is_some() {
                self.command(id.into(), command.service, to, frame, out);
            }
        }
    }

    fn command(
        &mut self,
        id: NodeId,
        service: NmtService,
        to: NmtState,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(node) = self.node_mut(id) else { return };
        if to == NmtState::Initialising {
            node.reset_frame = Some((frame.number, restart(service)));
            // A node that resets sends no heartbeat until it has booted.
            node.heartbeat.deadline = None;
            node.heartbeat.last = None;
            node.heartbeat.intervals = [0; 4];
            node.guarding.toggle = None;
        }
        self.presume_state(id, to, StateCause::Command, frame, out);
        self.device_saw_nmt(id, service, frame, out);
    }

    /// Notes a state nobody confirmed.
    pub(in crate::session) fn presume_state(
        &mut self,
        id: NodeId,
        to: NmtState,
        cause: StateCause,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let now = self.clock.now();
        let Some(node) = self.node_mut(id) else { return };
        let before = node.nmt.replace(NmtStatus {
            state: to,
            certainty: Certainty::Presumed,
            cause,
            frame: frame.number,
            since: now,
        });
        node.refresh_attention();
        let change = StateChange {
            from: before.map(|before| before.state),
            to,
            cause,
            cause_frame: frame.number,
            after: None,
            certainty: Certainty::Presumed,
        };
        // The command itself tells it already.
        self.emit(frame, id, cause == StateCause::Command, EventKind::NmtState(change), out);
        self.reassess(id, frame, out);
    }

    /// Notes a state the node itself tells or shows; says so if that is news.
    pub(in crate::session) fn confirm_state(
        &mut self,
        id: NodeId,
        to: NmtState,
        cause: StateCause,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let now = self.clock.now();
        let runs = self.clock.runs();
        let Some(node) = self.node_mut(id) else { return };
        let before = node.nmt;
        let status =
            NmtStatus { state: to, certainty: Certainty::Confirmed, cause, frame: frame.number, since: now };
        let Some(old) = before else {
            node.nmt = Some(status);
            node.refresh_attention();
            return self.emit_change(None, status, frame, None, id, out);
        };
        let age = now.saturating_sub(old.since);
        // A boot-up answers the reset, however soon: none waits in a queue from before it.
        let may_be_queued = runs && age < QUEUED && cause != StateCause::BootUp;
        if old.state != to && old.certainty == Certainty::Presumed && may_be_queued {
            return;
        }
        let is_news = old.state != to || old.certainty == Certainty::Presumed;
        // The moment and the frame stay those of the change; the last teller is remembered.
        node.nmt = Some(if is_news { status } else { NmtStatus { cause, ..old } });
        node.refresh_attention();
        if is_news {
            let confirms = old.state == to && old.certainty == Certainty::Presumed;
            self.emit_change(Some(old), status, frame, confirms.then_some(age).filter(|_| runs), id, out);
            self.reassess(id, frame, out);
        }
    }

    fn emit_change(
        &self,
        before: Option<NmtStatus>,
        now: NmtStatus,
        frame: &Frame,
        after: Option<i64>,
        id: NodeId,
        out: &mut dyn Observer,
    ) {
        let cause_frame = match before {
            Some(before) if before.state == now.state => before.frame,
            _ => frame.number,
        };
        let change = StateChange {
            from: before.map(|before| before.state),
            to: now.state,
            cause: now.cause,
            cause_frame,
            after,
            certainty: Certainty::Confirmed,
        };
        let mut event: Event = self.event(frame, EventKind::NmtState(change));
        event.node = Some(id);
        // A boot-up message says by itself that the node is pre-operational now.
        event.routine = now.cause == StateCause::BootUp;
        out.event(&event, self);
    }

    /// A PDO of a node whose state is not confirmed operational.
    #[cold]
    pub(in crate::session) fn pdo_shows_state(&mut self, id: NodeId, frame: &Frame, out: &mut dyn Observer) {
        let contradicts_words = self.node(id).and_then(|node| node.nmt).is_some_and(|nmt| {
            // What the node says of itself weighs more than a PDO on its identifier.
            nmt.state != NmtState::Operational
                && matches!(nmt.cause, StateCause::Heartbeat | StateCause::GuardReply)
        });
        if !contradicts_words {
            self.confirm_state(id, NmtState::Operational, StateCause::Pdo, frame, out);
        }
    }
}
