//! Explains UDS negative response codes, identifiers, and ISO-TP frames with addresses.

use std::fmt::Write as _;

use cobscope_decoder::frame::{CanId, Frame};
use cobscope_decoder::profile::{self, DecodedValue, DeviceProfile};
use cobscope_decoder::wire::canopen::emcy::EmcyByteOrder;
use cobscope_decoder::wire::isotp::{self, AddressScheme, FlowStatus, IsoTpAddresses, IsoTpFrame};
use cobscope_decoder::wire::uds::{self, UdsPdu};
use cobscope_decoder::words::count_noun;

use super::asked::LookupScope;
use super::code::section_of;
use crate::run::describe::{TextBlock, section_text, uds as describe};

/// Note below a list of entries from profiles.
const MORE: &str = "(details: --device NAME)";

/// Explains `nrc:31` or `did:F190`; `None` for other text.
pub(super) fn explain_named(thing: &str, asked: &LookupScope) -> Option<String> {
    let (kind, number) = thing.split_once(':')?;
    let digits = number.strip_prefix("0x").or_else(|| number.strip_prefix("0X")).unwrap_or(number);
    match kind.to_ascii_lowercase().as_str() {
        "nrc" => u8::from_str_radix(digits, 16).ok().map(|code| explain_nrc(asked, code)),
        "did" => u16::from_str_radix(digits, 16).ok().map(|id| explain_identifier(asked, id)),
        _ => None,
    }
}

/// Explains bytes as a message of UDS, possibly in a single frame of ISO-TP; `None` for other bytes.
pub(super) fn explain_bytes(bytes: &[u8], asked: &LookupScope) -> Option<String> {
    let is_message = |data: &[u8]| match uds::parse(data) {
        Ok(
            UdsPdu::Negative { service, .. }
            | UdsPdu::Request { service, .. }
            | UdsPdu::Positive { service, .. },
        ) => profile::uds_names().service_by_id(service).is_some(),
        Err(_) => false,
    };
    let (how, data) = match isotp::parse(bytes, bytes.len()) {
        Ok(IsoTpFrame::Single { data }) if is_message(data) => ("UDS in a single frame", data),
        Ok(IsoTpFrame::First { data, .. }) if bytes.len() == 8 && is_message(data) => {
            ("UDS in a first frame", data)
        }
        _ if bytes.len() >= 2 && bytes.len() != 8 && is_message(bytes) => ("UDS", bytes),
        _ => return None,
    };
    let mut text = format!("{how}: {}\n", message_text(data, asked));
    if let Ok(UdsPdu::Negative { code, .. }) = uds::parse(data) {
        text.push_str(&explain_nrc(asked, code));
    }
    Some(text)
}

/// Explains a negative response code.
fn explain_nrc(asked: &LookupScope, code: u8) -> String {
    let standard = profile::uds_names().code_entry(code);
    let text = standard.map_or("undefined in ISO 14229-1", |entry| &entry.text);
    let mut block = TextBlock::new(&format!("{code:02X}"), &format!("UDS negative response: {text}"));
    block.push_line(standard.map_or("", |entry| &entry.hint));
    block.push_row("name", standard.map_or("", |entry| &entry.name));
    let texts = |device: &DeviceProfile| -> Vec<String> {
        let own = device.uds.nrc.iter().filter(|nrc| nrc.code == code);
        own.map(|nrc| {
            let of = describe::scope_text(nrc);
            let of = if of.is_empty() { of } else { format!("{of}: ") };
            format!("{of}{}  {}", nrc.text, section_text(&nrc.source))
        })
        .collect()
    };
    if let Some(device) = &asked.device {
        block.push_rows(&device.title, &texts(device));
    } else {
        let entries = asked.every_device(|device| {
            let texts = texts(device);
            (!texts.is_empty()).then(|| texts.join("; "))
        });
        block.push_list(&entries, MORE);
    }
    block.finish()
}

/// Explains a data or routine identifier.
fn explain_identifier(asked: &LookupScope, id: u16) -> String {
    let standard = profile::uds_names().identifier_name(id);
    let own = asked.device.as_ref().and_then(|device| Some((device, device.uds.identifier(id)?)));
    let name = own.map(|(_, own)| own.name.as_str()).or(standard).unwrap_or("not standardised");
    let mut block = TextBlock::new(&format!("{id:04X}"), &format!("UDS identifier: {name}"));
    if let Some((device, own)) = own {
        block.push_line(&describe::identifier_text(own));
        block.push_row("sent as", &sent_as(device, id));
        block.push_row("note", &own.note);
        block.push_row("section", &section_of(device, &own.source));
    } else if asked.device.is_none() {
        let entries = asked.every_device(|device| {
            let own = device.uds.identifier(id)?;
            Some(format!("{}: {}  {}", own.name, describe::identifier_text(own), section_text(&own.source)))
        });
        block.push_list(&entries, MORE);
    }
    block.finish()
}

fn sent_as(device: &DeviceProfile, id: u16) -> String {
    let [high, low] = id.to_be_bytes();
    match device.uds.order() {
        EmcyByteOrder::LsbFirst => format!("{low:02X} {high:02X}"),
        EmcyByteOrder::MsbFirst => String::new(),
    }
}

/// Source, target and message of an ISO-TP frame; `None` if its identifier is not an ISO-TP address.
pub(super) fn explain_frame(frame: &Frame, asked: &LookupScope) -> Option<String> {
    let CanId::Extended(id) = frame.id else { return None };
    let IsoTpAddresses { scheme, functional, source, target, .. } = IsoTpAddresses::from_identifier(id)?;
    let how = match scheme {
        AddressScheme::NormalFixed => "normal fixed addresses",
        AddressScheme::Net => "EDP and DP set: addresses with network numbers",
    };
    let group = if functional { "the group " } else { "" };
    let mut text =
        format!("ISO-TP from {} to {group}{} ({how})\n", address_text(source), address_text(target));
    let message = match isotp::parse(frame.data(), frame.data().len()) {
        Err(missing) => {
            let (needed, offset, available) = (missing.needed, missing.offset, missing.available);
            format!("too short: needs {} from byte {offset}, found {available}", count_noun(needed, "byte"))
        }
        Ok(IsoTpFrame::Single { data }) => format!("single frame: {}", message_text(data, asked)),
        Ok(IsoTpFrame::First { size, data }) => {
            format!("first frame of {}: {}", count_noun(size, "byte"), message_text(data, asked))
        }
        Ok(IsoTpFrame::Consecutive { sequence, .. }) => format!("consecutive frame {sequence}"),
        Ok(IsoTpFrame::FlowControl(control)) => {
            let status = match control.status {
                FlowStatus::Continue => "continue to send",
                FlowStatus::Wait => "wait",
                FlowStatus::Overflow => "overflow",
            };
            let block = match control.block_size {
                0 => "all frames".to_owned(),
                frames => count_noun(frames, "frame"),
            };
            let pause = control.separation_time() / 1_000;
            format!("flow control: {status}, {block}, {pause} µs minimum separation")
        }
        Ok(IsoTpFrame::Unknown { control }) => format!("undefined control byte {control:02X}"),
    };
    let _ = writeln!(text, "     {message}");
    Some(text)
}

/// `20`; with another network number `1:20`.
fn address_text(address: u16) -> String {
    let [net, node] = address.to_be_bytes();
    if net == 0 { format!("{node:02X}") } else { format!("{net}:{node:02X}") }
}

/// `request 2E write data by identifier 1001 node-ID`.
fn message_text(data: &[u8], asked: &LookupScope) -> String {
    let (kind, service, rest, shape) = match uds::parse(data) {
        Err(_) => return "too short for UDS".into(),
        Ok(UdsPdu::Negative { service, code }) => {
            let text = profile::uds_names().code_entry(code).map_or("", |code| &code.text);
            return format!("negative response to {}: {code:02X} {text}", service_title(service));
        }
        Ok(UdsPdu::Request { service, data }) => (
            "request",
            service,
            data,
            profile::uds_names().service_by_id(service).map(profile::UdsService::request),
        ),
        Ok(UdsPdu::Positive { service, data }) => (
            "positive response to",
            service,
            data,
            profile::uds_names().service_by_id(service).map(profile::UdsService::response),
        ),
    };
    let mut text = format!("{kind} {}", service_title(service));
    let shape = shape.unwrap_or_default();
    if let Some(sub_function) = shape.sub_function(rest) {
        let name = profile::uds_names().sub_function(service, sub_function.value).unwrap_or_default();
        let _ = write!(text, ", sub-function {:02X} {name}", sub_function.value);
    }
    let order = asked.device.as_ref().map_or(EmcyByteOrder::MsbFirst, |device| device.uds.order());
    if let Some(id) = shape.identifier(rest, order) {
        let own = asked.device.as_ref().and_then(|device| device.uds.identifier(id));
        let name = own.map(|own| own.name.as_str()).or_else(|| profile::uds_names().identifier_name(id));
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
        let _ = write!(text, ", data {}", DecodedValue::Bytes(record.to_vec()));
    }
    text.trim_end().to_owned()
}

fn service_title(service: u8) -> String {
    let title =
        profile::uds_names().service_by_id(service).map_or("unknown service", |service| &service.title);
    format!("{service:02X} {title}")
}
