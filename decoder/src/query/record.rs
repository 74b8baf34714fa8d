//! The fields of an event, in output order.
//!
//! A sink writes what [`visit`] tells it; a filter looks for the one it wants. `fields.toml` beside this
//! file describes every key; a test holds both to each other.

use crate::event::{
    BootCause, Certainty, Direction, Emergency, Event, EventKind, Mode, Pdo, Protocol, SdoTransfer, Silence,
    StateChange,
};
use crate::frame::{CanId, FrameFlags, Timestamp};
use crate::profile::{self, Value};
use crate::session::Bus;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::lss::Content;
use crate::wire::error_frame::ErrorFrame;

/// One field's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldValue<'a> {
    /// Known to be unknown.
    Null,
    /// True or false.
    Bool(bool),
    /// Counts, node-IDs, raw numbers.
    Unsigned(u64),
    /// Signed numbers.
    Integer(i64),
    /// Scaled numbers; not finite ones are written as null.
    Real(f64),
    /// Names and texts.
    Text(&'a str),
    /// Nanoseconds, written as seconds.
    Seconds(i64),
    /// A code, written `"0x…"` with this many digits.
    Code(u64, u8),
    /// An identifier, written in hex without 0x.
    Id(CanId),
    /// An object, written `"0x1018:01"`.
    Object(ObjectAddress),
    /// Data, written as hex pairs.
    Bytes(&'a [u8]),
}

/// Takes fields as they come.
pub trait Fields {
    /// A field of the present object, or of the present list's item if `key` is empty.
    fn field(&mut self, key: &'static str, value: FieldValue<'_>);
    /// A nested object begins; an item of a list if `key` is empty.
    fn open(&mut self, key: &'static str);
    /// It ends.
    fn close(&mut self);
    /// A list begins.
    fn open_list(&mut self, key: &'static str);
    /// It ends.
    fn close_list(&mut self);
    /// Whether signals are worth computing.
    fn wants_signals(&self) -> bool {
        true
    }
}

/// Tells `fields` everything about an event.
pub fn visit(event: &Event, bus: &Bus, capture: Option<&str>, fields: &mut dyn Fields) {
    envelope(event, bus, capture, fields);
    details(event, fields);
}

/// What depends on the kind.
fn details(event: &Event, fields: &mut dyn Fields) {
    match &event.kind {
        EventKind::NmtCommand { service, target, from, to } => {
            fields.field("command", FieldValue::Text(service.name()));
            fields.field("target", FieldValue::Unsigned(u64::from(*target)));
            if *target != 0 {
                fields.field("from", from.map_or(FieldValue::Null, |from| FieldValue::Text(from.name())));
                fields.field("to", to.map_or(FieldValue::Null, |to| FieldValue::Text(to.name())));
            }
        }
        EventKind::NmtState(change) => state_change(change, fields),
        EventKind::BootUp { cause } => boot_up(*cause, fields),
        EventKind::Heartbeat { state, code } => node_state(*state, *code, fields),
        EventKind::GuardRequest => {}
        EventKind::GuardReply { state, code, toggle, toggle_error } => {
            node_state(*state, *code, fields);
            fields.field("toggle", FieldValue::Unsigned(u64::from(*toggle)));
            if *toggle_error {
                fields.field("toggle_error", FieldValue::Bool(true));
            }
        }
        EventKind::NodeLost(silence) | EventKind::NodeBack(silence) => node_silence(silence, fields),
        EventKind::Sync { counter, expected } => {
            fields.field("counter", number_or_null(*counter));
            if let Some(expected) = expected {
                fields.field("expected", FieldValue::Unsigned(u64::from(*expected)));
            }
        }
        EventKind::Time { milliseconds, days } => {
            fields.field("time", FieldValue::Text(&time_of_day(*milliseconds, *days)));
        }
        EventKind::Emcy(emergency) => emcy(emergency, fields),
        EventKind::Pdo(pdo) => process_data(pdo, fields),
        EventKind::SdoTransfer(transfer) => sdo_transfer(transfer, fields),
        EventKind::Lss { command, from_master, content } => lss(*command, *from_master, content, fields),
        EventKind::NodeIdChange { from, to, by } => {
            fields.field("from", number_or_null(*from));
            fields.field("to", FieldValue::Unsigned(u64::from(*to)));
            fields.field("by", FieldValue::Text(by));
        }
        EventKind::ObjectChange(change) => {
            fields.field("object", FieldValue::Object(change.object));
            fields.field("from", change.from.as_deref().map_or(FieldValue::Null, FieldValue::Bytes));
            fields.field("to", FieldValue::Bytes(&change.to));
            fields.field("origin", FieldValue::Text(change.origin));
        }
        _ => about_the_bus(&event.kind, fields),
    }
}

/// Tells `fields` only what every kind of event has.
pub fn envelope(event: &Event, bus: &Bus, capture: Option<&str>, fields: &mut dyn Fields) {
    fields.field("t", event.time.map_or(FieldValue::Null, |Timestamp(time)| FieldValue::Seconds(time)));
    if let Some(capture) = capture {
        fields.field("capture", FieldValue::Text(capture));
    }
    fields.field("bus", FieldValue::Text(bus.name()));
    fields.open_list("frames");
    fields.field("", FieldValue::Unsigned(event.frames.first));
    fields.field("", FieldValue::Unsigned(event.frames.last));
    fields.close_list();
    fields.field("kind", FieldValue::Text(event.kind.name()));
    fields.field("protocol", FieldValue::Text(protocol(event.protocol)));
    if let Some(node) = event.node {
        fields.field("node", FieldValue::Unsigned(u64::from(node)));
        if let Some(name) = bus.node(node).and_then(|node| node.name()) {
            fields.field("node_name", FieldValue::Text(name));
        }
    }
    if event.presumed {
        fields.field("presumed", FieldValue::Bool(true));
    }
}

/// The name used in all output.
pub const fn protocol(protocol: Protocol) -> &'static str {
    match protocol {
        Protocol::Can => "can",
        Protocol::Canopen => "canopen",
        Protocol::Capture => "capture",
    }
}

fn number_or_null(number: Option<u8>) -> FieldValue<'static> {
    number.map_or(FieldValue::Null, |number| FieldValue::Unsigned(u64::from(number)))
}

fn state_change(change: &StateChange, fields: &mut dyn Fields) {
    fields.field("from", change.from.map_or(FieldValue::Null, |from| FieldValue::Text(from.name())));
    fields.field("to", FieldValue::Text(change.to.name()));
    fields.field("cause", FieldValue::Text(change.cause.name()));
    fields.field("cause_frame", FieldValue::Unsigned(change.cause_frame));
    fields.field("certainty", FieldValue::Text(certainty(change.certainty)));
    if let Some(after) = change.after {
        fields.field("after", FieldValue::Seconds(after));
    }
}

const fn certainty(certainty: Certainty) -> &'static str {
    match certainty {
        Certainty::Presumed => "presumed",
        Certainty::Confirmed => "confirmed",
    }
}

fn boot_up(cause: BootCause, fields: &mut dyn Fields) {
    match cause {
        BootCause::Commanded { frame } => {
            fields.field("cause", FieldValue::Text("commanded"));
            fields.field("cause_frame", FieldValue::Unsigned(frame));
        }
        BootCause::PresumedPowerOn { sign } => {
            fields.field("cause", FieldValue::Text("presumed-power-on"));
            if let Some(sign) = sign {
                fields.field("sign", FieldValue::Text(sign.name()));
            }
        }
    }
}

fn node_state(state: Option<crate::wire::canopen::NmtState>, code: u8, fields: &mut dyn Fields) {
    fields.field("state", state.map_or(FieldValue::Null, |state| FieldValue::Text(state.name())));
    if state.is_none() {
        fields.field("state_code", FieldValue::Unsigned(u64::from(code)));
    }
}

fn node_silence(silence: &Silence, fields: &mut dyn Fields) {
    fields.field("last_frame", FieldValue::Unsigned(silence.last_frame));
    fields.field(
        "last_state",
        silence.last_state.map_or(FieldValue::Null, |state| FieldValue::Text(state.name())),
    );
    fields.field(
        "last_emcy",
        silence.last_emcy.map_or(FieldValue::Null, |code| FieldValue::Code(u64::from(code), 4)),
    );
    fields.field("gap", FieldValue::Seconds(silence.gap));
    fields.field("monitored_by", FieldValue::Text(silence.monitored_by));
}

fn emcy(emergency: &Emergency, fields: &mut dyn Fields) {
    match emergency.code {
        Some(code) => {
            fields.field("code", FieldValue::Code(u64::from(code), 4));
            fields.field("text", FieldValue::Text(profile::emcy_codes().text(u32::from(code))));
        }
        None => fields.field("code", FieldValue::Null),
    }
    if let Some(register) = emergency.register {
        fields.field("register", FieldValue::Code(u64::from(register), 2));
    }
    if emergency.vendor_length > 0 {
        let vendor = emergency.vendor.get(..usize::from(emergency.vendor_length)).unwrap_or_default();
        fields.field("vendor_data", FieldValue::Bytes(vendor));
    }
    fields.field("action", FieldValue::Text(emergency.action.name()));
    fields.field("active", FieldValue::Unsigned(u64::from(emergency.active)));
    fields.field("byte_order", FieldValue::Text(emergency.byte_order.name()));
}

fn process_data(pdo: &Pdo, fields: &mut dyn Fields) {
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

fn sdo_transfer(transfer: &SdoTransfer, fields: &mut dyn Fields) {
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

fn lss(command: u8, from_master: bool, content: &Content, fields: &mut dyn Fields) {
    fields.field("service", FieldValue::Text(profile::lss().service(command)));
    fields.field("direction", FieldValue::Text(if from_master { "request" } else { "response" }));
    match *content {
        Content::Nothing => {}
        Content::Mode(mode) => {
            let mode = match mode {
                0 => FieldValue::Text("waiting"),
                1 => FieldValue::Text("configuration"),
                other => FieldValue::Unsigned(u64::from(other)),
            };
            fields.field("mode", mode);
        }
        Content::NodeId(id) => fields.field("node_id", FieldValue::Unsigned(u64::from(id))),
        Content::BitTiming { table, entry } => {
            fields.field("table", FieldValue::Unsigned(u64::from(table)));
            fields.field("index", FieldValue::Unsigned(u64::from(entry)));
            if let Some(rate) = profile::lss().bit_rate(entry).filter(|_| table == 0) {
                fields.field("bit_rate", FieldValue::Unsigned(u64::from(rate) * 1000));
            }
        }
        Content::Delay(delay) => fields.field("delay_ms", FieldValue::Unsigned(u64::from(delay))),
        Content::Number(number) => {
            fields.field(profile::lss().number_key(command), FieldValue::Code(u64::from(number), 8));
        }
        Content::Result { code, specific } => {
            fields.field("error", FieldValue::Unsigned(u64::from(code)));
            fields.field("result", FieldValue::Text(if code == 0 { "ok" } else { "error" }));
            if code != 0 {
                fields.field("text", FieldValue::Text(profile::lss().result(command, code)));
            }
            if code == u8::MAX {
                fields.field("specific", FieldValue::Unsigned(u64::from(specific)));
            }
        }
        Content::FastScan { number, bit, sub, next } => {
            fields.field("id_number", FieldValue::Code(u64::from(number), 8));
            fields.field("bit_check", FieldValue::Unsigned(u64::from(bit)));
            fields.field("lss_sub", FieldValue::Unsigned(u64::from(sub)));
            fields.field("lss_next", FieldValue::Unsigned(u64::from(next)));
        }
    }
}

/// Kinds that are about bus and capture rather than a node.
fn about_the_bus(kind: &EventKind, fields: &mut dyn Fields) {
    match kind {
        EventKind::CanError(error) => can_error(*error, fields),
        EventKind::Frame(undecoded) => {
            fields.field("id", FieldValue::Id(undecoded.frame.id));
            if let Some(name) = undecoded.name {
                fields.field("name", FieldValue::Text(name));
            }
            frame_flags(undecoded.frame.flags, fields);
            fields.field("size", FieldValue::Unsigned(u64::from(undecoded.frame.length)));
            fields.field("data", FieldValue::Bytes(undecoded.frame.data()));
        }
        EventKind::Malformed { error, reason } => {
            fields.field("layer", FieldValue::Text(error.layer));
            fields.field("offset", FieldValue::Unsigned(u64::from(error.offset)));
            fields.field("needed", FieldValue::Unsigned(u64::from(error.needed)));
            fields.field("available", FieldValue::Unsigned(u64::from(error.available)));
            fields.field("reason", FieldValue::Text(reason));
        }
        EventKind::Evicted { what, count } => {
            fields.field("what", FieldValue::Text(what));
            fields.field("count", FieldValue::Unsigned(*count));
        }
        EventKind::ClockStep { step } => fields.field("step", FieldValue::Seconds(*step)),
        EventKind::BusSilent { gap } => fields.field("gap", FieldValue::Seconds(*gap)),
        EventKind::LostFrames { count } => {
            fields.field("count", count.map_or(FieldValue::Null, FieldValue::Unsigned));
        }
        EventKind::Unreadable { line, offset, reason } => {
            if let Some(line) = line {
                fields.field("line", FieldValue::Unsigned(*line));
            }
            if let Some(offset) = offset {
                fields.field("offset", FieldValue::Unsigned(*offset));
            }
            fields.field("reason", FieldValue::Text(reason));
        }
        EventKind::Note { text } => fields.field("text", FieldValue::Text(text)),
        _ => {}
    }
}

fn frame_flags(flags: FrameFlags, fields: &mut dyn Fields) {
    if flags.contains(FrameFlags::REMOTE) {
        fields.field("remote", FieldValue::Bool(true));
    }
    if flags.contains(FrameFlags::FD) {
        fields.field("fd", FieldValue::Bool(true));
    }
}

fn can_error(error: ErrorFrame, fields: &mut dyn Fields) {
    let names = profile::can_errors();
    let classes: Vec<&str> = names.classes.names(error.classes).filter(|name| *name != "counters").collect();
    fields.field("class", FieldValue::Text(&classes.join(",")));
    fields.field("text", FieldValue::Text(&can_error_text(error)));
    // linux/can/error.h: the counters are valid with class bit 0x200; older drivers fill them anyway.
    if error.classes & 0x200 != 0 || error.transmit_errors != 0 || error.receive_errors != 0 {
        fields.field("tx_errors", FieldValue::Unsigned(u64::from(error.transmit_errors)));
        fields.field("rx_errors", FieldValue::Unsigned(u64::from(error.receive_errors)));
    }
}

/// What an error frame says, in words.
pub fn can_error_text(error: ErrorFrame) -> String {
    let names = profile::can_errors();
    let mut parts: Vec<String> = Vec::new();
    for class in names.classes.names(error.classes) {
        let details: Vec<&str> = match class {
            "controller" => names.controller.texts(u32::from(error.controller)).collect(),
            "protocol" => {
                let location =
                    names.location.text_of(u32::from(error.location)).filter(|_| error.location != 0);
                names.protocol.texts(u32::from(error.protocol)).chain(location).collect()
            }
            "transceiver" => names.transceiver.text_of(u32::from(error.transceiver)).into_iter().collect(),
            "counters" => continue,
            _ => names.classes.texts(error.classes & class_bit(class)).collect(),
        };
        let at = if class == "lost-arbitration" && error.arbitration_bit != 0 {
            format!(" at bit {}", error.arbitration_bit)
        } else {
            String::new()
        };
        let details = if details.is_empty() {
            names.classes.texts(error.classes & class_bit(class)).collect::<String>()
        } else {
            details.join(", ")
        };
        parts.push(format!("{details}{at}"));
    }
    if parts.is_empty() { format!("unknown error class {:08X}", error.classes) } else { parts.join("; ") }
}

fn class_bit(name: &str) -> u32 {
    let names = &profile::can_errors().classes;
    (0..29).map(|bit| 1 << bit).find(|bit| names.names(*bit).any(|found| found == name)).unwrap_or(0)
}

/// A TIME message's content as a date (CiA 301 §7.1.6.5: days since 1984-01-01).
pub fn time_of_day(milliseconds: u32, days: u16) -> String {
    let midnight = jiff::civil::date(1984, 1, 1).saturating_add(jiff::Span::new().days(i64::from(days)));
    let time = midnight.at(0, 0, 0, 0).checked_add(jiff::Span::new().milliseconds(i64::from(milliseconds)));
    time.map_or_else(|_| format!("{days} d {milliseconds} ms"), |time| format!("{time:.3}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::error_frame;

    #[test]
    fn time_of_day_counts_from_1984() {
        // 14,610 days after 1984-01-01 is 2024-01-01; 43,200,000 ms is noon.
        assert_eq!(time_of_day(43_200_000, 14_610), "2024-01-01T12:00:00.000");
    }

    #[test]
    fn error_frames_in_words() {
        let error = error_frame::parse(0x2000_0204, &[0, 0x04, 0, 0, 0, 0, 96, 128]);
        assert_eq!(can_error_text(error), "receive errors at warning level");
        let error = error_frame::parse(0x2000_0008, &[0, 0, 0x04, 0x19, 0, 0, 0, 0]);
        assert_eq!(can_error_text(error), "bit stuffing error, ACK slot");
        assert_eq!(can_error_text(error_frame::parse(0x2000_0040, &[])), "controller is bus-off");
    }
}
