//! Fields of ISO-TP messages and UDS exchanges.

use super::transfer::{value_field, visit_meaning};
use super::{FieldConsumer, FieldValue};
use crate::event::{IsoTpTransfer, UdsEndpoints, UdsExchange, UdsMessage};
use crate::profile::{DecodedValue, DeviceProfile, uds_names};

/// Addresses, split into node and network; network 0 (local) is omitted.
fn visit_endpoints(ends: &UdsEndpoints, fields: &mut dyn FieldConsumer) {
    let addresses = [
        ("source_address", "source_net", ends.source),
        ("destination_address", "destination_net", ends.target),
    ];
    for (key, net_key, address) in addresses {
        let Some(address) = address else { continue };
        let [net, node] = address.to_be_bytes();
        fields.add_field(key, FieldValue::Unsigned(u64::from(node)));
        if net != 0 {
            fields.add_field(net_key, FieldValue::Unsigned(u64::from(net)));
        }
    }
    if ends.functional {
        fields.add_field("functional", FieldValue::Bool(true));
    }
    if let Some(server) = &ends.server {
        fields.add_field("server", FieldValue::Text(server));
    }
}

fn visit_count(key: &'static str, count: u32, fields: &mut dyn FieldConsumer) {
    if count > 0 {
        fields.add_field(key, FieldValue::Unsigned(u64::from(count)));
    }
}

fn seconds_value(time: Option<i64>) -> FieldValue<'static> {
    time.map_or(FieldValue::Null, FieldValue::Seconds)
}

pub(super) fn isotp_transfer(message: &IsoTpTransfer, fields: &mut dyn FieldConsumer) {
    visit_endpoints(&message.ends, fields);
    fields.open_list("ids");
    fields.add_field("", FieldValue::Id(message.id));
    if let Some(flow_control) = message.flow_control {
        fields.add_field("", FieldValue::Id(flow_control));
    }
    fields.close_list();
    if let Some(address) = message.address_byte {
        fields.add_field("address_byte", FieldValue::Code(u64::from(address), 2));
    }
    fields.add_field("form", FieldValue::Text(if message.is_single { "single" } else { "segmented" }));
    fields.add_field("size", FieldValue::Unsigned(message.size));
    fields.add_field("announced", FieldValue::Unsigned(u64::from(message.announced)));
    fields.add_field("data", FieldValue::Bytes(&message.data));
    visit_count("waits", message.waits, fields);
    fields.add_field("duration", seconds_value(message.duration));
    fields.add_field("outcome", FieldValue::Text(message.outcome.name()));
    if let Some(timer) = message.outcome.timer() {
        fields.add_field("timer", FieldValue::Text(timer.name()));
    }
    if message.truncated {
        fields.add_field("truncated", FieldValue::Bool(true));
    }
}

pub(super) fn uds_exchange(exchange: &UdsExchange, device: &DeviceProfile, fields: &mut dyn FieldConsumer) {
    visit_endpoints(&exchange.ends, fields);
    fields.open_list("ids");
    for message in exchange.request.iter().chain(&exchange.response) {
        fields.add_field("", FieldValue::Id(message.id));
    }
    fields.close_list();
    let known = uds_names().service_by_id(exchange.service);
    fields.add_field("service", FieldValue::Text(known.map_or("unknown", |service| &service.name)));
    fields.add_field("service_id", FieldValue::Code(u64::from(exchange.service), 2));
    if let Some(sub_function) = exchange.sub_function {
        fields.add_field("sub_function", FieldValue::Code(u64::from(sub_function.value), 2));
        if let Some(name) = uds_names().sub_function(exchange.service, sub_function.value) {
            fields.add_field("sub_function_name", FieldValue::Text(name));
        }
        if sub_function.suppress_response {
            fields.add_field("suppress_response", FieldValue::Bool(true));
        }
    }
    if let Some(identifier) = exchange.identifier {
        fields.add_field("identifier", FieldValue::Code(u64::from(identifier), 4));
        if let Some(name) = exchange.name() {
            fields.add_field("name", FieldValue::Text(name));
        }
    }
    visit_value(exchange, fields);
    visit_message("request", "request_size", exchange.request.as_ref(), fields);
    visit_message("response", "response_size", exchange.response.as_ref(), fields);
    fields.add_field("outcome", FieldValue::Text(exchange.outcome.name()));
    if let Some(code) = exchange.nrc {
        visit_negative(exchange, code, device, fields);
    }
    visit_count("pending", exchange.pending, fields);
    fields.add_field("latency", seconds_value(exchange.latency));
    fields.add_field("duration", seconds_value(exchange.duration));
    if let Some(effect) = exchange.effect {
        fields.add_field("effective", FieldValue::Text(effect.name()));
    }
}

fn visit_value(exchange: &UdsExchange, fields: &mut dyn FieldConsumer) {
    match (exchange.decoded_value(), exchange.meaning.as_deref()) {
        (None | Some(DecodedValue::Bytes(_)), _) => {}
        (Some(value), Some(meaning)) => visit_meaning(meaning, &value, fields),
        (Some(value), None) => value_field("value", &value, fields),
    }
}

/// Bytes of a request or response; the size too if the bytes are truncated.
fn visit_message(
    key: &'static str,
    size_key: &'static str,
    message: Option<&UdsMessage>,
    fields: &mut dyn FieldConsumer,
) {
    let Some(message) = message else { return };
    fields.add_field(key, FieldValue::Bytes(&message.data));
    if message.truncated {
        fields.add_field(size_key, FieldValue::Unsigned(message.size));
    }
}

fn visit_negative(exchange: &UdsExchange, code: u8, device: &DeviceProfile, fields: &mut dyn FieldConsumer) {
    fields.add_field("nrc", FieldValue::Code(u64::from(code), 2));
    if let Some(known) = uds_names().code_entry(code) {
        fields.add_field("nrc_name", FieldValue::Text(&known.name));
        fields.add_field("nrc_text", FieldValue::Text(&known.text));
    }
    if let Some(own) = device.uds.response_code_entry(code, exchange.service, exchange.identifier) {
        fields.add_field("device_text", FieldValue::Text(&own.text));
    }
}
