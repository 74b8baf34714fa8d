//! Fields of J1939 events and of transport irregularities.

use super::transfer::signals;
use super::{FieldValue, Fields, device};
use crate::event::{
    AddressClaim, CommandedAddress, Dtc, Event, Irregularity, J1939Acknowledgement, J1939Message,
    J1939Request, J1939Transfer, MessageGap,
};
use crate::profile;
use crate::session::Bus;
use crate::wire::j1939::{Name, Pgn};

fn number(key: &'static str, number: impl Into<u64>, fields: &mut dyn Fields) {
    fields.field(key, FieldValue::Unsigned(number.into()));
}

fn group(pgn: Option<Pgn>, name: Option<&str>, fields: &mut dyn Fields) {
    fields.field("pgn", pgn.map_or(FieldValue::Null, |pgn| FieldValue::Unsigned(u64::from(pgn.number()))));
    if let Some(name) = name {
        fields.field("pgn_name", FieldValue::Text(name));
    }
}

fn addresses(source: u8, destination: u8, fields: &mut dyn Fields) {
    number("source_address", source, fields);
    number("destination_address", destination, fields);
}

pub(super) fn j1939_message(message: &J1939Message, fields: &mut dyn Fields) {
    group(Some(message.id.pgn), message.name.as_deref(), fields);
    number("priority", message.id.priority, fields);
    addresses(message.id.source, message.id.destination, fields);
    fields.field("data", FieldValue::Bytes(message.payload()));
    if let Some(layout) = message.layout.as_deref().filter(|_| fields.wants_signals()) {
        signals(layout, message.payload(), fields);
    }
}

pub(super) fn j1939_transfer(transfer: &J1939Transfer, fields: &mut dyn Fields) {
    group(transfer.pgn, transfer.name.as_deref(), fields);
    fields.field("mode", transfer.mode.map_or(FieldValue::Null, |mode| FieldValue::Text(mode.name())));
    number("priority", transfer.priority, fields);
    addresses(transfer.source, transfer.destination, fields);
    number("size", transfer.size, fields);
    if let Some(announced) = transfer.announced {
        number("announced", announced, fields);
    }
    if let Some(packets) = transfer.packets {
        number("packets", packets, fields);
    }
    for (key, count) in [("missing_packets", transfer.missing), ("repeated_packets", transfer.repeated)] {
        if count > 0 {
            number(key, count, fields);
        }
    }
    if let Some((shortest, longest)) = transfer.spacing {
        fields.field("shortest_gap", FieldValue::Seconds(shortest));
        fields.field("longest_gap", FieldValue::Seconds(longest));
    }
    fields.field("data", FieldValue::Bytes(&transfer.data));
    fields.field("duration", transfer.duration.map_or(FieldValue::Null, FieldValue::Seconds));
    fields.field("outcome", FieldValue::Text(transfer.outcome.name()));
    if let Some(timer) = transfer.timer {
        fields.field("timer", FieldValue::Text(timer.name()));
    }
    if let Some(abort) = transfer.abort {
        fields.open("abort");
        fields.field("code", FieldValue::Code(u64::from(abort.reason), 2));
        fields.field("by", FieldValue::Text(if abort.by_sender { "sender" } else { "receiver" }));
        fields.field("text", FieldValue::Text(profile::transport_aborts().text(u32::from(abort.reason))));
        fields.close();
    }
    super::transfer::cut(transfer.cut_start, transfer.cut_end, fields);
    if transfer.truncated {
        fields.field("truncated", FieldValue::Bool(true));
    }
    if let Some(layout) = transfer.layout.as_deref().filter(|_| fields.wants_signals()) {
        signals(layout, &transfer.data, fields);
    }
}

pub(super) fn j1939_request(request: &J1939Request, fields: &mut dyn Fields) {
    group(Some(request.pgn), request.name.as_deref(), fields);
    addresses(request.source, request.destination, fields);
}

pub(super) fn acknowledgement(answer: &J1939Acknowledgement, fields: &mut dyn Fields) {
    fields.field("control", FieldValue::Text(answer.control()));
    group(Some(answer.message.pgn), answer.name.as_deref(), fields);
    addresses(answer.source, answer.destination, fields);
    number("address", answer.message.address, fields);
    number("group_function", answer.message.group_function, fields);
}

fn name_fields(name: Name, fields: &mut dyn Fields) {
    fields.field("name", FieldValue::Code(name.0, 16));
    let parts = name.fields();
    fields.open("name_fields");
    number("identity_number", parts.identity_number, fields);
    number("manufacturer_code", parts.manufacturer_code, fields);
    number("ecu_instance", parts.ecu_instance, fields);
    number("function_instance", parts.function_instance, fields);
    number("function", parts.function, fields);
    number("device_class", parts.device_class, fields);
    number("device_class_instance", parts.device_class_instance, fields);
    number("industry_group", parts.industry_group, fields);
    fields.field("arbitrary_address_capable", FieldValue::Bool(parts.arbitrary_address_capable));
    fields.close();
}

pub(super) fn address_claim(claim: &AddressClaim, fields: &mut dyn Fields) {
    fields.field("action", FieldValue::Text(claim.action.name()));
    number("source_address", claim.source, fields);
    if let Some(from) = claim.from {
        number("from", from, fields);
    }
    name_fields(claim.name, fields);
    if let Some(contention) = claim.contention {
        fields.open("contention");
        fields.field("other", FieldValue::Code(contention.other.0, 16));
        fields.field("winner", FieldValue::Code(contention.winner.0, 16));
        fields.close();
    }
    if claim.commanded != 0 {
        number("cause_frame", claim.commanded, fields);
    }
}

pub(super) fn commanded_address(command: &CommandedAddress, fields: &mut dyn Fields) {
    number("source_address", command.source, fields);
    number("address", command.address, fields);
    if let Some(present) = command.present {
        number("from", present, fields);
    }
    name_fields(command.name, fields);
}

pub(super) fn trouble_code(dtc: &Dtc, event: &Event, bus: &Bus, fields: &mut dyn Fields) {
    number("source_address", dtc.source, fields);
    number("spn", dtc.spn, fields);
    if let Some(parameter) = bus.parameter(dtc.spn) {
        fields.field("spn_name", FieldValue::Text(&parameter.name));
    }
    number("fmi", dtc.fmi, fields);
    fields.field("count", dtc.count.map_or(FieldValue::Null, |count| FieldValue::Unsigned(u64::from(count))));
    fields.field("action", FieldValue::Text(dtc.action.name()));
    if let Some(own) = device(event, bus).dtc(dtc.spn, dtc.fmi) {
        fields.field("text", FieldValue::Text(&own.text));
    }
    if let Some(mode) = profile::failure_modes().find(u32::from(dtc.fmi)) {
        fields.field("fmi_text", FieldValue::Text(&mode.text));
    }
    fields.open_list("lamps");
    for lamp in &dtc.lamps {
        fields.field("", FieldValue::Text(lamp));
    }
    fields.close_list();
    if dtc.is_old_coding {
        fields.field("assumed", FieldValue::Bool(true));
    }
    if dtc.may_be_hidden {
        fields.field("may_be_hidden", FieldValue::Bool(true));
    }
    if dtc.by_silence {
        fields.field("by_silence", FieldValue::Bool(true));
    }
    number("first_frame", dtc.first_frame, fields);
    number("last_frame", dtc.last_frame, fields);
    if let Some(since) = dtc.since {
        fields.field("since", FieldValue::Seconds(since));
    }
}

pub(super) fn message_gap(gap: &MessageGap, fields: &mut dyn Fields) {
    fields.field("message", FieldValue::Text(&gap.message));
    group(Some(gap.pgn), None, fields);
    number("source_address", gap.source, fields);
    fields.field("gap", FieldValue::Seconds(gap.gap));
    fields.field("limit", FieldValue::Seconds(gap.limit));
    if let Some((usual, deviation)) = gap.usual {
        fields.field("usual", FieldValue::Seconds(usual));
        fields.field("deviation", FieldValue::Seconds(deviation));
    }
    fields.field("came_again", FieldValue::Bool(gap.came_again));
}

pub(super) fn irregularity(irregularity: &Irregularity, fields: &mut dyn Fields) {
    fields.field("what", FieldValue::Text(irregularity.what.name()));
    fields.field("message", FieldValue::Text(irregularity.message));
    if irregularity.pgn.is_some() {
        group(irregularity.pgn, None, fields);
    }
    let numbers = [
        ("source_address", irregularity.source.map(u32::from)),
        ("destination_address", irregularity.destination.map(u32::from)),
        ("packet", irregularity.packet),
        ("expected", irregularity.expected),
    ];
    for (key, known) in numbers {
        if let Some(known) = known {
            number(key, known, fields);
        }
    }
    if let Some(timer) = irregularity.timer {
        fields.field("timer", FieldValue::Text(timer.name()));
    }
    if let Some(delay) = irregularity.delay {
        fields.field("delay", FieldValue::Seconds(delay));
    }
}
