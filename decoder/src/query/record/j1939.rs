//! Fields of J1939 events and of transport irregularities.

use super::device::event_device;
use super::transfer::visit_signals;
use super::{FieldConsumer, FieldValue};
use crate::event::{
    AddressClaim, CommandedAddress, Dtc, Event, J1939Acknowledgement, J1939Message, J1939Request,
    J1939Transfer, MessageGap, TransferIrregularity,
};
use crate::profile;
use crate::session::Bus;
use crate::standard_tables::{function_name, manufacturer_name};
use crate::wire::j1939::{J1939Name, Pgn};

fn visit_number(key: &'static str, number: impl Into<u64>, fields: &mut dyn FieldConsumer) {
    fields.add_field(key, FieldValue::Unsigned(number.into()));
}

fn visit_group(pgn: Option<Pgn>, name: Option<&str>, fields: &mut dyn FieldConsumer) {
    fields
        .add_field("pgn", pgn.map_or(FieldValue::Null, |pgn| FieldValue::Unsigned(u64::from(pgn.number()))));
    if let Some(name) = name {
        fields.add_field("pgn_name", FieldValue::Text(name));
    }
}

fn visit_addresses(source: u8, destination: u8, fields: &mut dyn FieldConsumer) {
    visit_number("source_address", source, fields);
    visit_number("destination_address", destination, fields);
}

pub(super) fn j1939_message(message: &J1939Message, fields: &mut dyn FieldConsumer) {
    visit_group(Some(message.id.pgn), message.name.as_deref(), fields);
    visit_number("priority", message.id.priority, fields);
    visit_addresses(message.id.source, message.id.destination, fields);
    fields.add_field("data", FieldValue::Bytes(message.payload()));
    if let Some(layout) = message.layout.as_deref().filter(|_| fields.wants_signals()) {
        visit_signals(layout, message.payload(), fields);
    }
}

pub(super) fn j1939_transfer(transfer: &J1939Transfer, fields: &mut dyn FieldConsumer) {
    visit_group(transfer.pgn, transfer.name.as_deref(), fields);
    fields.add_field("mode", transfer.mode.map_or(FieldValue::Null, |mode| FieldValue::Text(mode.name())));
    visit_number("priority", transfer.priority, fields);
    visit_addresses(transfer.source, transfer.destination, fields);
    visit_number("size", transfer.size, fields);
    if let Some(announced) = transfer.announced {
        visit_number("announced", announced, fields);
    }
    if let Some(packets) = transfer.packets {
        visit_number("packets", packets, fields);
    }
    for (key, count) in [("missing_packets", transfer.missing), ("repeated_packets", transfer.repeated)] {
        if count > 0 {
            visit_number(key, count, fields);
        }
    }
    if let Some((shortest, longest)) = transfer.spacing {
        fields.add_field("shortest_gap", FieldValue::Seconds(shortest));
        fields.add_field("longest_gap", FieldValue::Seconds(longest));
    }
    fields.add_field("data", FieldValue::Bytes(&transfer.data));
    fields.add_field("duration", transfer.duration.map_or(FieldValue::Null, FieldValue::Seconds));
    fields.add_field("outcome", FieldValue::Text(transfer.outcome.name()));
    if let Some(timer) = transfer.timer {
        fields.add_field("timer", FieldValue::Text(timer.name()));
    }
    if let Some(abort) = transfer.abort {
        fields.open_group("abort");
        fields.add_field("code", FieldValue::Code(u64::from(abort.reason), 2));
        fields.add_field("by", FieldValue::Text(if abort.by_sender { "sender" } else { "receiver" }));
        fields.add_field(
            "text",
            FieldValue::Text(profile::transport_aborts().code_text(u32::from(abort.reason))),
        );
        fields.close_group();
    }
    super::transfer::visit_cut(transfer.cut_start, transfer.cut_end, fields);
    if transfer.truncated {
        fields.add_field("truncated", FieldValue::Bool(true));
    }
    if let Some(layout) = transfer.layout.as_deref().filter(|_| fields.wants_signals()) {
        visit_signals(layout, &transfer.data, fields);
    }
}

pub(super) fn j1939_request(request: &J1939Request, fields: &mut dyn FieldConsumer) {
    visit_group(Some(request.pgn), request.name.as_deref(), fields);
    visit_addresses(request.source, request.destination, fields);
}

pub(super) fn visit_acknowledgement(answer: &J1939Acknowledgement, fields: &mut dyn FieldConsumer) {
    fields.add_field("control", FieldValue::Text(answer.control()));
    visit_group(Some(answer.message.pgn), answer.name.as_deref(), fields);
    visit_addresses(answer.source, answer.destination, fields);
    visit_number("address", answer.message.address, fields);
    visit_number("group_function", answer.message.group_function, fields);
}

fn name_fields(name: J1939Name, fields: &mut dyn FieldConsumer) {
    fields.add_field("name", FieldValue::Code(name.0, 16));
    let parts = name.fields();
    fields.open_group("name_fields");
    visit_number("identity_number", parts.identity_number, fields);
    visit_number("manufacturer_code", parts.manufacturer_code, fields);
    if let Some(manufacturer) = manufacturer_name(&parts) {
        fields.add_field("manufacturer", FieldValue::Text(manufacturer));
    }
    visit_number("ecu_instance", parts.ecu_instance, fields);
    visit_number("function_instance", parts.function_instance, fields);
    visit_number("function", parts.function, fields);
    if let Some(function) = function_name(&parts) {
        fields.add_field("function_name", FieldValue::Text(function));
    }
    visit_number("device_class", parts.device_class, fields);
    visit_number("device_class_instance", parts.device_class_instance, fields);
    visit_number("industry_group", parts.industry_group, fields);
    fields.add_field("arbitrary_address_capable", FieldValue::Bool(parts.arbitrary_address_capable));
    fields.close_group();
}

pub(super) fn address_claim(claim: &AddressClaim, fields: &mut dyn FieldConsumer) {
    fields.add_field("action", FieldValue::Text(claim.action.name()));
    visit_number("source_address", claim.source, fields);
    if let Some(from) = claim.from {
        visit_number("from", from, fields);
    }
    name_fields(claim.name, fields);
    if let Some(contention) = claim.contention {
        fields.open_group("contention");
        fields.add_field("other", FieldValue::Code(contention.other.0, 16));
        fields.add_field("winner", FieldValue::Code(contention.winner.0, 16));
        fields.close_group();
    }
    if claim.commanded != 0 {
        visit_number("cause_frame", claim.commanded, fields);
    }
}

pub(super) fn commanded_address(command: &CommandedAddress, fields: &mut dyn FieldConsumer) {
    visit_number("source_address", command.source, fields);
    visit_number("address", command.address, fields);
    if let Some(present) = command.present {
        visit_number("from", present, fields);
    }
    name_fields(command.name, fields);
}

pub(super) fn trouble_code(dtc: &Dtc, event: &Event, bus: &Bus, fields: &mut dyn FieldConsumer) {
    visit_number("source_address", dtc.source, fields);
    visit_number("spn", dtc.spn, fields);
    if let Some(parameter) = bus.suspect_parameter(dtc.spn) {
        fields.add_field("spn_name", FieldValue::Text(parameter.name));
    }
    visit_number("fmi", dtc.fmi, fields);
    fields.add_field(
        "count",
        dtc.count.map_or(FieldValue::Null, |count| FieldValue::Unsigned(u64::from(count))),
    );
    fields.add_field("action", FieldValue::Text(dtc.action.name()));
    if let Some(own) = event_device(event, bus).trouble_code_entry(dtc.spn, dtc.fmi) {
        fields.add_field("text", FieldValue::Text(&own.text));
    }
    if let Some(mode) = profile::failure_modes().find_code(u32::from(dtc.fmi)) {
        fields.add_field("fmi_text", FieldValue::Text(&mode.text));
    }
    fields.open_list("lamps");
    for lamp in &dtc.lamps {
        fields.add_field("", FieldValue::Text(lamp));
    }
    fields.close_list();
    if dtc.is_old_coding {
        fields.add_field("assumed", FieldValue::Bool(true));
    }
    if dtc.may_be_hidden {
        fields.add_field("may_be_hidden", FieldValue::Bool(true));
    }
    if dtc.by_silence {
        fields.add_field("by_silence", FieldValue::Bool(true));
    }
    visit_number("first_frame", dtc.first_frame, fields);
    visit_number("last_frame", dtc.last_frame, fields);
    if let Some(since) = dtc.since {
        fields.add_field("since", FieldValue::Seconds(since));
    }
}

pub(super) fn message_gap(gap: &MessageGap, fields: &mut dyn FieldConsumer) {
    fields.add_field("message", FieldValue::Text(&gap.message));
    visit_group(Some(gap.pgn), None, fields);
    visit_number("source_address", gap.source, fields);
    fields.add_field("gap", FieldValue::Seconds(gap.gap));
    fields.add_field("limit", FieldValue::Seconds(gap.limit));
    if let Some((usual, deviation)) = gap.usual {
        fields.add_field("usual", FieldValue::Seconds(usual));
        fields.add_field("deviation", FieldValue::Seconds(deviation));
    }
    fields.add_field("came_again", FieldValue::Bool(gap.has_returned));
}

pub(super) fn visit_irregularity(irregularity: &TransferIrregularity, fields: &mut dyn FieldConsumer) {
    fields.add_field("what", FieldValue::Text(irregularity.what.name()));
    fields.add_field("message", FieldValue::Text(irregularity.message));
    if irregularity.pgn.is_some() {
        visit_group(irregularity.pgn, None, fields);
    }
    let numbers = [
        ("source_address", irregularity.source.map(u32::from)),
        ("destination_address", irregularity.destination.map(u32::from)),
        ("packet", irregularity.packet),
        ("expected", irregularity.expected),
    ];
    for (key, known) in numbers {
        if let Some(known) = known {
            visit_number(key, known, fields);
        }
    }
    if let Some(timer) = irregularity.timer {
        fields.add_field("timer", FieldValue::Text(timer.name()));
    }
    if let Some(delay) = irregularity.delay {
        fields.add_field("delay", FieldValue::Seconds(delay));
    }
}
