//! Fields of PDOs and SDO transfers.

use super::field::{FieldConsumer, FieldValue, number_or_null};
use crate::event::{DecodedPdo, SdoDirection, SdoMode, SdoTransfer};
use crate::profile::{
    self, DecodedSignal, DecodedValue, DeviceProfile, ObjectMeaning, PayloadLayout, SignalField, SignalId,
};
use crate::wire::canopen::ObjectAddress;

pub(super) fn process_data(pdo: &DecodedPdo, fields: &mut dyn FieldConsumer) {
    fields.add_field("pdo", FieldValue::Text(&pdo.name.to_string()));
    fields.add_field("cob_id", FieldValue::Id(pdo.cob_id));
    if pdo.is_request {
        fields.add_field("request", FieldValue::Bool(true));
        fields.add_field("size", FieldValue::Unsigned(u64::from(pdo.length)));
        return;
    }
    fields.add_field("data", FieldValue::Bytes(pdo.payload()));
    if let Some(layout) = pdo.layout.as_deref().filter(|_| fields.wants_signals()) {
        visit_signals(layout, pdo.payload(), fields);
    }
}

/// Signals of a payload with a known layout; added after `data`.
pub(crate) fn visit_signals(layout: &PayloadLayout, payload: &[u8], fields: &mut dyn FieldConsumer) {
    fields.open_list("signals");
    for DecodedSignal { field, raw, value } in layout.decode_signals(payload) {
        visit_signal(layout, (field, raw, &value), fields);
    }
    fields.close_list();
    if usize::from(layout.bits.div_ceil(8)) > payload.len() {
        fields.open_list("missing");
        for object in layout.missing_fields(payload).filter_map(SignalField::object) {
            fields.add_field("", FieldValue::Object(object));
        }
        fields.close_list();
    }
}

/// One signal: its field, raw bits and value.
pub(crate) fn visit_signal(
    layout: &PayloadLayout,
    (field, raw, value): (&SignalField, u64, &DecodedValue),
    fields: &mut dyn FieldConsumer,
) {
    fields.open_group("");
    signal_id(field.id, fields);
    fields.add_field("name", field.name().map_or(FieldValue::Null, FieldValue::Text));
    if !field.is_text() {
        fields.add_field("raw", FieldValue::Unsigned(raw));
    }
    match field.meaning.as_deref() {
        Some(meaning) => visit_meaning(meaning, value, fields),
        None => value_field("value", value, fields),
    }
    fields.add_field("origin", FieldValue::Text(layout.origin.name()));
    if layout.assumed || field.meaning.as_deref().is_some_and(|meaning| meaning.assumed) {
        fields.add_field("assumed", FieldValue::Bool(true));
    }
    fields.close_group();
}

/// Object address or SPN of a signal.
fn signal_id(id: SignalId, fields: &mut dyn FieldConsumer) {
    match id {
        SignalId::Object(object) => fields.add_field("id", FieldValue::Object(object)),
        SignalId::Spn(spn) => {
            fields.add_field("id", FieldValue::Null);
            fields.add_field("spn", FieldValue::Unsigned(u64::from(spn)));
        }
        SignalId::Name => fields.add_field("id", FieldValue::Null),
    }
}

/// Value in engineering units, with unit and label; null for a special value. The label of a bit field is the
/// text of its bits.
pub(super) fn visit_meaning(meaning: &ObjectMeaning, value: &DecodedValue, fields: &mut dyn FieldConsumer) {
    fields.add_field("value", quantity_value(Some(meaning), value));
    if !meaning.unit.is_empty() {
        fields.add_field("unit", FieldValue::Text(&meaning.unit));
    }
    if let Some(label) = meaning.description(value) {
        fields.add_field("label", FieldValue::Text(&label));
    }
    if let (Some(bits), Some(word)) = (meaning.bits.as_deref(), profile::as_word(value)) {
        fields.open_list("bits");
        for bit in bits.list.iter().filter(|bit| !bit.reserved && bit.width == 1 && bit.bits_of(word) == 1) {
            fields.add_field("", FieldValue::Text(&bit.name));
        }
        fields.close_list();
    }
    if meaning.is_outside(value) {
        fields.add_field("outside", FieldValue::Bool(true));
    }
}

/// Value in its unit; null for a special value, and for a quantity that is not available.
pub(crate) fn quantity_value<'a>(meaning: Option<&ObjectMeaning>, value: &'a DecodedValue) -> FieldValue<'a> {
    let Some(meaning) = meaning else { return plain_value(value) };
    match meaning.scaled_value(value) {
        Some(quantity) => FieldValue::Real(rounded_to(quantity, decimal_digits(meaning))),
        None if meaning.scale.is_some() && meaning.value_label(value).is_some() => FieldValue::Null,
        None if meaning.scale.is_some_and(|scale| scale.is_reciprocal) => FieldValue::Null,
        None if !meaning.unit.is_empty() && meaning.has_no_value(value) => FieldValue::Null,
        None => plain_value(value),
    }
}

/// Removes the rounding errors of scaling; no device resolves less than a millionth.
pub(super) fn round_scaled(quantity: f64) -> f64 {
    rounded_to(quantity, DIGITS)
}

/// Decimals of rounded quantities.
const DIGITS: u8 = 6;

/// Decimals of a meaning; more than [`DIGITS`] if its profile requires them.
pub(crate) fn decimal_digits(meaning: &ObjectMeaning) -> u8 {
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

pub(super) fn value_field(key: &'static str, value: &DecodedValue, fields: &mut dyn FieldConsumer) {
    fields.add_field(key, plain_value(value));
}

fn plain_value(value: &DecodedValue) -> FieldValue<'_> {
    match value {
        DecodedValue::Unsigned(value) => FieldValue::Unsigned(*value),
        DecodedValue::Integer(value) => FieldValue::Integer(*value),
        DecodedValue::Real(value) => FieldValue::Real(*value),
        DecodedValue::Text(text) => FieldValue::Text(text),
        DecodedValue::Bytes(bytes) => FieldValue::Bytes(bytes),
    }
}

pub(super) fn sdo_transfer(transfer: &SdoTransfer, device: &DeviceProfile, fields: &mut dyn FieldConsumer) {
    fields.add_field("client", number_or_null(transfer.client));
    fields.open_list("cob_ids");
    fields.add_field("", FieldValue::Id(transfer.request));
    fields.add_field("", FieldValue::Id(transfer.response));
    fields.close_list();
    fields.add_field(
        "direction",
        transfer.direction.map_or(FieldValue::Null, |way| FieldValue::Text(direction_name(way))),
    );
    fields.add_field("mode", transfer.mode.map_or(FieldValue::Null, |how| FieldValue::Text(mode_name(how))));
    match transfer.object {
        Some(object) => sdo_object(transfer, object, fields),
        None => fields.add_field("object", FieldValue::Null),
    }
    fields.add_field("size", FieldValue::Unsigned(transfer.size));
    if let Some(announced) = transfer.announced {
        fields.add_field("announced", FieldValue::Unsigned(u64::from(announced)));
    }
    sdo_data(transfer, fields);
    fields.add_field("duration", transfer.duration.map_or(FieldValue::Null, FieldValue::Seconds));
    fields.add_field("outcome", FieldValue::Text(transfer.outcome.name()));
    if let Some(effect) = transfer.effect {
        fields.add_field("effective", FieldValue::Text(effect.name()));
    }
    if let Some(persists) = transfer.persists {
        fields.add_field("persists", FieldValue::Text(persists.name()));
    }
    if let Some(abort) = transfer.abort {
        fields.open_group("abort");
        fields.add_field("code", FieldValue::Code(u64::from(abort.code), 8));
        fields.add_field("by", FieldValue::Text(if abort.by_client { "client" } else { "server" }));
        fields.add_field("text", FieldValue::Text(profile::abort_codes().code_text(abort.code)));
        if let Some(own) = device.abort_entry(abort.code, transfer.object) {
            fields.add_field("device_text", FieldValue::Text(&own.text));
        }
        fields.close_group();
    }
    if let Some(crc) = transfer.crc {
        fields.add_field("crc", FieldValue::Text(crc.name()));
    }
    if let Some(irregularity) = transfer.irregularity {
        fields.open_group("irregularity");
        fields.add_field("what", FieldValue::Text(irregularity.what.name()));
        fields.add_field("by", FieldValue::Text(if irregularity.by_client { "client" } else { "server" }));
        fields.add_field("frame", FieldValue::Unsigned(irregularity.frame));
        fields.close_group();
    }
    exchange_order(transfer, fields);
    visit_cut(transfer.cut_start, transfer.cut_end, fields);
    if transfer.truncated {
        fields.add_field("truncated", FieldValue::Bool(true));
    }
}

/// Properties of requests and responses that do not alternate.
fn exchange_order(transfer: &SdoTransfer, fields: &mut dyn FieldConsumer) {
    if let Some(overlap) = transfer.overlap {
        fields.add_field("next_request", FieldValue::Seconds(overlap));
    }
    if transfer.retries > 0 {
        fields.add_field("retries", FieldValue::Unsigned(u64::from(transfer.retries)));
    }
    for (key, is_set) in [("ambiguous", transfer.is_ambiguous), ("unrequested", transfer.is_unrequested)] {
        if is_set {
            fields.add_field(key, FieldValue::Bool(true));
        }
    }
    if transfer.unrequested_responses > 0 {
        fields.add_field("unrequested_responses", FieldValue::Unsigned(transfer.unrequested_responses));
    }
    if let Some(misplaced) = transfer.misplaced {
        fields.open_group("misplaced");
        fields.add_field("id", FieldValue::Id(misplaced.id));
        fields.add_field("frame", FieldValue::Unsigned(misplaced.frame));
        fields.close_group();
    }
}

/// Data of a transfer; with its positions if the capture lacks some.
fn sdo_data(transfer: &SdoTransfer, fields: &mut dyn FieldConsumer) {
    fields.add_field("data", FieldValue::Bytes(&transfer.data));
    if transfer.unseen > 0 {
        fields.add_field("seen", FieldValue::Unsigned(transfer.captured_bytes()));
        fields.open_list("data_ranges");
        for (offset, data) in transfer.ranges() {
            fields.open_group("");
            fields.add_field("offset", FieldValue::Unsigned(offset));
            fields.add_field("data", FieldValue::Bytes(data));
            fields.close_group();
        }
        fields.close_list();
    }
    if transfer.missing_segments > 0 {
        fields.add_field("missing_segments", FieldValue::Unsigned(transfer.missing_segments));
    }
    if transfer.losses > 0 {
        fields.add_field("lost_blocks", FieldValue::Unsigned(transfer.losses));
    }
}

/// Missing part of a transfer that the capture cuts off.
pub(super) fn visit_cut(start: bool, end: bool, fields: &mut dyn FieldConsumer) {
    match (start, end) {
        (true, true) => fields.add_field("cut", FieldValue::Text("both")),
        (true, false) => fields.add_field("cut", FieldValue::Text("start")),
        (false, true) => fields.add_field("cut", FieldValue::Text("end")),
        (false, false) => {}
    }
}

/// Name and value of the object, if it is known and the data is complete.
fn sdo_object(transfer: &SdoTransfer, object: ObjectAddress, fields: &mut dyn FieldConsumer) {
    fields.add_field("object", FieldValue::Object(object));
    let Some(meaning) = &transfer.meaning else { return };
    fields.add_field("name", FieldValue::Text(&meaning.name));
    if transfer.data.is_empty() || transfer.truncated {
        return;
    }
    let value = meaning.decode(&transfer.data);
    if !matches!(value, DecodedValue::Bytes(_)) {
        visit_meaning(meaning, &value, fields);
    }
}

/// Name of the direction in all output.
pub const fn direction_name(direction: SdoDirection) -> &'static str {
    match direction {
        SdoDirection::Upload => "upload",
        SdoDirection::Download => "download",
    }
}

/// Name of the transfer mode in all output.
pub const fn mode_name(mode: SdoMode) -> &'static str {
    match mode {
        SdoMode::Expedited => "expedited",
        SdoMode::Segmented => "segmented",
        SdoMode::Block => "block",
    }
}
