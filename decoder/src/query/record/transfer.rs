//! Fields of PDOs and SDO transfers.

use super::{FieldValue, Fields, number_or_null};
use crate::event::{Direction, Mode, Pdo, SdoTransfer};
use crate::profile::{self, Value};
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
    if fields.wants_signals() {
        signals(pdo, fields);
    }
}

/// The values of a PDO whose layout is known: the last of its fields, behind `data`.
pub(crate) fn signals(pdo: &Pdo, fields: &mut dyn Fields) {
    let Some(layout) = &pdo.layout else { return };
    fields.open_list("signals");
    for signal in layout.signals(pdo.payload()) {
        fields.open("");
        fields.field("id", FieldValue::Object(signal.field.object));
        fields.field("name", signal.field.name.as_deref().map_or(FieldValue::Null, FieldValue::Text));
        fields.field("raw", FieldValue::Unsigned(signal.raw));
        value_field("value", &signal.value, fields);
        fields.field("origin", FieldValue::Text(layout.origin));
        if layout.assumed {
            fields.field("assumed", FieldValue::Bool(true));
        }
        fields.close();
    }
    fields.close_list();
}

fn value_field(key: &'static str, value: &Value, fields: &mut dyn Fields) {
    match value {
        Value::Unsigned(value) => fields.field(key, FieldValue::Unsigned(*value)),
        Value::Integer(value) => fields.field(key, FieldValue::Integer(*value)),
        Value::Real(value) => fields.field(key, FieldValue::Real(*value)),
        Value::Text(text) => fields.field(key, FieldValue::Text(text)),
        Value::Bytes(bytes) => fields.field(key, FieldValue::Bytes(bytes)),
    }
}

pub(super) fn sdo_transfer(transfer: &SdoTransfer, fields: &mut dyn Fields) {
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
    if let Some(abort) = transfer.abort {
        fields.open("abort");
        fields.field("code", FieldValue::Code(u64::from(abort.code), 8));
        fields.field("by", FieldValue::Text(if abort.by_client { "client" } else { "server" }));
        fields.field("text", FieldValue::Text(profile::abort_codes().text(abort.code)));
        fields.close();
    }
    if let Some(crc) = transfer.crc {
        fields.field("crc", FieldValue::Text(crc.name()));
    }
    match (transfer.cut_start, transfer.cut_end) {
        (true, true) => fields.field("cut", FieldValue::Text("both")),
        (true, false) => fields.field("cut", FieldValue::Text("start")),
        (false, true) => fields.field("cut", FieldValue::Text("end")),
        (false, false) => {}
    }
    if transfer.truncated {
        fields.field("truncated", FieldValue::Bool(true));
    }
}

/// Name and value of the object, where it is known and the data is whole.
fn sdo_object(transfer: &SdoTransfer, object: ObjectAddress, fields: &mut dyn Fields) {
    fields.field("object", FieldValue::Object(object));
    let Some(entry) = profile::communication_objects().find(object) else { return };
    fields.field("name", FieldValue::Text(&entry.name()));
    if transfer.data.is_empty() || transfer.truncated {
        return;
    }
    let value = entry.decode(&transfer.data);
    if !matches!(value, Value::Bytes(_)) {
        value_field("value", &value, fields);
        if !entry.unit.is_empty() {
            fields.field("unit", FieldValue::Text(entry.unit));
        }
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
