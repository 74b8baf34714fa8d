//! Fields of device events.

use super::transfer::round_scaled;
use super::{FieldConsumer, FieldValue};
use crate::event::{
    BitsChanged, DeviceState, Event, ModeChange, NodeIdentified, ObjectChange, ProcedureEvent, Quantity,
    SetPoint, SourceConflict,
};
use crate::profile::{DeviceProfile, ValueCarrier, plain_device};
use crate::session::Bus;

/// Device of the event's node; the generic device if unknown.
pub(crate) fn event_device<'a>(event: &Event, bus: &'a Bus) -> &'a DeviceProfile {
    match event.node.and_then(|node| bus.node(node)) {
        Some(node) => node.device(),
        None => plain_device(),
    }
}

fn visit_texts(key: &'static str, list: &[String], fields: &mut dyn FieldConsumer) {
    fields.open_list(key);
    for text in list {
        fields.add_field("", FieldValue::Text(text));
    }
    fields.close_list();
}

fn visit_channel(channel: Option<u8>, fields: &mut dyn FieldConsumer) {
    if let Some(channel) = channel {
        fields.add_field("channel", FieldValue::Unsigned(u64::from(channel)));
    }
}

pub(super) fn node_identified(node: &NodeIdentified, fields: &mut dyn FieldConsumer) {
    fields.add_field("title", FieldValue::Text(&node.title));
    fields.add_field("by", FieldValue::Text(node.by.name()));
}

pub(super) fn device_state(state: &DeviceState, fields: &mut dyn FieldConsumer) {
    fields.add_field("machine", FieldValue::Text(&state.machine));
    visit_channel(state.channel, fields);
    fields.add_field("from", state.from.as_deref().map_or(FieldValue::Null, FieldValue::Text));
    fields.add_field("to", FieldValue::Text(&state.to));
    if state.fault {
        fields.add_field("fault", FieldValue::Bool(true));
    }
    fields.add_field("cause", FieldValue::Text(state.cause.name()));
    if state.cause_frame != 0 {
        fields.add_field("cause_frame", FieldValue::Unsigned(state.cause_frame));
    }
    if let Some(code) = state.emcy {
        fields.add_field("code", FieldValue::Code(u64::from(code), 4));
    }
    if let Some(leave) = &state.leave {
        fields.add_field("leave", FieldValue::Text(leave));
    }
    if let Some(control) = state.control {
        fields.add_field("control", FieldValue::Code(control, 4));
    }
    if let Some(path) = &state.path {
        visit_texts("path", &path.states, fields);
        fields.open_list("path_frames");
        for frame in &path.frames {
            fields.add_field("", FieldValue::Unsigned(*frame));
        }
        fields.close_list();
        fields.add_field("duration", path.duration.map_or(FieldValue::Null, FieldValue::Seconds));
    }
}

pub(super) fn bits_changed(bits: &BitsChanged, fields: &mut dyn FieldConsumer) {
    fields.add_field("object", FieldValue::Object(bits.object));
    fields.add_field("name", FieldValue::Text(&bits.name));
    visit_channel(bits.channel, fields);
    visit_texts("set", &bits.set, fields);
    visit_texts("cleared", &bits.cleared, fields);
    visit_texts("texts", &bits.words, fields);
}

pub(super) fn set_point(point: &SetPoint, fields: &mut dyn FieldConsumer) {
    let number = |quantity: &Quantity| {
        quantity.number.map_or(FieldValue::Null, |number| FieldValue::Real(round_scaled(number)))
    };
    fields.add_field("object", FieldValue::Object(point.object));
    fields.add_field("signal", FieldValue::Text(&point.signal));
    visit_channel(point.channel, fields);
    match &point.carrier {
        ValueCarrier::Pdo(name) => fields.add_field("pdo", FieldValue::Text(&name.to_string())),
        ValueCarrier::Message(name) => fields.add_field("message", FieldValue::Text(name)),
    }
    fields.add_field("from", point.from.as_ref().map_or(FieldValue::Null, number));
    fields.add_field("value", number(&point.to));
    if !point.unit.is_empty() {
        fields.add_field("unit", FieldValue::Text(&point.unit));
    }
    if point.to.number.is_none() {
        fields.add_field("label", FieldValue::Text(&point.to.text));
    }
    if point.assumed {
        fields.add_field("assumed", FieldValue::Bool(true));
    }
    fields.add_field("effective", FieldValue::Text(point.effective.name()));
    if let Some(gate) = point.gates.first() {
        fields.add_field("gate", FieldValue::Text(gate));
        visit_texts("gates", &point.gates, fields);
    }
    if !point.invisible.is_empty() {
        visit_texts("invisible", &point.invisible, fields);
    }
    if let Some(after) = point.sync_after {
        fields.add_field("sync_after", FieldValue::Seconds(after));
    }
}

pub(super) fn mode_change(mode: &ModeChange, fields: &mut dyn FieldConsumer) {
    fields.add_field("object", FieldValue::Object(mode.object));
    fields.add_field("name", FieldValue::Text(&mode.name));
    visit_channel(mode.channel, fields);
    fields.add_field("from", mode.from.as_deref().map_or(FieldValue::Null, FieldValue::Text));
    fields.add_field("to", FieldValue::Text(&mode.to));
    if !mode.consequence.is_empty() {
        fields.add_field("consequence", FieldValue::Text(&mode.consequence));
    }
}

pub(super) fn visit_procedure(event: &ProcedureEvent, fields: &mut dyn FieldConsumer) {
    fields.add_field("procedure", FieldValue::Text(&event.procedure));
    fields.add_field("step", FieldValue::Text(event.phase.name()));
    fields.add_field("status", FieldValue::Text(event.status.name()));
    if let Some(duration) = event.duration {
        fields.add_field("duration", FieldValue::Seconds(duration));
    }
    if !event.text.is_empty() {
        fields.add_field("text", FieldValue::Text(&event.text));
    }
    if let Some(object) = event.object {
        fields.add_field("object", FieldValue::Object(object));
    }
}

pub(super) fn visit_conflict(conflict: &SourceConflict, fields: &mut dyn FieldConsumer) {
    fields.add_field("object", FieldValue::Object(conflict.object));
    fields.add_field("name", FieldValue::Text(&conflict.name));
    fields.open_list("sources");
    for (source, value) in &conflict.sources {
        fields.open_group("");
        fields.add_field("source", FieldValue::Text(source));
        fields.add_field("data", FieldValue::Bytes(value));
        fields.close_group();
    }
    fields.close_list();
    fields.add_field("text", FieldValue::Text(&conflict.text));
}

pub(super) fn object_change(change: &ObjectChange, fields: &mut dyn FieldConsumer) {
    fields.add_field("object", FieldValue::Object(change.object));
    fields.add_field("from", change.from.as_deref().map_or(FieldValue::Null, FieldValue::Bytes));
    fields.add_field("to", change.to.as_deref().map_or(FieldValue::Null, FieldValue::Bytes));
    fields.add_field("origin", FieldValue::Text(change.origin.name()));
    if let Some(effect) = change.effect {
        fields.add_field("effective", FieldValue::Text(effect.name()));
    }
    if let Some(persists) = change.persists {
        fields.add_field("persists", FieldValue::Text(persists.name()));
    }
}
