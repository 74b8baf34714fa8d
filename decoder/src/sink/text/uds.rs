//! Text of ISO-TP messages and UDS exchanges.

use std::fmt::Write as _;

use super::LineTone;
use super::parts::{EventWords, format_bytes, format_millis};
use super::transfer::TransferWords;
use crate::event::{Event, ExchangeOutcome, IsoTpTransfer, MessageOutcome, UdsEndpoints, UdsExchange};
use crate::figures::format_seconds;
use crate::profile::{DecodedValue, DeviceProfile, UdsService, ValueIn, WriteEffect, uds_names};
use crate::query::record::event_device as device_of;
use crate::session::Bus;
use crate::words::count_noun;

pub(super) fn exchange_line(exchange: &UdsExchange, event: &Event, bus: &Bus) -> EventWords {
    let (what, tone) = exchange_words(exchange, device_of(event, bus));
    EventWords { who: dialogue_text(exchange, event, bus), kind: "UDS", what, tone }
}

/// `F1`; with another network number `1:F1`.
fn address_text(address: u16) -> String {
    let [net, node] = address.to_be_bytes();
    if net == 0 { format!("{node:02X}") } else { format!("{net}:{node:02X}") }
}

/// `F1→20`; the server name if the bus file defines the identifiers.
fn path_text(ends: &UdsEndpoints) -> String {
    match (ends.source, ends.target, &ends.server) {
        (Some(source), Some(target), _) => {
            let group = if ends.functional { " (all)" } else { "" };
            format!("{}→{}{group}", address_text(source), address_text(target))
        }
        (_, _, Some(server)) => server.to_string(),
        _ if ends.functional => "all".to_owned(),
        _ => String::new(),
    }
}

/// `tester F1→20`, `tester F1→20 boom`, `tester→ECU`.
fn dialogue_text(exchange: &UdsExchange, event: &Event, bus: &Bus) -> String {
    let path = path_text(&exchange.ends);
    if exchange.ends.source.is_none() {
        return format!("tester→{path}");
    }
    let node = event.node.and_then(|node| bus.node(node).and_then(|node| node.name()));
    node.map_or_else(|| format!("tester {path}"), |name| format!("tester {path} {name}"))
}

pub(super) fn isotp_line(message: &IsoTpTransfer) -> EventWords {
    let mut what = format!("{} of {}", message.size, count_noun(message.announced, "byte"));
    let (outcome, tone) = match message.outcome {
        MessageOutcome::Complete => (" complete", LineTone::Quiet),
        MessageOutcome::Incomplete => (", frames missing", LineTone::Caution),
        MessageOutcome::NoFlowControl => (", NO FLOW CONTROL", LineTone::Bad),
        MessageOutcome::Timeout => (", TIME-OUT: sender stopped", LineTone::Bad),
        MessageOutcome::Overflow => (", REFUSED: receiver buffer too small", LineTone::Bad),
        MessageOutcome::Superseded => (", superseded by a new message", LineTone::Caution),
        MessageOutcome::Unfinished => (", unfinished at end of capture", LineTone::Caution),
    };
    what.push_str(outcome);
    if message.waits > 0 {
        let _ = write!(what, " ({} × wait)", message.waits);
    }
    if !message.data.is_empty() {
        let _ = write!(what, ": {}", format_bytes(&message.data));
    }
    EventWords { who: path_text(&message.ends), kind: "ISO-TP", what, tone }
}

fn exchange_words(exchange: &UdsExchange, device: &DeviceProfile) -> (String, LineTone) {
    let mut what = format!("{:02X}", exchange.service);
    let known = uds_names().service_by_id(exchange.service);
    if let Some(service) = known {
        let _ = write!(what, " {}", service.name);
    }
    what.push_str(&sub_function(exchange));
    if let Some(identifier) = exchange.identifier {
        let _ = write!(what, " {identifier:04X}");
        if let Some(name) = exchange.name() {
            let _ = write!(what, " {name}");
        }
    }
    what.push_str(&content_text(exchange));
    let tone = append_outcome(exchange, device, &mut what);
    append_times(exchange, &mut what);
    what.push_str(&effect_text(exchange));
    (what, tone)
}

/// ` | active now`.
fn effect_text(exchange: &UdsExchange) -> String {
    match exchange.effect {
        None => String::new(),
        Some(WriteEffect::AtOnce) => " | active now".to_owned(),
        Some(WriteEffect::Never) => " | accepted without effect".to_owned(),
        Some(effect) => format!(" | active {}", effect.time_text()),
    }
}

/// An exchange with its value or failure first; the latency is left out.
pub(super) fn transfer_words(exchange: &UdsExchange, device: &DeviceProfile) -> TransferWords {
    let identifier = exchange.identifier.map_or(String::new(), |identifier| format!(" {identifier:04X}"));
    let service = uds_names().service_by_id(exchange.service).map_or("", |service| service.name.as_str());
    let names = [service, exchange.name().unwrap_or_default()];
    let data = format!("{}{}", sub_function(exchange), content_text(exchange));
    let mut failure = String::new();
    append_outcome(exchange, device, &mut failure);
    let result = match failure.strip_prefix(" ok") {
        Some(remark) => format!("{data}{remark}"),
        None if data.trim().is_empty() => failure,
        None => format!(
            "{failure},{}",
            data.strip_prefix(" = ").map_or(data.clone(), |value| format!(" {value}"))
        ),
    };
    let mut remarks = String::new();
    append_pending(exchange, &mut remarks);
    TransferWords {
        object: format!("{:02X}{identifier}", exchange.service),
        name: names.into_iter().filter(|name| !name.is_empty()).collect::<Vec<_>>().join(" "),
        result: format!("{result}{remarks}{}", effect_text(exchange)).trim_start().to_owned(),
    }
}

/// ` extended-session`, ` 05`.
fn sub_function(exchange: &UdsExchange) -> String {
    let Some(sub_function) = exchange.sub_function else { return String::new() };
    let name = uds_names().sub_function(exchange.service, sub_function.value);
    let number = format!(" {:02X}", sub_function.value);
    match name {
        None => number,
        Some(name) if exchange.service == SECURITY_ACCESS => format!(" {name}{number}"),
        Some(name) => format!(" {name}"),
    }
}

/// Odd and even sub-functions are seed and key of a security level, so the number is printed too.
const SECURITY_ACCESS: u8 = 0x27;

/// ` = "WAUZ…"`, ` = 33`; the remaining bytes if the value is unknown.
fn content_text(exchange: &UdsExchange) -> String {
    let shown = exchange.decoded_value().filter(|value| !matches!(value, DecodedValue::Bytes(_)));
    if let Some(value) = shown {
        return match exchange.meaning.as_deref() {
            Some(meaning) if meaning.is_outside(&value) => {
                format!(" = {} (outside)", meaning.format_value(&value))
            }
            Some(meaning) => format!(" = {}", meaning.format_value(&value)),
            None => format!(" = {}", short_value(&value)),
        };
    }
    let service = uds_names().service_by_id(exchange.service);
    let rest_of = |data: &[u8], is_response: bool| {
        let rest = data.get(1..).unwrap_or_default();
        let shape = service.map(|service| if is_response { service.response() } else { service.request() });
        format_bytes(shape.map_or(rest, |shape| shape.record(rest)))
    };
    let request = exchange.request.as_ref().map_or(String::new(), |request| rest_of(&request.data, false));
    let is_read = service.and_then(UdsService::value_in) == Some(ValueIn::Response);
    let answered = exchange.response.as_ref().filter(|_| exchange.nrc.is_none());
    let response = answered.map_or(String::new(), |response| rest_of(&response.data, true));
    match (request.is_empty(), response.is_empty()) {
        (true, true) => String::new(),
        (true, false) if is_read => format!(" = {response}"),
        (true, false) => format!(" → {response}"),
        (false, true) => format!(" {request}"),
        (false, false) => format!(" {request} → {response}"),
    }
}

/// Maximum length of a text in a line, in characters.
const SHOWN_CHARACTERS: usize = 48;

/// A value, with a long text truncated.
fn short_value(value: &DecodedValue) -> String {
    match value {
        DecodedValue::Text(text) if text.chars().count() > SHOWN_CHARACTERS => {
            let begin: String = text.chars().take(SHOWN_CHARACTERS).collect();
            format!("{} …", DecodedValue::Text(begin))
        }
        value => value.to_string(),
    }
}

fn append_outcome(exchange: &UdsExchange, device: &DeviceProfile, what: &mut String) -> LineTone {
    match (exchange.outcome, exchange.nrc) {
        (ExchangeOutcome::Negative | ExchangeOutcome::Unsolicited, Some(code)) => {
            let standard = uds_names().code_entry(code).map_or("unknown code", |known| known.text.as_str());
            let _ = match device.uds.response_code_entry(code, exchange.service, exchange.identifier) {
                Some(own) if own.text != standard => {
                    write!(what, " REFUSED {code:02X}: {} (ISO 14229: {standard})", own.text)
                }
                _ => write!(what, " REFUSED {code:02X}: {standard}"),
            };
            if exchange.outcome == ExchangeOutcome::Unsolicited {
                what.push_str(" (request not captured)");
            }
            LineTone::Bad
        }
        (ExchangeOutcome::Positive | ExchangeOutcome::Negative, _) => {
            what.push_str(" ok");
            LineTone::Plain
        }
        (ExchangeOutcome::Unsolicited, _) => {
            what.push_str(" ok (request not captured)");
            LineTone::Caution
        }
        (ExchangeOutcome::NoAnswer, _) => {
            what.push_str(" NO RESPONSE");
            LineTone::Bad
        }
        (ExchangeOutcome::Suppressed, _) => {
            what.push_str(" response suppressed by the request");
            LineTone::Quiet
        }
        (ExchangeOutcome::Unfinished, _) => {
            what.push_str(" unfinished at end of capture");
            LineTone::Caution
        }
    }
}

/// Appends ` dt=8.0ms` or ` (2 × pending, 4.200 s)`, and a note on truncated data.
fn append_times(exchange: &UdsExchange, what: &mut String) {
    let latency = exchange.latency.filter(|_| exchange.pending == 0);
    append_pending(exchange, what);
    if let Some(latency) = latency {
        let _ = write!(what, " dt={}ms", format_millis(latency));
    }
}

/// Appends ` (2 × pending, 4.200 s)`, and a note on truncated data.
fn append_pending(exchange: &UdsExchange, what: &mut String) {
    if exchange.request.iter().chain(&exchange.response).any(|message| message.truncated) {
        what.push_str(" (data truncated)");
    }
    let _ = match (exchange.pending, exchange.latency) {
        (0, _) => Ok(()),
        (pending, Some(latency)) => write!(what, " ({pending} × pending, {} s)", format_seconds(latency)),
        (pending, None) => write!(what, " ({pending} × pending)"),
    };
}
