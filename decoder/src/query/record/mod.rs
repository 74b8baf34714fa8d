//! The fields of an event, in output order.
//!
//! A sink writes what [`visit`] tells it; a filter looks for the one it wants. `fields.toml` above this
//! file describes every key; a test holds both to each other.

mod bus;
mod device;
mod field;
mod finding;
mod j1939;
mod node;
mod transfer;
mod uds;

pub use bus::{can_error_text, time_of_day};
use field::number_or_null;
pub use field::{FieldValue, Fields};
pub(crate) use transfer::{UNROUNDED, digits, quantity, signal, signals};
pub use transfer::{direction, mode};

use crate::event::{Event, EventKind, Protocol};
use crate::frame::Timestamp;
use crate::profile::{Device, plain_device};
use crate::session::Bus;

/// Tells `fields` everything about an event.
pub fn visit(event: &Event, bus: &Bus, capture: Option<&str>, fields: &mut dyn Fields) {
    envelope(event, bus, capture, fields);
    details(event, bus, fields);
}

/// Tells `fields` what depends on the kind.
pub(super) fn details(event: &Event, bus: &Bus, fields: &mut dyn Fields) {
    match &event.kind {
        EventKind::NmtCommand { service, target, from, to } => {
            fields.field("command", FieldValue::Text(service.name()));
            fields.field("target", FieldValue::Unsigned(u64::from(*target)));
            if *target != 0 {
                fields.field("from", from.map_or(FieldValue::Null, |from| FieldValue::Text(from.name())));
                fields.field("to", to.map_or(FieldValue::Null, |to| FieldValue::Text(to.name())));
            }
        }
        EventKind::NmtState(change) => node::state_change(change, fields),
        EventKind::BootUp { cause, lost } => node::boot_up(*cause, *lost, fields),
        EventKind::Heartbeat { state, code } => node::node_state(*state, *code, fields),
        EventKind::GuardRequest => {}
        EventKind::GuardReply { state, code, toggle, toggle_error } => {
            node::node_state(*state, *code, fields);
            fields.field("toggle", FieldValue::Unsigned(u64::from(*toggle)));
            if *toggle_error {
                fields.field("toggle_error", FieldValue::Bool(true));
            }
        }
        EventKind::NodeLost(silence) | EventKind::NodeBack(silence) => node::node_silence(silence, fields),
        EventKind::Sync { counter, expected } => {
            fields.field("counter", number_or_null(*counter));
            if let Some(expected) = expected {
                fields.field("expected", FieldValue::Unsigned(u64::from(*expected)));
            }
        }
        EventKind::Time { milliseconds, days } => {
            fields.field("time", FieldValue::Text(&time_of_day(*milliseconds, *days)));
        }
        EventKind::Emcy(emergency) => node::emcy(emergency, device(event, bus), fields),
        EventKind::Pdo(pdo) => transfer::process_data(pdo, fields),
        EventKind::SdoTransfer(transfer) => transfer::sdo_transfer(transfer, device(event, bus), fields),
        EventKind::Lss { command, from_master, content } => {
            node::lss(*command, *from_master, content, fields);
        }
        EventKind::NodeIdChange { from, to, by } => {
            fields.field("from", number_or_null(*from));
            fields.field("to", FieldValue::Unsigned(u64::from(*to)));
            fields.field("by", FieldValue::Text(by));
        }
        EventKind::ObjectChange(change) => {
            fields.field("object", FieldValue::Object(change.object));
            fields.field("from", change.from.as_deref().map_or(FieldValue::Null, FieldValue::Bytes));
            fields.field("to", change.to.as_deref().map_or(FieldValue::Null, FieldValue::Bytes));
            fields.field("origin", FieldValue::Text(change.origin));
            if let Some(effect) = change.effect {
                fields.field("effective", FieldValue::Text(effect.name()));
            }
            if let Some(persists) = change.persists {
                fields.field("persists", FieldValue::Text(persists));
            }
        }
        EventKind::FindingOpened(news) | EventKind::FindingClosed(news) => finding::finding(news, fields),
        _ if device::tell(&event.kind, fields) => {}
        _ if j1939::tell(event, bus, fields) => {}
        _ if uds::tell(&event.kind, device(event, bus), fields) => {}
        _ => bus::about_the_bus(&event.kind, fields),
    }
}

/// What the event's node is.
pub(crate) fn device<'a>(event: &Event, bus: &'a Bus) -> &'a Device {
    match event.node.and_then(|node| bus.node(node)) {
        Some(node) => node.device(),
        None => plain_device(),
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
        fields.field("node", FieldValue::Unsigned(u64::from(node.number())));
        let known = bus.node(node);
        if let Some(name) = known.and_then(|node| node.name()) {
            fields.field("node_name", FieldValue::Text(name));
        }
        if let Some(device) = known.and_then(|node| node.device_id()) {
            fields.field("device", FieldValue::Text(device));
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
        Protocol::J1939 => "j1939",
        Protocol::Uds => "uds",
        Protocol::Capture => "capture",
    }
}
