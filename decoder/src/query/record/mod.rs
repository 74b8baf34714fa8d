//! The fields of an event, in output order.
//!
//! [`visit_event`] passes all fields to a sink or a filter. `fields.toml` in the parent folder describes every
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
pub(crate) use device::event_device;
use field::number_or_null;
pub use field::{FieldConsumer, FieldValue};
pub(crate) use transfer::{UNROUNDED, decimal_digits, quantity_value, visit_signal, visit_signals};
pub use transfer::{direction_name, mode_name};

use crate::event::{Event, EventKind, EventProtocol};
use crate::frame::Timestamp;
use crate::session::Bus;

/// Passes all fields of an event to `fields`.
pub fn visit_event(event: &Event, bus: &Bus, capture: Option<&str>, fields: &mut dyn FieldConsumer) {
    visit_envelope(event, bus, capture, fields);
    visit_details(event, bus, fields);
}

/// Passes the fields specific to the event kind to `fields`.
pub(super) fn visit_details(event: &Event, bus: &Bus, fields: &mut dyn FieldConsumer) {
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
        EventKind::Sync { counter, expected } => bus::visit_sync(*counter, *expected, fields),
        EventKind::Time { milliseconds, days } => bus::visit_time(*milliseconds, *days, fields),
        EventKind::Emcy(emergency) => node::visit_emcy(emergency, event_device(event, bus), fields),
        EventKind::Pdo(pdo) => transfer::process_data(pdo, fields),
        EventKind::SdoTransfer(transfer) => {
            transfer::sdo_transfer(transfer, event_device(event, bus), fields);
        }
        EventKind::Lss { command, from_master, content } => {
            node::visit_lss(*command, *from_master, content, fields);
        }
        EventKind::NodeIdChange { from, to, by } => node::node_id_change(*from, *to, *by, fields),
        EventKind::NodeIdentified(node) => device::node_identified(node, fields),
        EventKind::DeviceState(state) => device::device_state(state, fields),
        EventKind::BitsChanged(bits) => device::bits_changed(bits, fields),
        EventKind::SetPoint(point) => device::set_point(point, fields),
        EventKind::Mode(mode) => device::mode_change(mode, fields),
        EventKind::Procedure(procedure) => device::visit_procedure(procedure, fields),
        EventKind::Conflict(conflict) => device::visit_conflict(conflict, fields),
        EventKind::ObjectChange(change) => device::object_change(change, fields),
        EventKind::J1939Message(message) => j1939::j1939_message(message, fields),
        EventKind::J1939Transfer(transfer) => j1939::j1939_transfer(transfer, fields),
        EventKind::J1939Request(request) => j1939::j1939_request(request, fields),
        EventKind::Acknowledgement(answer) => j1939::visit_acknowledgement(answer, fields),
        EventKind::AddressClaim(claim) => j1939::address_claim(claim, fields),
        EventKind::CommandedAddress(command) => j1939::commanded_address(command, fields),
        EventKind::Dtc(dtc) => j1939::trouble_code(dtc, event, bus, fields),
        EventKind::MessageGap(gap) => j1939::message_gap(gap, fields),
        EventKind::TransportIrregularity(irregularity) => j1939::visit_irregularity(irregularity, fields),
        EventKind::IsoTpTransfer(message) => uds::isotp_transfer(message, fields),
        EventKind::UdsExchange(exchange) => uds::uds_exchange(exchange, event_device(event, bus), fields),
        EventKind::FindingOpened(news) | EventKind::FindingClosed(news) => {
            finding::visit_finding(news, fields);
        }
        EventKind::CanError(error) => bus::can_error(*error, fields),
        EventKind::TestCase(marker) => bus::test_case(*marker, fields),
        EventKind::Frame(undecoded) => bus::visit_undecoded(undecoded, fields),
        EventKind::Malformed { error, reason } => bus::visit_malformed(error, reason, fields),
        EventKind::Evicted { what, count } => bus::visit_evicted(*what, *count, fields),
        EventKind::ClockStep { step } => fields.add_field("step", FieldValue::Seconds(*step)),
        EventKind::BusSilent { gap } => fields.add_field("gap", FieldValue::Seconds(*gap)),
        EventKind::LostFrames { count } => bus::lost_frames(*count, fields),
        EventKind::Link { state, bit_rate } => bus::visit_link(*state, *bit_rate, fields),
        EventKind::Unreadable { file, line, offset, reason, .. } => {
            bus::visit_unreadable(file.as_deref(), *line, *offset, reason, fields);
        }
        EventKind::Note { text } => fields.add_field("text", FieldValue::Text(text)),
    }
}

/// Passes the fields common to all event kinds to `fields`.
pub fn visit_envelope(event: &Event, bus: &Bus, capture: Option<&str>, fields: &mut dyn FieldConsumer) {
    fields.add_field("t", event.time.map_or(FieldValue::Null, |Timestamp(time)| FieldValue::Seconds(time)));
    if let Some(capture) = capture {
        fields.add_field("capture", FieldValue::Text(capture));
    }
    fields.add_field("bus", FieldValue::Text(bus.name()));
    fields.open_list("frames");
    fields.add_field("", FieldValue::Unsigned(event.frames.first));
    fields.add_field("", FieldValue::Unsigned(event.frames.last));
    fields.close_list();
    fields.add_field("kind", FieldValue::Text(event.kind.name()));
    fields.add_field("protocol", FieldValue::Text(protocol_name(event.protocol)));
    if let Some(node) = event.node {
        fields.add_field("node", FieldValue::Unsigned(u64::from(node.number())));
        let known = bus.node(node);
        if let Some(name) = known.and_then(|node| node.name()) {
            fields.add_field("node_name", FieldValue::Text(name));
        }
        if let Some(device) = known.and_then(|node| node.device_id()) {
            fields.add_field("device", FieldValue::Text(device));
        }
    }
    if event.presumed {
        fields.add_field("presumed", FieldValue::Bool(true));
    }
}

/// Name of the protocol in all output.
pub const fn protocol_name(protocol: EventProtocol) -> &'static str {
    match protocol {
        EventProtocol::Can => "can",
        EventProtocol::Canopen => "canopen",
        EventProtocol::J1939 => "j1939",
        EventProtocol::Uds => "uds",
        EventProtocol::Capture => "capture",
    }
}
