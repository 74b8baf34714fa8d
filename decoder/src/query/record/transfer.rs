//! Fields of PDOs and SDO transfers.

use super::field::{FieldValue, Fields, number_or_null};
use crate::event::{Direction, Mode, Pdo, SdoTransfer};
use crate::profile::{self, Device, Field, Layout, Meaning, Signal, SignalId, Value};
use crate::wire::canopen::ObjectAddress;

pub(super) fn process_data(pdo: &Pdo, fields: &mut dyn Fields) {
    fields.field("pdo", FieldValue::Text(&pdo.name.to_string()));
    fields.field("cob_id", FieldValue::Id(pdo.cob_id));
    if pdo.is_request {
        fields.field("request", FieldValue::Bool(true));
        fields.field("size", FieldValue::Unsigned(u64::from(pdo.length)));
        return;
    }
    fields.field("data", FieldValue::Bytes(pdo.payload()));
    if let Some(layout) = pdo.layout.as_deref().filter(|_| fields.wants_signals()) {
        signals(layout, pdo.payload(), fields);
    }
}

/// The values of a payload whose layout is known: the last of its fields, behind `data`.
pub(crate) fn signals(layout: &Layout, payload: &[u8], fields: &mut dyn Fields) {
    fields.open_list("signals");
    for Signal { field, raw, value } in layout.signals(payload) {
        signal(layout, (field, raw, &value), fields);
    }
    fields.close_list();
    if usize::from(layout.bits.div_ceil(8)) > payload.len() {
        fields.open_list("missing");
        for object in layout.missing(payload).filter_map(Field::object) {
            fields.field("", FieldValue::Object(object));
        }
        fields.close_list();
    }
}

/// One of them: its field, the bits of its value, and the value.
pub(crate) fn signal(layout: &Layout, (field, raw, value): (&Field, u64, &Value), fields: &mut dyn Fields) {
    fields.open("");
    signal_id(field.id, fields);
    fields.field("name", field.name().map_or(FieldValue::Null, FieldValue::Text));
    fields.field("raw", FieldValue::Unsigned(raw));
    match field.meaning.as_deref() {
        Some(meaning) => meant(meaning, value, fields),
        None => value_field("value", value, fields),
    }
    fields.field("origin", FieldValue::Text(layout.origin));
    if layout.assumed || field.meaning.as_deref().is_some_and(|meaning| meaning.assumed) {
        fields.field("assumed", FieldValue::Bool(true));
    }
    fields.close();
}

/// The object, or the SPN.
fn signal_id(id: SignalId, fields: &mut dyn Fields) {
    match id {
        SignalId::Object(object) => fields.field("id", FieldValue::Object(object)),
        SignalId::Spn(spn) => {
            fields.field("id", FieldValue::Null);
            fields.field("spn", FieldValue::Unsigned(u64::from(spn)));
        }
        SignalId::Name => fields.field("id", FieldValue::Null),
    }
}

/// The value in engineering units, with unit and name; `null` where it is no quantity but a special value.
pub(super) fn meant(meaning: &Meaning, value: &Value, fields: &mut dyn Fields) {
    let (told, label) = quantity(Some(meaning), value);
    fields.field("value", told);
    if !meaning.unit.is_empty() {
        fields.field("unit", FieldValue::Text(&meaning.unit));
    }
    if let Some(label) = label {
        fields.field("label", FieldValue::Text(label));
    }
    if let (Some(bits), Some(word)) = (meaning.bits.as_deref(), profile::word(value)) {
        fields.open_list("bits");
        for bit in bits.list.iter().filter(|bit| !bit.reserved && bit.width == 1 && bit.of(word) == 1) {
            fields.field("", FieldValue::Text(&bit.name));
        }
        fields.close_list();
    }
    if meaning.is_outside(value) {
        fields.field("outside", FieldValue::Bool(true));
    }
}

/// A value in its unit, and the name it has; null where it is no quantity but a special value.
pub(crate) fn quantity<'a>(
    meaning: Option<&'a Meaning>,
    value: &'a Value,
) -> (FieldValue<'a>, Option<&'a str>) {
    let Some(meaning) = meaning else { return (plain(value), None) };
    let label = meaning.label(value);
    let told = match meaning.scaled(value) {
        Some(quantity) => FieldValue::Real(rounded_to(quantity, digits(meaning))),
        None if meaning.scale.is_some() && label.is_some() => FieldValue::Null,
        None => plain(value),
    };
    (told, label)
}

/// Without the digits that scaling makes: a millionth is finer than any device resolves.
pub(super) fn rounded(quantity: f64) -> f64 {
    rounded_to(quantity, DIGITS)
}

/// Digits behind the point that quantities are rounded to.
const DIGITS: u8 = 6;

/// The same of a meaning whose values may have more.
pub(crate) fn digits(meaning: &Meaning) -> u8 {
    meaning.digits.max(DIGITS)
}

/// From here on a quantity has no digits behind the point that could be trusted.
pub(crate) const UNROUNDED: f64 = 1e15;

/// With so many digits after the point, unless those before it leave no room for as many.
fn rounded_to(quantity: f64, digits: u8) -> f64 {
    let unit = 10_f64.powi(i32::from(digits));
    let shifted = quantity * unit;
    // Less than half a unit below zero is no "-0".
    if shifted.abs() < UNROUNDED { shifted.round() / unit + 0.0 } else { quantity }
}

pub(super) fn value_field(key: &'static str, value: &Value, fields: &mut dyn Fields) {
    fields.field(key, plain(value));
}

fn plain(value: &Value) -> FieldValue<'_> {
    match value {
        Value::Unsigned(value) => FieldValue::Unsigned(*value),
        Value::Integer(value) => FieldValue::Integer(*value),
        Value::Real(value) => FieldValue::Real(*value),
        Value::Text(text) => FieldValue::Text(text),
        Value::Bytes(bytes) => FieldValue::Bytes(bytes),
    }
}

pub(super) fn sdo_transfer(transfer: &SdoTransfer, device: &Device, fields: &mut dyn Fields) {
    fields.field("client", number_or_null(transfer.client));
    fields.open_list("cob_ids");
    fields.field("", FieldValue::Id(transfer.request));
    fields.field("", FieldValue::Id(transfer.response));
    fields.close_list();
    fields.field(
        "direction",
        transfer.direction.map_or(FieldValue::Null, |way| FieldValue::Text(direction(way))),
    );
    fields.field("mode", transfer.mode.map_or(FieldValue::Null, |how| FieldValue::Text(mode(how))));
    match transfer.object {
        Some(object) => sdo_object(transfer, object, fields),
        None => fields.field("object", FieldValue::Null),
    }
    fields.field("size", FieldValue::Unsigned(transfer.size));
    if let Some(announced) = transfer.announced {
        fields.field("announced", FieldValue::Unsigned(u64::from(announced)));
    }
    fields.field("data", FieldValue::Bytes(&transfer.data));
    fields.field("duration", transfer.duration.map_or(FieldValue::Null, FieldValue::Seconds));
    fields.field("outcome", FieldValue::Text(transfer.outcome.name()));
    if let Some(effect) = transfer.effect {
        fields.field("effective", FieldValue::Text(effect.name()));
    }
    if let Some(persists) = transfer.persists {
        fields.field("persists", FieldValue::Text(persists));
    }
    if let Some(abort) = transfer.abort {
        fields.open("abort");
        fields.field("code", FieldValue::Code(u64::from(abort.code), 8));
        fields.field("by", FieldValue::Text(if abort.by_client { "client" } else { "server" }));
        fields.field("text", FieldValue::Text(profile::abort_codes().text(abort.code)));
        if let Some(own) = device.abort(abort.code, transfer.object) {
            fields.field("device_text", FieldValue::Text(&own.text));
        }
        fields.close();
    }
    if let Some(crc) = transfer.crc {
        fields.field("crc", FieldValue::Text(crc.name()));
    }
    if let Some(irregularity) = transfer.irregularity {
        fields.open("irregularity");
        fields.field("what", FieldValue::Text(irregularity.what.name()));
        fields.field("by", FieldValue::Text(if irregularity.by_client { "client" } else { "server" }));
        fields.field("frame", FieldValue::Unsigned(irregularity.frame));
        fields.close();
    }
    cut(transfer.cut_start, transfer.cut_end, fields);
    if transfer.truncated {
        fields.field("truncated", FieldValue::Bool(true));
    }
}

/// Which end of a transfer the capture lacks.
pub(super) fn cut(start: bool, end: bool, fields: &mut dyn Fields) {
    match (start, end) {
        (true, true) => fields.field("cut", FieldValue::Text("both")),
        (true, false) => fields.field("cut", FieldValue::Text("start")),
        (false, true) => fields.field("cut", FieldValue::Text("end")),
        (false, false) => {}
    }
}

/// Name and value of the object, where it is known and the data is whole.
fn sdo_object(transfer: &SdoTransfer, object: ObjectAddress, fields: &mut dyn Fields) {
    fields.field("object", FieldValue::Object(object));
    let Some(meaning) = &transfer.meaning else { return };
    fields.field("name", FieldValue::Text(&meaning.name));
    if transfer.data.is_empty() || transfer.truncated {
        return;
    }
    let value = meaning.decode(&transfer.data);
    if !matches!(value, Value::Bytes(_)) {
        meant(meaning, &value, fields);
    }
}

/// The name used in all output.
pub const fn direction(direction: Direction) -> &'static str {
    match direction {
        Direction::Upload => "upload",
        Direction::Download => "download",
    }
}

/// The name used in all output.
pub const fn mode(mode: Mode) -> &'static str {
    match mode {
        Mode::Expedited => "expedited",
        Mode::Segmented => "segmented",
        Mode::Block => "block",
    }
}
