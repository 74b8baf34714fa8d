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

/// Signals of a payload with a known layout; added after `data`.
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

/// One signal: its field, raw bits and value.
pub(crate) fn signal(layout: &Layout, (field, raw, value): (&Field, u64, &Value), fields: &mut dyn Fields) {
    fields.open("");
    signal_id(field.id, fields);
    fields.field("name", field.name().map_or(FieldValue::Null, FieldValue::Text));
    fields.field("raw", FieldValue::Unsigned(raw));
    match field.meaning.as_deref() {
        Some(meaning) => meant(meaning, value, fields),
        None => value_field("value", value, fields),
    }
    fields.field("origin", FieldValue::Text(layout.origin.name()));
    if layout.assumed || field.meaning.as_deref().is_some_and(|meaning| meaning.assumed) {
        fields.field("assumed", FieldValue::Bool(true));
    }
    fields.close();
}

/// Object address or SPN of a signal.
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

/// Value in engineering units, with unit and label; null for a special value. The label of a bit field is the
/// text of its bits.
pub(super) fn meant(meaning: &Meaning, value: &Value, fields: &mut dyn Fields) {
    fields.field("value", quantity(Some(meaning), value));
    if !meaning.unit.is_empty() {
        fields.field("unit", FieldValue::Text(&meaning.unit));
    }
    if let Some(label) = meaning.description(value) {
        fields.field("label", FieldValue::Text(&label));
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

/// Value in its unit; null for a special value, and for a quantity that is not available.
pub(crate) fn quantity<'a>(meaning: Option<&Meaning>, value: &'a Value) -> FieldValue<'a> {
    let Some(meaning) = meaning else { return plain(value) };
    match meaning.scaled(value) {
        Some(quantity) => FieldValue::Real(rounded_to(quantity, digits(meaning))),
        None if meaning.scale.is_some() && meaning.label(value).is_some() => FieldValue::Null,
        None if meaning.scale.is_some_and(|scale| scale.is_reciprocal) => FieldValue::Null,
        None if !meaning.unit.is_empty() && meaning.has_no_value(value) => FieldValue::Null,
        None => plain(value),
    }
}

/// Removes the rounding errors of scaling; no device resolves less than a millionth.
pub(super) fn rounded(quantity: f64) -> f64 {
    rounded_to(quantity, DIGITS)
}

/// Decimals of rounded quantities.
const DIGITS: u8 = 6;

/// Decimals of a meaning; more than [`DIGITS`] if its profile requires them.
pub(crate) fn digits(meaning: &Meaning) -> u8 {
    meaning.digits.max(DIGITS)
}

/// Scaled quantities from this value on are not rounded: `f64` has no decimals left.
pub(crate) const UNROUNDED: f64 = 1e15;

/// Rounds to `digits` decimals, if the precision of `f64` allows it.
fn rounded_to(quantity: f64, digits: u8) -> f64 {
    let unit = 10_f64.powi(i32::from(digits));
    let shifted = quantity * unit;
    // Adding 0.0 turns -0.0 into 0.0.
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
    sdo_data(transfer, fields);
    fields.field("duration", transfer.duration.map_or(FieldValue::Null, FieldValue::Seconds));
    fields.field("outcome", FieldValue::Text(transfer.outcome.name()));
    if let Some(effect) = transfer.effect {
        fields.field("effective", FieldValue::Text(effect.name()));
    }
    if let Some(persists) = transfer.persists {
        fields.field("persists", FieldValue::Text(persists.name()));
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
    exchange_order(transfer, fields);
    cut(transfer.cut_start, transfer.cut_end, fields);
    if transfer.truncated {
        fields.field("truncated", FieldValue::Bool(true));
    }
}

/// Properties of requests and responses that do not alternate.
fn exchange_order(transfer: &SdoTransfer, fields: &mut dyn Fields) {
    if let Some(overlap) = transfer.overlap {
        fields.field("next_request", FieldValue::Seconds(overlap));
    }
    if transfer.retries > 0 {
        fields.field("retries", FieldValue::Unsigned(u64::from(transfer.retries)));
    }
    for (key, is_set) in [("ambiguous", transfer.is_ambiguous), ("unrequested", transfer.is_unrequested)] {
        if is_set {
            fields.field(key, FieldValue::Bool(true));
        }
    }
}

/// Data of a transfer; with its positions if the capture lacks some.
fn sdo_data(transfer: &SdoTransfer, fields: &mut dyn Fields) {
    fields.field("data", FieldValue::Bytes(&transfer.data));
    if transfer.unseen > 0 {
        fields.field("seen", FieldValue::Unsigned(transfer.seen()));
        fields.open_list("data_ranges");
        for (offset, data) in transfer.ranges() {
            fields.open("");
            fields.field("offset", FieldValue::Unsigned(offset));
            fields.field("data", FieldValue::Bytes(data));
            fields.close();
        }
        fields.close_list();
    }
    if transfer.missing_segments > 0 {
        fields.field("missing_segments", FieldValue::Unsigned(transfer.missing_segments));
    }
    if transfer.losses > 0 {
        fields.field("lost_blocks", FieldValue::Unsigned(transfer.losses));
    }
}

/// Missing part of a transfer that the capture cuts off.
pub(super) fn cut(start: bool, end: bool, fields: &mut dyn Fields) {
    match (start, end) {
        (true, true) => fields.field("cut", FieldValue::Text("both")),
        (true, false) => fields.field("cut", FieldValue::Text("start")),
        (false, true) => fields.field("cut", FieldValue::Text("end")),
        (false, false) => {}
    }
}

/// Name and value of the object, if it is known and the data is complete.
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

/// Name of the direction in all output.
pub const fn direction(direction: Direction) -> &'static str {
    match direction {
        Direction::Upload => "upload",
        Direction::Download => "download",
    }
}

/// Name of the transfer mode in all output.
pub const fn mode(mode: Mode) -> &'static str {
    match mode {
        Mode::Expedited => "expedited",
        Mode::Segmented => "segmented",
        Mode::Block => "block",
    }
}
