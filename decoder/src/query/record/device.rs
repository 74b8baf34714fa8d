//! Fields of device events.

use super::transfer::rounded;
use super::{FieldValue, Fields};
use crate::event::{
    BitsChanged, Conflict, DeviceState, ModeChange, NodeIdentified, ObjectChange, ProcedureEvent, Quantity,
    SetPoint,
};
use crate::profile::Carrier;

fn texts(key: &'static str, list: &[String], fields: &mut dyn Fields) {
    fields.open_list(key);
    for text in list {
        fields.field("", FieldValue::Text(text));
    }
    fields.close_list();
}

fn channel(channel: Option<u8>, fields: &mut dyn Fields) {
    if let Some(channel) = channel {
        fields.field("channel", FieldValue::Unsigned(u64::from(channel)));
    }
}

pub(super) fn node_identified(node: &NodeIdentified, fields: &mut dyn Fields) {
    fields.field("title", FieldValue::Text(&node.title));
    fields.field("by", FieldValue::Text(node.by.name()));
}

pub(super) fn device_state(state: &DeviceState, fields: &mut dyn Fields) {
    fields.field("machine", FieldValue::Text(&state.machine));
    channel(state.channel, fields);
    fields.field("from", state.from.as_deref().map_or(FieldValue::Null, FieldValue::Text));
    fields.field("to", FieldValue::Text(&state.to));
    if state.fault {
        fields.field("fault", FieldValue::Bool(true));
    }
    fields.field("cause", FieldValue::Text(state.cause.name()));
    if state.cause_frame != 0 {
        fields.field("cause_frame", FieldValue::Unsigned(state.cause_frame));
    }
    if let Some(code) = state.emcy {
        fields.field("code", FieldValue::Code(u64::from(code), 4));
    }
    if let Some(leave) = &state.leave {
        fields.field("leave", FieldValue::Text(leave));
    }
    if let Some(control) = state.control {
        fields.field("control", FieldValue::Code(control, 4));
    }
    if let Some(path) = &state.path {
        texts("path", &path.states, fields);
        fields.open_list("path_frames");
        for frame in &path.frames {
            fields.field("", FieldValue::Unsigned(*frame));
        }
        fields.close_list();
        fields.field("duration", path.duration.map_or(FieldValue::Null, FieldValue::Seconds));
    }
}

pub(super) fn bits_changed(bits: &BitsChanged, fields: &mut dyn Fields) {
    fields.field("object", FieldValue::Object(bits.object));
    fields.field("name", FieldValue::Text(&bits.name));
    channel(bits.channel, fields);
    texts("set", &bits.set, fields);
    texts("cleared", &bits.cleared, fields);
    texts("texts", &bits.words, fields);
}

pub(super) fn set_point(point: &SetPoint, fields: &mut dyn Fields) {
    let number = |quantity: &Quantity| {
        quantity.number.map_or(FieldValue::Null, |number| FieldValue::Real(rounded(number)))
    };
    fields.field("object", FieldValue::Object(point.object));
    fields.field("signal", FieldValue::Text(&point.signal));
    channel(point.channel, fields);
    match &point.carrier {
        Carrier::Pdo(name) => fields.field("pdo", FieldValue::Text(&name.to_string())),
        Carrier::Message(name) => fields.field("message", FieldValue::Text(name)),
    }
    fields.field("from", point.from.as_ref().map_or(FieldValue::Null, number));
    fields.field("value", number(&point.to));
    if !point.unit.is_empty() {
        fields.field("unit", FieldValue::Text(&point.unit));
    }
    if point.to.number.is_none() {
        fields.field("label", FieldValue::Text(&point.to.text));
    }
    if point.assumed {
        fields.field("assumed", FieldValue::Bool(true));
    }
    fields.field("effective", FieldValue::Text(point.effective.name()));
    if let Some(gate) = point.gates.first() {
        fields.field("gate", FieldValue::Text(gate));
        texts("gates", &point.gates, fields);
    }
    if let Some(after) = point.sync_after {
        fields.field("sync_after", FieldValue::Seconds(after));
    }
}

pub(super) fn mode_change(mode: &ModeChange, fields: &mut dyn Fields) {
    fields.field("object", FieldValue::Object(mode.object));
    fields.field("name", FieldValue::Text(&mode.name));
    channel(mode.channel, fields);
    fields.field("from", mode.from.as_deref().map_or(FieldValue::Null, FieldValue::Text));
    fields.field("to", FieldValue::Text(&mode.to));
    if !mode.consequence.is_empty() {
        fields.field("consequence", FieldValue::Text(&mode.consequence));
    }
}

pub(super) fn procedure(event: &ProcedureEvent, fields: &mut dyn Fields) {
    fields.field("procedure", FieldValue::Text(&event.procedure));
    fields.field("step", FieldValue::Text(event.phase.name()));
    fields.field("status", FieldValue::Text(event.status.name()));
    if let Some(duration) = event.duration {
        fields.field("duration", FieldValue::Seconds(duration));
    }
    if !event.text.is_empty() {
        fields.field("text", FieldValue::Text(&event.text));
    }
    if let Some(object) = event.object {
        fields.field("object", FieldValue::Object(object));
    }
}

pub(super) fn conflict(conflict: &Conflict, fields: &mut dyn Fields) {
    fields.field("object", FieldValue::Object(conflict.object));
    fields.field("name", FieldValue::Text(&conflict.name));
    fields.open_list("sources");
    for (source, value) in &conflict.sources {
        fields.open("");
        fields.field("source", FieldValue::Text(source));
        fields.field("data", FieldValue::Bytes(value));
        fields.close();
    }
    fields.close_list();
    fields.field("text", FieldValue::Text(&conflict.text));
}

pub(super) fn object_change(change: &ObjectChange, fields: &mut dyn Fields) {
    fields.field("object", FieldValue::Object(change.object));
    fields.field("from", change.from.as_deref().map_or(FieldValue::Null, FieldValue::Bytes));
    fields.field("to", change.to.as_deref().map_or(FieldValue::Null, FieldValue::Bytes));
    fields.field("origin", FieldValue::Text(change.origin.name()));
    if let Some(effect) = change.effect {
        fields.field("effective", FieldValue::Text(effect.name()));
    }
    if let Some(persists) = change.persists {
        fields.field("persists", FieldValue::Text(persists.name()));
    }
}
