//! Outcome of procedures that report it in a status object, whenever it is read.

use std::sync::Arc;

use super::procedure::{finish_procedure, procedure_event, start_procedure};
use super::set_point::reassess_set_points;
use crate::event::{EventKind, ProcedurePhase};
use crate::frame::Frame;
use crate::profile::device::{DeviceProcedure, ProcedureStatus, StatusCode};
use crate::profile::little_endian;
use crate::session::bus::{Bus, ProcedureResult, RunningProcedure};
use crate::session::context::MachineContext;
use crate::session::objects::set_fallback;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Applies a value that was read from an object, which may be the status of procedures.
pub(super) fn on_status_read(
    id: NodeId,
    object: ObjectAddress,
    value: &[u8],
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(device) = cx.bus.node(id).map(|node| Arc::clone(&node.device)) else { return };
    let word = little_endian(value);
    for (place, procedure) in device.procedures.iter().enumerate() {
        let Some(status) = procedure.status.as_ref().filter(|it| it.object.object == object) else {
            continue;
        };
        let Some(code) = device.codes.get(&status.codes).and_then(|codes| codes.find_code(word)) else {
            continue;
        };
        on_procedure_status(id, (place, procedure), code, frame, cx);
    }
}

/// Applies a status that the device reported.
fn on_procedure_status(
    id: NodeId,
    (place, procedure): (usize, &DeviceProcedure),
    code: &StatusCode,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.node(id) else { return };
    let runs = node.behaviour.running.iter().any(|running| running.place == place);
    let last = node.behaviour.results.iter().find(|result| result.place == place).cloned();
    match (code.outcome, last) {
        (ProcedureStatus::Running, _) if runs => {}
        (outcome, _) if runs => {
            finish_procedure(id, place, procedure, outcome, &code.text, frame, cx);
            confirm_result(id, place, procedure, outcome, None, frame, &mut cx.bus);
        }
        (ProcedureStatus::Running, Some(last)) if !last.is_read => {
            resume_procedure(id, procedure, &last, frame, cx);
        }
        // If the capture started during the procedure, only its status shows it.
        (ProcedureStatus::Running, _) => start_procedure(id, place, procedure, frame, cx),
        (outcome, Some(last)) => on_late_status(id, procedure, &last, (outcome, &code.text), frame, cx),
        (ProcedureStatus::Error, None) => on_earlier_failure(id, (place, procedure), &code.text, frame, cx),
        _ => {}
    }
}

/// Continues a procedure that a bit reported as ended, while its status still reports it as running. After a
/// stop command the device needs time until the status changes.
fn resume_procedure(
    id: NodeId,
    procedure: &DeviceProcedure,
    last: &ProcedureResult,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let (ProcedureStatus::Ended, Some(started)) = (last.outcome, last.started) else { return };
    node.behaviour.results.retain(|result| result.place != last.place);
    node.behaviour.running.push(RunningProcedure { place: last.place, started, step: None, streak: 0 });
    if procedure.takes_over {
        reassess_set_points(id, frame, cx);
    }
}

/// Applies a status that was read after the end. It overrides an outcome derived from bits; a failure also
/// overrides an earlier status.
fn on_late_status(
    id: NodeId,
    procedure: &DeviceProcedure,
    last: &ProcedureResult,
    (outcome, text): (ProcedureStatus, &str),
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let is_new = outcome != last.outcome && (!last.is_read || outcome == ProcedureStatus::Error);
    if is_new {
        let mut event = procedure_event(procedure, ProcedurePhase::Finished, outcome);
        text.clone_into(&mut event.text);
        cx.emit_event(frame, id, false, EventKind::Procedure(Box::new(event)));
    }
    let read_since = last.ended;
    confirm_result(id, last.place, procedure, outcome, Some(read_since), frame, &mut cx.bus);
}

/// Reports a failure without a start in the capture.
fn on_earlier_failure(
    id: NodeId,
    (place, procedure): (usize, &DeviceProcedure),
    text: &str,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let mut event = procedure_event(procedure, ProcedurePhase::FailedEarlier, ProcedureStatus::Error);
    text.clone_into(&mut event.text);
    cx.emit_event(frame, id, false, EventKind::Procedure(Box::new(event)));
    confirm_result(id, place, procedure, ProcedureStatus::Error, Some(0), frame, &mut cx.bus);
}

/// Stores a status that was read. After a failure the device has its default values, unless one was read
/// since: `read_since` is the frame with the end, None if only the status shows the end.
fn confirm_result(
    id: NodeId,
    place: usize,
    procedure: &DeviceProcedure,
    outcome: ProcedureStatus,
    read_since: Option<u64>,
    frame: &Frame,
    bus: &mut Bus,
) {
    let Some(node) = bus.nodes.node_mut(id) else { return };
    let results = &mut node.behaviour.results;
    let known = results.iter().find(|result| result.place == place);
    let is_repeated = known.is_some_and(|known| known.is_read && known.outcome == outcome);
    let (started, ended) = known.map_or((None, frame.number), |known| (known.started, known.ended));
    node.behaviour.set_result(ProcedureResult { place, started, ended, outcome, is_read: true });
    if is_repeated || outcome != ProcedureStatus::Error {
        return;
    }
    for fallback in &procedure.on_error {
        let object = fallback.object.object;
        let is_read = |since: u64| {
            let known = bus.node(id).and_then(|node| node.store().get(object));
            known.is_some_and(|known| !known.stale && known.origin.frame > since)
        };
        if !read_since.is_some_and(is_read) {
            set_fallback(bus, id, object, fallback.becomes, frame);
        }
    }
}
