//! The fields of an event, in output order.
//!
//! [`visit`] passes all fields to a sink or a filter. `fields.toml` in the parent folder describes every
//! key; a test compares both.

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

/// Passes all fields of an event to `fields`.
pub fn visit(event: &Event, bus: &Bus, capture: Option<&str>, fields: &mut dyn Fields) {
    envelope(event, bus, capture, fields);
    details(event, bus, fields);
}

/// Passes the fields specific to the event kind to `fields`.
pub(super) fn details(event: &Event, bus: &Bus, fields: &mut dyn Fields) {
    match &event.kind {
        EventKind::NmtCommand { service, target, from, to } => {
            node::nmt_command(*service, *target, [*from, *to], fields);
        }
        EventKind::NmtState(change) => node::state_change(change, fields),
        EventKind::BootUp { cause, lost } => node::boot_up(*cause, *lost, fields),
        EventKind::Heartbeat { state, code } => node::node_state(*state, *code, fields),
        EventKind::GuardRequest => {}
        EventKind::GuardReply { state, code, toggle, toggle_error } => {
            node::guard_reply(*state, *code, *toggle, *toggle_error, fields);
        }
        EventKind::NodeLost(silence) | EventKind::NodeBack(silence) => node::node_silence(silence, fields),
        EventKind::Sync { counter, expected } => bus::sync(*counter, *expected, fields),
        EventKind::Time { milliseconds, days } => bus::time(*milliseconds, *days, fields),
        EventKind::Emcy(emergency) => node::emcy(emergency, device(event, bus), fields),
        EventKind::Pdo(pdo) => transfer::process_data(pdo, fields),
        EventKind::SdoTransfer(transfer) => transfer::sdo_transfer(transfer, device(event, bus), fields),
        EventKind::Lss { command, from_master, content } => {
            node::lss(*command, *from_master, content, fields);
        }
        EventKind::NodeIdChange { from, to, by } => node::node_id_change(*from, *to, *by, fields),
        EventKind::NodeIdentified(node) => device::node_identified(node, fields),
        EventKind::DeviceState(state) => device::device_state(state, fields),
        EventKind::BitsChanged(bits) => device::bits_changed(bits, fields),
        EventKind::SetPoint(point) => device::set_point(point, fields),
        EventKind::Mode(mode) => device::mode_change(mode, fields),
        EventKind::Procedure(procedure) => device::procedure(procedure, fields),
        EventKind::Conflict(conflict) => device::conflict(conflict, fields),
        EventKind::ObjectChange(change) => device::object_change(change, fields),
        EventKind::J1939Message(message) => j1939::j1939_message(message, fields),
        EventKind::J1939Transfer(transfer) => j1939::j1939_transfer(transfer, fields),
        EventKind::J1939Request(request) => j1939::j1939_request(request, fields),
        EventKind::Acknowledgement(answer) => j1939::acknowledgement(answer, fields),
        EventKind::AddressClaim(claim) => j1939::address_claim(claim, fields),
        EventKind::CommandedAddress(command) => j1939::commanded_address(command, fields),
        EventKind::Dtc(dtc) => j1939::trouble_code(dtc, event, bus, fields),
        EventKind::MessageGap(gap) => j1939::message_gap(gap, fields),
        EventKind::TransportIrregularity(irregularity) => j1939::irregularity(irregularity, fields),
        EventKind::IsoTpTransfer(message) => uds::isotp_transfer(message, fields),
        EventKind::UdsExchange(exchange) => uds::uds_exchange(exchange, device(event, bus), fields),
        EventKind::FindingOpened(news) | EventKind::FindingClosed(news) => finding::finding(news, fields),
        EventKind::CanError(error) => bus::can_error(*error, fields),
        EventKind::TestCase(marker) => bus::test_case(*marker, fields),
        EventKind::Frame(undecoded) => bus::undecoded(undecoded, fields),
        EventKind::Malformed { error, reason } => bus::malformed(error, reason, fields),
        EventKind::Evicted { what, count } => bus::evicted(*what, *count, fields),
        EventKind::ClockStep { step } => fields.field("step", FieldValue::Seconds(*step)),
        EventKind::BusSilent { gap } => fields.field("gap", FieldValue::Seconds(*gap)),
        EventKind::LostFrames { count } => bus::lost_frames(*count, fields),
        EventKind::Link { state, bit_rate } => bus::link(*state, *bit_rate, fields),
        EventKind::Unreadable { file, line, offset, reason, .. } => {
            bus::unreadable(file.as_deref(), *line, *offset, reason, fields);
        }
        EventKind::Note { text } => fields.field("text", FieldValue::Text(text)),
    }
}

/// Device of the event's node; the generic device if unknown.
pub(crate) fn device<'a>(event: &Event, bus: &'a Bus) -> &'a Device {
    match event.node.and_then(|node| bus.node(node)) {
        Some(node) => node.device(),
        None => plain_device(),
    }
}

/// Passes the fields common to all event kinds to `fields`.
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

/// Name of the protocol in all output.
pub const fn protocol(protocol: Protocol) -> &'static str {
    match protocol {
        Protocol::Can => "can",
        Protocol::Canopen => "canopen",
        Protocol::J1939 => "j1939",
        Protocol::Uds => "uds",
        Protocol::Capture => "capture",
    }
}
