//! Fields of ISO-TP messages and UDS exchanges.

use super::transfer::{meant, value_field};
use super::{FieldValue, Fields};
use crate::event::{Endpoints, IsoTpTransfer, Message, UdsExchange};
use crate::profile::{Device, Value, uds};

/// Addresses, split into node and network; network 0 (local) is omitted.
fn ends(ends: &Endpoints, fields: &mut dyn Fields) {
    let addresses = [
        ("source_address", "source_net", ends.source),
        ("destination_address", "destination_net", ends.target),
    ];
    for (key, net_key, address) in addresses {
        let Some(address) = address else { continue };
        let [net, node] = address.to_be_bytes();
        fields.field(key, FieldValue::Unsigned(u64::from(node)));
        if net != 0 {
            fields.field(net_key, FieldValue::Unsigned(u64::from(net)));
        }
    }
    if ends.functional {
        fields.field("functional", FieldValue::Bool(true));
    }
    if let Some(server) = &ends.server {
        fields.field("server", FieldValue::Text(server));
    }
}

fn count(key: &'static str, count: u32, fields: &mut dyn Fields) {
    if count > 0 {
        fields.field(key, FieldValue::Unsigned(u64::from(count)));
    }
}

fn seconds(time: Option<i64>) -> FieldValue<'static> {
    time.map_or(FieldValue::Null, FieldValue::Seconds)
}

pub(super) fn isotp_transfer(message: &IsoTpTransfer, fields: &mut dyn Fields) {
    ends(&message.ends, fields);
    fields.open_list("ids");
    fields.field("", FieldValue::Id(message.id));
    if let Some(flow_control) = message.flow_control {
        fields.field("", FieldValue::Id(flow_control));
    }
    fields.close_list();
    if let Some(address) = message.address_byte {
        fields.field("address_byte", FieldValue::Code(u64::from(address), 2));
    }
    fields.field("form", FieldValue::Text(if message.is_single { "single" } else { "segmented" }));
    fields.field("size", FieldValue::Unsigned(message.size));
    fields.field("announced", FieldValue::Unsigned(u64::from(message.announced)));
    fields.field("data", FieldValue::Bytes(&message.data));
    count("waits", message.waits, fields);
    fields.field("duration", seconds(message.duration));
    fields.field("outcome", FieldValue::Text(message.outcome.name()));
    if let Some(timer) = message.outcome.timer() {
        fields.field("timer", FieldValue::Text(timer.name()));
    }
    if message.truncated {
        fields.field("truncated", FieldValue::Bool(true));
    }
}

pub(super) fn uds_exchange(exchange: &UdsExchange, device: &Device, fields: &mut dyn Fields) {
    ends(&exchange.ends, fields);
    fields.open_list("ids");
    for message in exchange.request.iter().chain(&exchange.response) {
        fields.field("", FieldValue::Id(message.id));
    }
    fields.close_list();
    let known = uds().service(exchange.service);
    fields.field("service", FieldValue::Text(known.map_or("unknown", |service| &service.name)));
    fields.field("service_id", FieldValue::Code(u64::from(exchange.service), 2));
    if let Some(sub_function) = exchange.sub_function {
        fields.field("sub_function", FieldValue::Code(u64::from(sub_function.value), 2));
        if let Some(name) = uds().sub_function(exchange.service, sub_function.value) {
            fields.field("sub_function_name", FieldValue::Text(name));
        }
        if sub_function.suppress_response {
            fields.field("suppress_response", FieldValue::Bool(true));
        }
    }
    if let Some(identifier) = exchange.identifier {
        fields.field("identifier", FieldValue::Code(u64::from(identifier), 4));
        if let Some(name) = exchange.name() {
            fields.field("name", FieldValue::Text(name));
        }
    }
    value(exchange, fields);
    message("request", "request_size", exchange.request.as_ref(), fields);
    message("response", "response_size", exchange.response.as_ref(), fields);
    fields.field("outcome", FieldValue::Text(exchange.outcome.name()));
    if let Some(code) = exchange.nrc {
        negative(exchange, code, device, fields);
    }
    count("pending", exchange.pending, fields);
    fields.field("latency", seconds(exchange.latency));
    fields.field("duration", seconds(exchange.duration));
    if let Some(effect) = exchange.effect {
        fields.field("effective", FieldValue::Text(effect.name()));
    }
}

fn value(exchange: &UdsExchange, fields: &mut dyn Fields) {
    match (exchange.decoded(), exchange.meaning.as_deref()) {
        (None | Some(Value::Bytes(_)), _) => {}
        (Some(value), Some(meaning)) => meant(meaning, &value, fields),
        (Some(value), None) => value_field("value", &value, fields),
    }
}

/// Bytes of a request or response; the size too if the bytes are truncated.
fn message(key: &'static str, size_key: &'static str, message: Option<&Message>, fields: &mut dyn Fields) {
    let Some(message) = message else { return };
    fields.field(key, FieldValue::Bytes(&message.data));
    if message.truncated {
        fields.field(size_key, FieldValue::Unsigned(message.size));
    }
}

fn negative(exchange: &UdsExchange, code: u8, device: &Device, fields: &mut dyn Fields) {
    fields.field("nrc", FieldValue::Code(u64::from(code), 2));
    if let Some(known) = uds().code(code) {
        fields.field("nrc_name", FieldValue::Text(&known.name));
        fields.field("nrc_text", FieldValue::Text(&known.text));
    }
    if let Some(own) = device.uds.nrc(code, exchange.service, exchange.identifier) {
        fields.field("device_text", FieldValue::Text(&own.text));
    }
}
