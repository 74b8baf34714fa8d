//! Behaviour of a device as its manual describes it: path of a PDO to states, set points and procedures.
//!
//! ```text
//! PDO ─plan─▶ watched fields ─changed?─▶ control, status, bits, modes ─▶ set points, procedures
//! ```

use std::sync::Arc;

use super::bits::{bits_changed, update_mode};
use super::changed::FieldChange;
use super::machine::{assign_control_slot, control_changed, status_changed};
use super::procedure::{
    advance_procedures, advance_procedures_by_bits, advance_procedures_by_message,
    advance_procedures_by_object, announce_written_change,
};
use super::procedure_status::on_status_read;
use super::set_point::{reassess_set_points, set_points_changed};
use crate::event::{DecodedPdo, EventKind, J1939Message};
use crate::frame::Frame;
use crate::profile::device::TriggerEvent;
use crate::profile::{ObjectRole, PayloadLayout, PdoDirection, ValueCarrier};
use crate::session::bus::{Bus, FrameMoment, OriginKind, ShortPayload, StoredOrigin, WatchPlan};
use crate::session::context::MachineContext;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::nmt::NmtService;

/// Evaluates a PDO or message with watched fields.
#[cold]
pub(in crate::session) fn on_values(
    slot: usize,
    (carrier, direction): (&ValueCarrier, PdoDirection),
    id: NodeId,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(entry) = cx.bus.routes.slot(slot) else { return };
    let (Some(event), Some(planned)) = (entry.prepared.as_deref(), &entry.plan) else { return };
    let plan = Arc::clone(&planned.plan);
    let layout = match &event.kind {
        EventKind::Pdo(DecodedPdo { layout: Some(layout), is_request: false, .. })
        | EventKind::J1939Message(J1939Message { layout: Some(layout), .. }) => Arc::clone(layout),
        _ => return,
    };
    let short = missing_bytes((carrier, direction), &layout, frame);
    if short.is_some_and(|it| !it.assumed) {
        // The device does not process it (CiA 301 §7.2.2.3).
        set_points_changed(id, carrier, (&layout, short), &plan, frame, cx);
        return;
    }
    let Some(node) = cx.bus.node(id) else { return };
    let device = Arc::clone(&node.device);
    let mut set_points = node.behaviour.has_short_payload(carrier);
    let mut gates = false;
    for watched in &plan.fields {
        let Some(field) = layout.fields.get(watched.place) else { continue };
        let (Some(meaning), Some(raw)) = (&field.meaning, field.extract_bits(frame.data())) else { continue };
        if plan.commands {
            assign_control_slot(&mut cx.bus, id, &device, watched.object, slot);
        }
        let Some(node) = cx.bus.nodes.node_mut(id) else { return };
        let before = node.behaviour.note_value(watched.object, raw);
        if before == Some(raw) {
            continue;
        }
        let decides = watched.decides && matches!(carrier, ValueCarrier::Message(_));
        let is_set_point = meaning.role == Some(ObjectRole::SetPoint) || decides;
        set_points |= is_set_point && direction == PdoDirection::Receive;
        gates |= watched.is_gate;
        let object = watched.object;
        let changed = FieldChange { id, device: &device, field, object, meaning, before, raw };
        if watched.decides {
            store_sample(&mut cx.bus, &changed, frame);
        }
        field_changed(&changed, frame, cx);
    }
    if set_points {
        set_points_changed(id, carrier, (&layout, short), &plan, frame, cx);
    }
    if gates {
        reassess_set_points(id, frame, cx);
    }
    if plan.triggers {
        advance_procedures_by_message(id, carrier, frame, cx);
        repeated_bits(id, &layout, &plan, frame, cx);
    }
}

/// Length of an RPDO with less data than its mapping.
fn missing_bytes(
    (carrier, direction): (&ValueCarrier, PdoDirection),
    layout: &PayloadLayout,
    frame: &Frame,
) -> Option<ShortPayload> {
    let (ValueCarrier::Pdo(_), PdoDirection::Receive) = (carrier, direction) else { return None };
    let (bytes, needed) = (u8::try_from(frame.data().len()).ok()?, layout.bits.div_ceil(8));
    (u16::from(bytes) < needed).then_some(ShortPayload { bytes, needed, assumed: layout.assumed })
}

fn field_changed(changed: &FieldChange<'_>, frame: &Frame, cx: &mut MachineContext<'_>) {
    let object = changed.object;
    control_changed(&mut cx.bus, changed);
    if changed.meaning.role == Some(ObjectRole::Mode) {
        update_mode(changed.id, object, frame, cx);
    }
    let bits_before = changed.before;
    bits_changed(changed, frame, cx);
    status_changed(changed, frame, cx);
    advance_procedures_by_bits(changed.id, object, bits_before, changed.raw, frame, cx);
}

/// Stores a PDO value that decides how other objects are decoded.
fn store_sample(bus: &mut Bus, changed: &FieldChange<'_>, frame: &Frame) {
    let length = usize::from(changed.field.bits.div_ceil(8));
    let bytes = changed.raw.to_le_bytes();
    let Some(node) = bus.nodes.node_mut(changed.id) else { return };
    let origin = StoredOrigin { kind: OriginKind::Pdo, frame: frame.number, time: frame.time };
    let bytes = bytes.get(..length).unwrap_or(&bytes);
    if Arc::make_mut(&mut node.store).set(changed.object, bytes, origin).is_ok() {
        bus.routes.refresh_dependents(changed.id, changed.object);
    }
}

/// Evaluates bits that were already set as set again, in a PDO that is sent once per occurrence: they may
/// start a procedure.
fn repeated_bits(
    id: NodeId,
    layout: &PayloadLayout,
    plan: &WatchPlan,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    if !plan.once_an_occasion {
        return;
    }
    for watched in &plan.fields {
        let Some(field) = layout.fields.get(watched.place) else { continue };
        let Some(raw) = field.extract_bits(frame.data()) else { continue };
        advance_procedures_by_bits(id, watched.object, Some(0), raw, frame, cx);
    }
}

/// Applies an EMCY: it may be the cause of a state, or change the effect of set points.
pub(in crate::session) fn on_emcy_code(id: NodeId, code: u16, frame: &Frame, cx: &mut MachineContext<'_>) {
    let time = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    if code != 0 {
        node.behaviour.emcy = Some(FrameMoment { what: code, frame: frame.number, time });
    }
    advance_procedures(id, &TriggerEvent::Emcy(code), frame, cx);
    reassess_set_points(id, frame, cx);
}

/// Applies a trouble code that was raised or recurred.
pub(in crate::session) fn on_trouble_code(
    id: NodeId,
    code: (u32, u8),
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let time = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    node.behaviour.dtc = Some(FrameMoment { what: code, frame: frame.number, time });
    advance_procedures(id, &TriggerEvent::Dtc(code.0, code.1), frame, cx);
    reassess_set_points(id, frame, cx);
}

/// Applies an NMT command.
pub(in crate::session) fn on_nmt_service(
    id: NodeId,
    service: NmtService,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let time = cx.bus.clock.now();
    let Some(node) = cx.bus.nodes.node_mut(id) else { return };
    let [first, second, _] = node.behaviour.nmt;
    node.behaviour.nmt = [Some(FrameMoment { what: service, frame: frame.number, time }), first, second];
    advance_procedures(id, &TriggerEvent::Nmt(service.name()), frame, cx);
}

/// Resets the device state at a boot: procedures end, set points are removed.
pub(in crate::session) fn on_device_restart(bus: &mut Bus, id: NodeId, frame: &Frame) {
    let time = bus.clock.now();
    let Some(node) = bus.nodes.node_mut(id) else { return };
    node.behaviour.boot = Some(FrameMoment { what: (), frame: frame.number, time });
    node.behaviour.interrupt_procedures(frame.number);
    node.behaviour.set_points.clear();
    node.behaviour.sync_queued = false;
    node.behaviour.words.clear();
    for machine in &mut node.behaviour.machines {
        machine.is_old = true;
    }
}

/// Applies a complete transfer of an object.
pub(in crate::session) fn on_object_transfer(
    id: NodeId,
    object: ObjectAddress,
    value: &[u8],
    kind: OriginKind,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(node) = cx.bus.node(id).filter(|node| node.assigned.is_some()) else { return };
    let is_mode = node.meaning(object).is_some_and(|meaning| meaning.role == Some(ObjectRole::Mode));
    if is_mode {
        update_mode(id, object, frame, cx);
    }
    announce_written_change(id, object, value, kind, frame, cx);
    advance_procedures_by_object(id, object, value, kind, frame, cx);
    if kind == OriginKind::Upload {
        on_status_read(id, object, value, frame, cx);
    }
    let is_cob_id = matches!((object.index, object.sub), (0x1400..=0x15FF, 1));
    let decides = cx.bus.node(id).is_some_and(|node| node.device.gates_on(object));
    if decides || is_cob_id {
        reassess_set_points(id, frame, cx);
    }
}
