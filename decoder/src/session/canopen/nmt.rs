//! NMT commands and states.
//!
//! Commands are not acknowledged. The state after a command is presumed until a message of the node
//! confirms it.

use crate::event::{Event, EventKind, StateCause, StateCertainty, StateChange};
use crate::frame::Frame;
use crate::session::bus::{NmtStatus, RestartType};
use crate::session::context::MachineContext;
use crate::session::device::{on_nmt_service, reassess_set_points};
use crate::session::machine::ProtocolMachine;
use crate::wire::canopen::NmtState;
use crate::wire::canopen::nmt::{self, NmtService};
use crate::wire::{MalformedPayload, NodeId};

/// Time in ns after a state change in which queued messages of the node can still arrive.
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

/// Type of restart after a reset command.
const fn restart_type(service: NmtService) -> RestartType {
    match service {
        NmtService::ResetCommunication => RestartType::Communication,
        _ => RestartType::Node,
    }
}

/// Whether a frame is valid as NMT command: exactly two bytes, and a defined command to an existing node-ID.
pub(super) fn is_valid_command(frame: &Frame) -> bool {
    frame.length == 2
        && frame.flags.is_classic_data()
        && nmt::parse(frame.data())
            .is_ok_and(|command| command.target <= 127 && state_after(command.service).is_some())
}

/// NMT commands of the master. The resulting states are in the nodes.
#[derive(Debug, Clone)]
pub(in crate::session) struct NmtMachine;

impl ProtocolMachine for NmtMachine {
    type Route<'a> = ();
    type Product = ();

    fn on_frame(&mut self, (): (), frame: &Frame, cx: &mut MachineContext<'_>) {
        let parsed = nmt::parse(frame.data());
        let is_valid = is_valid_command(frame);
        if is_valid {
            cx.bus.protocols.canopen.add_evidence();
        } else {
            cx.bus.protocols.canopen.add_contradiction();
        }
        if !is_valid && !cx.bus.protocols.canopen.is_confirmed() {
            return cx.emit_undecoded(frame, None);
        }
        if !cx.is_decoded(target_of(frame), frame) {
            return;
        }
        let command = match parsed {
            Ok(command) => command,
            Err(error) => return cx.emit_malformed(frame, None, error, "an NMT command has two bytes"),
        };
        let to = state_after(command.service);
        let from = cx.bus.node(command.target).and_then(|node| node.nmt).map(|nmt| nmt.state);
        let kind = EventKind::NmtCommand { service: command.service, target: command.target, from, to };
        // No node has an ID above 127.
        let target = NodeId::Canopen(command.target);
        cx.emit_event(frame, Some(target).filter(|target| target.is_valid()), false, kind);
        if frame.length > 2 {
            let error = MalformedPayload { layer: "nmt", offset: 2, needed: 0, available: frame.length };
            cx.emit_malformed(frame, None, error, "an NMT command has two bytes");
        }
        let Some(to) = to else { return };
        if command.target == 0 && to == NmtState::Initialising {
            cx.bus.restarts.reset_of_all = Some((frame.number, restart_type(command.service)));
        }
        let targets = if command.target == 0 { 1..=127 } else { command.target..=command.target };
        for id in targets {
            if command.target != 0 || cx.bus.node(id).is_some() {
                on_command(id.into(), command.service, to, frame, cx);
            }
        }
    }
}

/// Node that a command addresses; `None` for all nodes.
fn target_of(frame: &Frame) -> Option<NodeId> {
    frame.data().get(1).copied().map(NodeId::Canopen).filter(|node| node.is_valid())
}

fn on_command(id: NodeId, service: NmtService, to: NmtState, frame: &Frame, cx: &mut MachineContext<'_>) {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    if to == NmtState::Initialising {
        node.reset_frame = Some((frame.number, restart_type(service)));
        // A node that resets sends no heartbeat until it has booted.
        node.heartbeat.deadline = None;
        node.heartbeat.last = None;
        node.heartbeat.intervals = [0; 4];
        node.guarding.toggle = None;
    }
    presume_state(id, to, StateCause::Command, frame, cx);
    on_nmt_service(id, service, frame, cx);
}

/// Sets a state that the node has not confirmed.
pub(in crate::session) fn presume_state(
    id: NodeId,
    to: NmtState,
    cause: StateCause,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let before = node.nmt.replace(NmtStatus {
        state: to,
        certainty: StateCertainty::Presumed,
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
        certainty: StateCertainty::Presumed,
    };
    // The event of the command already reports the state.
    cx.emit_event(frame, id, cause == StateCause::Command, EventKind::NmtState(change));
    reassess_set_points(id, frame, cx);
}

/// Sets a state confirmed by a message of the node; emits an event if it is new.
pub(in crate::session) fn confirm_state(
    id: NodeId,
    to: NmtState,
    cause: StateCause,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let now = cx.bus.clock.now();
    let runs = cx.bus.clock.has_timestamps();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let before = node.nmt;
    let status =
        NmtStatus { state: to, certainty: StateCertainty::Confirmed, cause, frame: frame.number, since: now };
    let Some(old) = before else {
        node.nmt = Some(status);
        node.refresh_attention();
        return emit_state_change(None, status, frame, None, id, cx);
    };
    let age = now.saturating_sub(old.since);
    // A boot-up message after a reset is never an old one from a queue.
    let is_earlier = matches!(old.cause, StateCause::BusFile { .. });
    let may_be_queued = runs && age < QUEUED && cause != StateCause::BootUp && !is_earlier;
    if old.state != to && old.certainty == StateCertainty::Presumed && may_be_queued {
        return;
    }
    let is_news = old.state != to || old.certainty == StateCertainty::Presumed;
    // Time and frame remain those of the change; the cause is the last evidence.
    node.nmt = Some(if is_news { status } else { NmtStatus { cause, ..old } });
    node.refresh_attention();
    if is_news {
        let confirms = old.state == to && old.certainty == StateCertainty::Presumed;
        // The time of a command before the capture is unknown.
        let is_timed = runs && !is_earlier;
        emit_state_change(Some(old), status, frame, confirms.then_some(age).filter(|_| is_timed), id, cx);
        reassess_set_points(id, frame, cx);
    }
}

fn emit_state_change(
    before: Option<NmtStatus>,
    now: NmtStatus,
    frame: &Frame,
    after: Option<i64>,
    id: NodeId,
    cx: &mut MachineContext<'_>,
) {
    let cause_frame = match before {
        Some(before) if before.state == now.state && before.frame > 0 => before.frame,
        _ => frame.number,
    };
    let change = StateChange {
        from: before.map(|before| before.state),
        to: now.state,
        cause: now.cause,
        cause_frame,
        after,
        certainty: StateCertainty::Confirmed,
    };
    let mut event: Event = cx.canopen_event(frame, EventKind::NmtState(change));
    event.node = Some(id);
    event.presumed = !cx.bus.protocols.is_settled(Some(id));
    // The boot-up message itself means that the node is now pre-operational.
    event.routine = now.cause == StateCause::BootUp;
    cx.send_event(&event);
}

/// Confirms operational by a PDO of the node, if it is not confirmed yet.
#[cold]
pub(in crate::session) fn confirm_operational_by_pdo(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let contradicts_words = cx.bus.node(id).and_then(|node| node.nmt).is_some_and(|nmt| {
        // A state reported by the node has precedence over a PDO on its identifier.
        nmt.state != NmtState::Operational && nmt.is_reported()
    });
    if !contradicts_words {
        confirm_state(id, NmtState::Operational, StateCause::Pdo, frame, cx);
    }
}
