//! Explains UDS negative response codes, identifiers, and ISO-TP frames with addresses.

use std::fmt::Write as _;

use cobscope_decoder::frame::{CanId, Frame};
use cobscope_decoder::profile::{self, Device, Value};
use cobscope_decoder::wire::canopen::emcy::ByteOrder;
use cobscope_decoder::wire::isotp::{self, Addresses, FlowStatus, IsoTp, Scheme};
use cobscope_decoder::wire::uds::{self, Uds};
use cobscope_decoder::words::plural;

use super::asked::LookupScope;
use super::code::section_of;
use crate::cmd::describe::{Block, section, uds as describe};

/// Note below a list of entries from profiles.
const MORE: &str = "(details: --device NAME)";

/// Explains `nrc:31` or `did:F190`; `None` for other text.
pub(super) fn named(thing: &str, asked: &LookupScope) -> Option<String> {
    let (kind, number) = thing.split_once(':')?;
    let digits = number.strip_prefix("0x").or_else(|| number.strip_prefix("0X")).unwrap_or(number);
    match kind.to_ascii_lowercase().as_str() {
        "nrc" => u8::from_str_radix(digits, 16).ok().map(|code| nrc(asked, code)),
        "did" => u16::from_str_radix(digits, 16).ok().map(|id| identifier(asked, id)),
        _ => None,
    }
}

/// Explains a negative response code.
fn nrc(asked: &LookupScope, code: u8) -> String {
    let standard = profile::uds().code(code);
    let text = standard.map_or("undefined in ISO 14229-1", |entry| &entry.text);
    let mut block = Block::new(&format!("{code:02X}"), &format!("UDS negative response: {text}"));
    block.line(standard.map_or("", |entry| &entry.hint));
    block.row("name", standard.map_or("", |entry| &entry.name));
    let texts = |device: &Device| -> Vec<String> {
        let own = device.uds.nrc.iter().filter(|nrc| nrc.code == code);
        own.map(|nrc| {
            let of = describe::of(nrc);
            let of = if of.is_empty() { of } else { format!("{of}: ") };
            format!("{of}{}  {}", nrc.text, section(&nrc.source))
        })
        .collect()
    };
    if let Some(device) = &asked.device {
        block.rows(&device.title, &texts(device));
    } else {
        let entries = asked.every_device(|device| {
            let texts = texts(device);
            (!texts.is_empty()).then(|| texts.join("; "))
        });
        block.list(&entries, MORE);
    }
    block.finish()
}

/// Explains a data or routine identifier.
fn identifier(asked: &LookupScope, id: u16) -> String {
    let standard = profile::uds().identifier(id);
    let own = asked.device.as_ref().and_then(|device| Some((device, device.uds.identifier(id)?)));
    let name = own.map(|(_, own)| own.name.as_str()).or(standard).unwrap_or("not standardised");
    let mut block = Block::new(&format!("{id:04X}"), &format!("UDS identifier: {name}"));
    if let Some((device, own)) = own {
        block.line(&describe::identifier(own));
        block.row("sent as", &sent_as(device, id));
        block.row("note", &own.note);
        block.row("section", &section_of(device, &own.source));
    } else if asked.device.is_none() {
        let entries = asked.every_device(|device| {
            let own = device.uds.identifier(id)?;
            Some(format!("{}: {}  {}", own.name, describe::identifier(own), section(&own.source)))
        });
        block.list(&entries, MORE);
    }
    block.finish()
}

fn sent_as(device: &Device, id: u16) -> String {
    let [high, low] = id.to_be_bytes();
    match device.uds.order() {
        ByteOrder::LsbFirst => format!("{low:02X} {high:02X}"),
        ByteOrder::MsbFirst => String::new(),
    }
}

/// Source, target and message of an ISO-TP frame; `None` if its identifier is not an ISO-TP address.
pub(super) fn frame(frame: &Frame, asked: &LookupScope) -> Option<String> {
    let CanId::Extended(id) = frame.id else { return None };
    let Addresses { scheme, functional, source, target, .. } = Addresses::of(id)?;
    let how = match scheme {
        Scheme::NormalFixed => "normal fixed addresses",
        Scheme::Net => "EDP and DP set: addresses with network numbers",
    };
    let group = if functional { "the group " } else { "" };
    let mut text = format!("ISO-TP from {} to {group}{} ({how})\n", address(source), address(target));
    let message = match isotp::parse(frame.data(), frame.data().len()) {
        Err(missing) => {
            let (needed, offset, available) = (missing.needed, missing.offset, missing.available);
            format!("too short: needs {} from byte {offset}, found {available}", plural(needed, "byte"))
        }
        Ok(IsoTp::Single { data }) => format!("single frame: {}", message(data, asked)),
        Ok(IsoTp::First { size, data }) => {
            format!("first frame of {}: {}", plural(size, "byte"), message(data, asked))
        }
        Ok(IsoTp::Consecutive { sequence, .. }) => format!("consecutive frame {sequence}"),
        Ok(IsoTp::FlowControl(control)) => {
            let status = match control.status {
                FlowStatus::Continue => "continue to send",
                FlowStatus::Wait => "wait",
                FlowStatus::Overflow => "overflow",
            };
            let block = match control.block_size {
                0 => "all frames".to_owned(),
                frames => plural(frames, "frame"),
            };
            let pause = control.separation() / 1_000;
            format!("flow control: {status}, {block}, {pause} µs minimum separation")
        }
        Ok(IsoTp::Unknown { control }) => format!("undefined control byte {control:02X}"),
    };
    let _ = writeln!(text, "     {message}");
    Some(text)
}

/// `20`; with another network number `1:20`.
fn address(address: u16) -> String {
    let [net, node] = address.to_be_bytes();
    if net == 0 { format!("{node:02X}") } else { format!("{net}:{node:02X}") }
}

/// `request 2E write data by identifier 1001 node-ID`.
fn message(data: &[u8], asked: &LookupScope) -> String {
    let (kind, service, rest, shape) = match uds::parse(data) {
        Err(_) => return "too short for UDS".into(),
        Ok(Uds::Negative { service, code }) => {
            let text = profile::uds().code(code).map_or("", |code| &code.text);
            return format!("negative response to {}: {code:02X} {text}", title(service));
        }
        Ok(Uds::Request { service, data }) => {
            ("request", service, data, profile::uds().service(service).map(profile::UdsService::request))
        }
        Ok(Uds::Positive { service, data }) => (
            "positive response to",
            service,
            data,
            profile::uds().service(service).map(profile::UdsService::response),
        ),
    };
    let mut text = format!("{kind} {}", title(service));
    let shape = shape.unwrap_or_default();
    if let Some(sub_function) = shape.sub_function(rest) {
        let name = profile::uds().sub_function(service, sub_function.value).unwrap_or_default();
        let _ = write!(text, ", sub-function {:02X} {name}", sub_function.value);
    }
    let order = asked.device.as_ref().map_or(ByteOrder::MsbFirst, |device| device.uds.order());
    if let Some(id) = shape.identifier(rest, order) {
        let own = asked.device.as_ref().and_then(|device| device.uds.identifier(id));
        let name = own.map(|own| own.name.as_str()).or_else(|| profile::uds().identifier(id));
        let _ = write!(text, ", identifier {id:04X}");
        if let Some(name) = name {
            let _ = write!(text, " {name}");
        }
        if own.is_none() && name.is_none() {
            let swapped = asked.every_device(|device| {
                let sent = shape.identifier(rest, device.uds.order())?;
                Some(format!("{sent:04X} {}", device.uds.identifier(sent)?.name))
            });
            let _ = write!(
                text,
                "{}",
                swapped.iter().fold(String::new(), |all, line| format!("{all}; of {line}"))
            );
        }
    }
    let record = shape.record(rest);
    if !record.is_empty() {
        let _ = write!(text, ", data {}", Value::Bytes(record.to_vec()));
    }
    text.trim_end().to_owned()
}

fn title(service: u8) -> String {
    let title = profile::uds().service(service).map_or("unknown service", |service| &service.title);
    format!("{service:02X} {title}")
}
