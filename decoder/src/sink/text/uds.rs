//! Text of ISO-TP messages and UDS exchanges.

use std::fmt::Write as _;

use super::Tone;
use super::parts::{EventWords, bytes, millis, seconds};
use super::transfer::TransferWords;
use crate::event::{Endpoints, Event, ExchangeOutcome, IsoTpTransfer, MessageOutcome, UdsExchange};
use crate::profile::{Device, Effect, UdsService, Value, ValueIn, uds};
use crate::query::record::device as device_of;
use crate::session::Bus;
use crate::words::plural;

pub(super) fn exchange(exchange: &UdsExchange, event: &Event, bus: &Bus) -> EventWords {
    let (what, tone) = exchange_words(exchange, device_of(event, bus));
    EventWords { who: talk(exchange, event, bus), kind: "UDS", what, tone }
}

/// `F1`; with another network number `1:F1`.
fn address(address: u16) -> String {
    let [net, node] = address.to_be_bytes();
    if net == 0 { format!("{node:02X}") } else { format!("{net}:{node:02X}") }
}

/// `F1→20`; the server name if the bus file defines the identifiers.
fn path(ends: &Endpoints) -> String {
    match (ends.source, ends.target, &ends.server) {
        (Some(source), Some(target), _) => {
            let group = if ends.functional { " (all)" } else { "" };
            format!("{}→{}{group}", address(source), address(target))
        }
        (_, _, Some(server)) => server.to_string(),
        _ if ends.functional => "all".to_owned(),
        _ => String::new(),
    }
}

/// `tester F1→20`, `tester F1→20 boom`, `tester→ECU`.
fn talk(exchange: &UdsExchange, event: &Event, bus: &Bus) -> String {
    let path = path(&exchange.ends);
    if exchange.ends.source.is_none() {
        return format!("tester→{path}");
    }
    let node = event.node.and_then(|node| bus.node(node).and_then(|node| node.name()));
    node.map_or_else(|| format!("tester {path}"), |name| format!("tester {path} {name}"))
}

pub(super) fn isotp(message: &IsoTpTransfer) -> EventWords {
    let mut what = format!("{} of {}", message.size, plural(message.announced, "byte"));
    let (outcome, tone) = match message.outcome {
        MessageOutcome::Complete => (" complete", Tone::Quiet),
        MessageOutcome::Incomplete => (", frames missing", Tone::Caution),
        MessageOutcome::NoFlowControl => (", NO FLOW CONTROL", Tone::Bad),
        MessageOutcome::Timeout => (", TIME-OUT: sender stopped", Tone::Bad),
        MessageOutcome::Overflow => (", REFUSED: receiver buffer too small", Tone::Bad),
        MessageOutcome::Superseded => (", superseded by a new message", Tone::Caution),
        MessageOutcome::Unfinished => (", unfinished at end of capture", Tone::Caution),
    };
    what.push_str(outcome);
    if message.waits > 0 {
        let _ = write!(what, " ({} × wait)", message.waits);
    }
    if !message.data.is_empty() {
        let _ = write!(what, ": {}", bytes(&message.data));
    }
    EventWords { who: path(&message.ends), kind: "ISO-TP", what, tone }
}

fn exchange_words(exchange: &UdsExchange, device: &Device) -> (String, Tone) {
    let mut what = format!("{:02X}", exchange.service);
    let known = uds().service(exchange.service);
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
    what.push_str(&content(exchange));
    let tone = outcome(exchange, device, &mut what);
    times(exchange, &mut what);
    what.push_str(&effect(exchange));
    (what, tone)
}

/// ` | active now`.
fn effect(exchange: &UdsExchange) -> String {
    match exchange.effect {
        None => String::new(),
        Some(Effect::AtOnce) => " | active now".to_owned(),
        Some(Effect::Never) => " | accepted without effect".to_owned(),
        Some(effect) => format!(" | active {}", effect.when()),
    }
}

/// An exchange with its value or failure first; the latency is left out.
pub(super) fn transfer(exchange: &UdsExchange, device: &Device) -> TransferWords {
    let identifier = exchange.identifier.map_or(String::new(), |identifier| format!(" {identifier:04X}"));
    let service = uds().service(exchange.service).map_or("", |service| service.name.as_str());
    let names = [service, exchange.name().unwrap_or_default()];
    let data = format!("{}{}", sub_function(exchange), content(exchange));
    let mut failure = String::new();
    outcome(exchange, device, &mut failure);
    let result = match failure.strip_prefix(" ok") {
        Some(remark) => format!("{data}{remark}"),
        None if data.trim().is_empty() => failure,
        None => format!(
            "{failure},{}",
            data.strip_prefix(" = ").map_or(data.clone(), |value| format!(" {value}"))
        ),
    };
    let mut remarks = String::new();
    pending(exchange, &mut remarks);
    TransferWords {
        object: format!("{:02X}{identifier}", exchange.service),
        name: names.into_iter().filter(|name| !name.is_empty()).collect::<Vec<_>>().join(" "),
        result: format!("{result}{remarks}{}", effect(exchange)).trim_start().to_owned(),
    }
}

/// ` extended-session`, ` 05`.
fn sub_function(exchange: &UdsExchange) -> String {
    let Some(sub_function) = exchange.sub_function else { return String::new() };
    let name = uds().sub_function(exchange.service, sub_function.value);
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
fn content(exchange: &UdsExchange) -> String {
    let shown = exchange.decoded().filter(|value| !matches!(value, Value::Bytes(_)));
    if let Some(value) = shown {
        return match exchange.meaning.as_deref() {
            Some(meaning) if meaning.is_outside(&value) => format!(" = {} (outside)", meaning.show(&value)),
            Some(meaning) => format!(" = {}", meaning.show(&value)),
            None => format!(" = {}", short(&value)),
        };
    }
    let service = uds().service(exchange.service);
    let rest_of = |data: &[u8], is_response: bool| {
        let rest = data.get(1..).unwrap_or_default();
        let shape = service.map(|service| if is_response { service.response() } else { service.request() });
        bytes(shape.map_or(rest, |shape| shape.record(rest)))
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
fn short(value: &Value) -> String {
    match value {
        Value::Text(text) if text.chars().count() > SHOWN_CHARACTERS => {
            let begin: String = text.chars().take(SHOWN_CHARACTERS).collect();
            format!("{} …", Value::Text(begin))
        }
        value => value.to_string(),
    }
}

fn outcome(exchange: &UdsExchange, device: &Device, what: &mut String) -> Tone {
    match (exchange.outcome, exchange.nrc) {
        (ExchangeOutcome::Negative | ExchangeOutcome::Unsolicited, Some(code)) => {
            let standard = uds().code(code).map_or("unknown code", |known| known.text.as_str());
            let _ = match device.uds.nrc(code, exchange.service, exchange.identifier) {
                Some(own) if own.text != standard => {
                    write!(what, " REFUSED {code:02X}: {} (ISO 14229: {standard})", own.text)
                }
                _ => write!(what, " REFUSED {code:02X}: {standard}"),
            };
            if exchange.outcome == ExchangeOutcome::Unsolicited {
                what.push_str(" (request not captured)");
            }
            Tone::Bad
        }
        (ExchangeOutcome::Positive | ExchangeOutcome::Negative, _) => {
            what.push_str(" ok");
            Tone::Plain
        }
        (ExchangeOutcome::Unsolicited, _) => {
            what.push_str(" ok (request not captured)");
            Tone::Caution
        }
        (ExchangeOutcome::NoAnswer, _) => {
            what.push_str(" NO RESPONSE");
            Tone::Bad
        }
        (ExchangeOutcome::Suppressed, _) => {
            what.push_str(" response suppressed by the request");
            Tone::Quiet
        }
        (ExchangeOutcome::Unfinished, _) => {
            what.push_str(" unfinished at end of capture");
            Tone::Caution
        }
    }
}

/// Appends ` dt=8.0ms` or ` (2 × pending, 4.200 s)`, and a note on truncated data.
fn times(exchange: &UdsExchange, what: &mut String) {
    let latency = exchange.latency.filter(|_| exchange.pending == 0);
    pending(exchange, what);
    if let Some(latency) = latency {
        let _ = write!(what, " dt={}ms", millis(latency));
    }
}

/// Appends ` (2 × pending, 4.200 s)`, and a note on truncated data.
fn pending(exchange: &UdsExchange, what: &mut String) {
    if exchange.request.iter().chain(&exchange.response).any(|message| message.truncated) {
        what.push_str(" (data truncated)");
    }
    let _ = match (exchange.pending, exchange.latency) {
        (0, _) => Ok(()),
        (pending, Some(latency)) => write!(what, " ({pending} × pending, {} s)", seconds(latency)),
        (pending, None) => write!(what, " ({pending} × pending)"),
    };
}
