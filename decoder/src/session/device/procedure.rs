//! Procedures: calibrations, changeover, store and restore, changes of node-ID and bit rate.

use std::sync::Arc;

use super::set_point::reassess_set_points;
use crate::event::{EventKind, ProcedureEvent, ProcedurePhase};
use crate::frame::Frame;
use crate::profile::device::{
    DeviceCondition, DeviceProcedure, GateStatus, ProcedureStatus, ProfileTrigger, TriggerEvent,
    UpdateSource, ValueUpdate, evaluate_all,
};
use crate::profile::{ObjectRole, ValueCarrier, as_integer};
use crate::session::bus::{Bus, FrameMoment, GatedSetPoint, OriginKind, ProcedureResult, RunningProcedure};
use crate::session::context::MachineContext;
use crate::session::objects::mark_stale;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Max running procedures per node.
const MOST_RUNNING: usize = 32;

/// A change of node-ID or bit rate.
pub(in crate::session) struct SettingAnnouncement {
    pub(in crate::session) procedure: &'static str,
    pub(in crate::session) word: &'static str,
    pub(in crate::session) finished: bool,
    pub(in crate::session) text: String,
}

/// Advances all procedures that wait for an event.
pub(in crate::session) fn advance_procedures(
    id: NodeId,
    event: &TriggerEvent<'_>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(device) = cx.bus.node(id).map(|node| Arc::clone(&node.device)) else { return };
    for (place, procedure) in device.procedures.iter().enumerate() {
        advance_procedure(id, (place, procedure), &|trigger| is_awaited(trigger, event), frame, cx);
    }
}

fn advance_procedure(
    id: NodeId,
    (place, procedure): (usize, &DeviceProcedure),
    happened: &dyn Fn(&ProfileTrigger) -> bool,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let running = cx
        .bus
        .node(id)
        .is_some_and(|node| node.behaviour.running.iter().any(|running| running.place == place));
    if !running {
        if happened(&procedure.start) {
            start_procedure(id, place, procedure, frame, cx);
        }
        return;
    }
    let is = |trigger: &Option<ProfileTrigger>| trigger.as_ref().is_some_and(happened);
    if is(&procedure.stop) {
        finish_procedure(id, place, procedure, ProcedureStatus::Stopped, "", frame, cx);
    } else if is(&procedure.end) {
        finish_procedure(id, place, procedure, ProcedureStatus::Ok, "", frame, cx);
    } else if is(&procedure.also_end) {
        let status = procedure.status.as_ref().map(|status| status.object.object);
        let text = status.map_or_else(String::new, |object| format!("result unknown, {object} not read"));
        finish_procedure(id, place, procedure, ProcedureStatus::Ended, &text, frame, cx);
    } else if let Some(step) = procedure.steps.iter().position(|step| happened(&step.on)) {
        enter_step(id, place, procedure, step, frame, cx);
    }
}

/// Advances procedures that wait for a PDO or message, possibly several times and under conditions.
pub(in crate::session) fn advance_procedures_by_message(
    id: NodeId,
    carrier: &ValueCarrier,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(device) = cx.bus.node(id).map(|node| Arc::clone(&node.device)) else { return };
    let now = cx.bus.clock.now();
    let subject = GatedSetPoint {
        object: ObjectAddress::default(),
        channel: None,
        carrier,
        id: None,
        late: false,
        short: None,
    };
    let event = carrier.into();
    for (place, procedure) in device.procedures.iter().enumerate() {
        let Some(node) = cx.bus.node(id) else { return };
        let facts = node.facts_of(subject, now);
        let is_met = |trigger: &&ProfileTrigger| {
            trigger.is_met_by(&event)
                && evaluate_all(trigger.trigger_conditions(), &facts, None) == GateStatus::Open
        };
        let mut met: Vec<&ProfileTrigger> = procedure.all_triggers().filter(is_met).collect();
        if met.is_empty() && !procedure.all_triggers().any(|trigger| trigger.is_met_by(&event)) {
            continue;
        }
        let streak = count_streak(&mut cx.bus, id, place, !met.is_empty());
        met.retain(|trigger| trigger.occurrence_count() <= streak);
        advance_procedure(id, (place, procedure), &|trigger| met.contains(&trigger), frame, cx);
    }
}

/// Consecutive messages that met the trigger of a running procedure.
fn count_streak(bus: &mut Bus, id: NodeId, place: usize, again: bool) -> u8 {
    let node = bus.nodes.node_mut(id);
    let running = node.and_then(|node| node.behaviour.running.iter_mut().find(|it| it.place == place));
    running.map_or(1, |running| {
        running.streak = if again { running.streak.saturating_add(1) } else { 0 };
        running.streak
    })
}

pub(super) fn start_procedure(
    id: NodeId,
    place: usize,
    procedure: &DeviceProcedure,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let time = cx.bus.clock.now();
    let range = procedure.invalidates.clone();
    mark_stale(&mut cx.bus, id, |object| range.iter().any(|range| range.covers(object, 0, 0)));
    if procedure.instant {
        let mut event = procedure_event(procedure, ProcedurePhase::Finished, ProcedureStatus::Ok);
        if procedure.effect.needs_restart() {
            event = procedure_event(procedure, ProcedurePhase::Accepted, ProcedureStatus::Ended);
            event.text = format!("effective {}, result unknown until then", procedure.effect.time_text());
        }
        return cx.emit_event(frame, id, false, EventKind::Procedure(Box::new(event)));
    }
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    if node.behaviour.running.len() >= MOST_RUNNING {
        node.behaviour.running.remove(0);
    }
    node.behaviour.results.retain(|result| result.place != place);
    let started = FrameMoment { what: (), frame: frame.number, time };
    node.behaviour.running.push(RunningProcedure { place, started, step: None, streak: 0 });
    let mut event = procedure_event(procedure, ProcedurePhase::Started, ProcedureStatus::Running);
    event.text = unmet_preconditions(&cx.bus, id, procedure);
    cx.emit_event(frame, id, false, EventKind::Procedure(Box::new(event)));
    if procedure.takes_over {
        reassess_set_points(id, frame, cx);
    }
}

/// Preconditions that are not met, as text.
fn unmet_preconditions(bus: &Bus, id: NodeId, procedure: &DeviceProcedure) -> String {
    let Some(node) = bus.node(id) else { return String::new() };
    let facts = node.node_facts(bus.clock.now());
    let is_unmet = |need: &&DeviceCondition| need.evaluate_condition(&facts, None) == GateStatus::Closed;
    let unmet = procedure.needs.iter().filter(is_unmet);
    let unmet: Vec<_> = unmet.map(|need| facts.deciding_fact(need, None, GateStatus::Closed)).collect();
    if unmet.is_empty() { String::new() } else { format!("precondition not met: {}", unmet.join(", ")) }
}

fn enter_step(
    id: NodeId,
    place: usize,
    procedure: &DeviceProcedure,
    step: usize,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let Some(running) = node.behaviour.running.iter_mut().find(|it| it.place == place) else { return };
    if running.step.replace(step) == Some(step) {
        return;
    }
    let duration = now.saturating_sub(running.started.time);
    let Some(name) = procedure.steps.get(step).map(|step| step.step.clone()) else { return };
    let mut event = procedure_event(procedure, ProcedurePhase::Step(name), ProcedureStatus::Running);
    event.duration = cx.bus.clock.has_timestamps().then_some(duration);
    cx.emit_event(frame, id, false, EventKind::Procedure(Box::new(event)));
}

/// Ends a running procedure; without a read status the outcome remains open.
pub(super) fn finish_procedure(
    id: NodeId,
    place: usize,
    procedure: &DeviceProcedure,
    status: ProcedureStatus,
    text: &str,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let now = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let found = node.behaviour.running.iter().position(|running| running.place == place);
    let started = found.map(|found| node.behaviour.running.remove(found).started);
    if procedure.status.is_some() {
        let (ended, outcome, is_read) = (frame.number, status, false);
        node.behaviour.set_result(ProcedureResult { place, started, ended, outcome, is_read });
    }
    let mut event = procedure_event(procedure, ProcedurePhase::Finished, status);
    let duration = started.map(|started| now.saturating_sub(started.time));
    event.duration = duration.filter(|_| cx.bus.clock.has_timestamps());
    text.clone_into(&mut event.text);
    cx.emit_event(frame, id, false, EventKind::Procedure(Box::new(event)));
    if procedure.takes_over {
        reassess_set_points(id, frame, cx);
    }
}

/// Advances procedures after a change of bits.
pub(in crate::session) fn advance_procedures_by_bits(
    id: NodeId,
    object: ObjectAddress,
    before: Option<u64>,
    raw: u64,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let event = TriggerEvent::Value(ValueUpdate {
        object,
        source: UpdateSource::Received,
        raw: Some(raw.cast_signed()),
        before: before.map(u64::cast_signed),
        bytes: &[],
        meaning: None,
        is_fresh: true,
    });
    let mut procedures = cx.bus.node(id).into_iter().flat_map(|node| &node.device.procedures);
    if procedures.any(|procedure| procedure.all_triggers().any(|trigger| is_awaited(trigger, &event))) {
        advance_procedures(id, &event, frame, cx);
    }
}

/// Advances procedures after a write or read of an object.
pub(in crate::session) fn advance_procedures_by_object(
    id: NodeId,
    object: ObjectAddress,
    value: &[u8],
    kind: OriginKind,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.node(id) else { return };
    let meaning = node.meaning(object);
    let source = match kind {
        OriginKind::Download => Some(UpdateSource::Written),
        OriginKind::Upload => Some(UpdateSource::Read),
        _ => None,
    };
    if let Some(source) = source {
        let event = TriggerEvent::Value(ValueUpdate {
            object,
            source,
            raw: meaning.as_ref().and_then(|meaning| as_integer(&meaning.decode(value))),
            before: None,
            bytes: value,
            meaning: meaning.as_ref(),
            is_fresh: false,
        });
        advance_procedures(id, &event, frame, cx);
    }
}

/// Announces a written node-ID or bit rate with its effective time.
pub(in crate::session) fn announce_written_change(
    id: NodeId,
    object: ObjectAddress,
    value: &[u8],
    kind: OriginKind,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.node(id).filter(|_| kind == OriginKind::Download) else { return };
    let Some(meaning) = node.meaning(object) else { return };
    let shown = meaning.format_value(&meaning.decode(value));
    let entry = node.device.dictionary.find_object(object).and_then(|found| found.entry);
    let when = entry.map_or("at an unknown time", |entry| entry.effect.time_text());
    let (name, word, text) = match meaning.role {
        Some(ObjectRole::NodeId) => ("node-ID change", "IDENT", format!("node-ID {shown} {when}")),
        Some(ObjectRole::BitRate) => ("bit-rate change", "RATE", format!("bit rate {shown} {when}")),
        _ => return,
    };
    emit_announcement(id, SettingAnnouncement { procedure: name, word, finished: false, text }, frame, cx);
}

/// Emits a change of node-ID or bit rate that no profile describes.
pub(in crate::session) fn emit_announcement(
    node: impl Into<Option<NodeId>>,
    change: SettingAnnouncement,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let status = if change.finished { ProcedureStatus::Ok } else { ProcedureStatus::Running };
    let event = ProcedureEvent {
        procedure: change.procedure.into(),
        word: Some(change.word.into()),
        phase: if change.finished { ProcedurePhase::Finished } else { ProcedurePhase::Started },
        status,
        duration: None,
        nominal: None,
        text: change.text,
        object: None,
        takes_over: false,
    };
    cx.emit_event(frame, node, false, EventKind::Procedure(Box::new(event)));
}

/// Whether a trigger of a procedure is met by an event.
fn is_awaited(trigger: &ProfileTrigger, event: &TriggerEvent<'_>) -> bool {
    !trigger.is_of_rules() && trigger.is_met_by(event)
}

pub(super) fn procedure_event(
    procedure: &DeviceProcedure,
    phase: ProcedurePhase,
    status: ProcedureStatus,
) -> ProcedureEvent {
    ProcedureEvent {
        procedure: procedure.name.clone(),
        word: procedure.word.clone(),
        phase,
        status,
        duration: None,
        nominal: procedure.seconds,
        text: String::new(),
        object: match &procedure.start {
            ProfileTrigger::Write(object, _) => Some(object.object),
            _ => None,
        },
        takes_over: procedure.takes_over,
    }
}
