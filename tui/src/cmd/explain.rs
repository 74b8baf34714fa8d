//! `cobscope explain`: what a code, an identifier, an object or one pasted frame means.

use std::fmt::Write as _;
use std::io::Write as _;

use cobscope_decoder::capture::{Batch, Item, ReadOptions, Reader};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{CanId, Frame};
use cobscope_decoder::profile::{self, NothingKnown, Owner, PdoDirection, Resolver};
use cobscope_decoder::session::{Bus, ProtocolChoice, SessionOptions};
use cobscope_decoder::sink::text::{PdoLines, Text, TextOptions};
use cobscope_decoder::wire::canopen::ObjectAddress;
use cobscope_decoder::wire::canopen::sdo::{self, Phase, Side};

use crate::exit_code::Exit;

/// The forms that are understood, for who gave another one.
const FORMS: &str = "expected an SDO abort code (06020000), an EMCY code (8130), an object (1018:01, 1018sub1, \
                     1018h:01h), a COB-ID (185) or a frame (701#05)";

/// Runs the command: every reading that fits, the likeliest first.
pub fn run(thing: &str) -> Exit {
    let thing = thing.trim();
    let readings = if thing.contains('#') { frame(thing).into_iter().collect() } else { code(thing) };
    if readings.is_empty() {
        let shown = thing.escape_debug();
        let _ = writeln!(std::io::stderr(), "cobscope: explain: cannot read \"{shown}\": {FORMS}");
        return Exit::Usage;
    }
    // A closed pipe is no failure.
    let _ = std::io::stdout().write_all(readings.join("\n").as_bytes());
    Exit::Clean
}

/// The readings of something without `#`.
fn code(thing: &str) -> Vec<String> {
    if let Ok(address) = thing.parse::<ObjectAddress>()
        && (thing.contains(':') || thing.contains("sub"))
    {
        return vec![object(address)];
    }
    let digits = thing.strip_prefix("0x").or_else(|| thing.strip_prefix("0X")).unwrap_or(thing);
    let digits = digits.strip_suffix(['h', 'H']).unwrap_or(digits);
    let Ok(number) = u32::from_str_radix(digits, 16) else { return Vec::new() };
    match (u16::try_from(number), digits.len()) {
        (Ok(id), ..=3) if id <= 0x7FF => vec![identifier(id)],
        (Ok(number), 4) => four_digits(number),
        _ => vec![abort_code(number)],
    }
}

/// Four digits can be an object, an EMCY code, or an identifier with a zero in front.
fn four_digits(number: u16) -> Vec<String> {
    let address = ObjectAddress::new(number, 0);
    let known_object =
        profile::plain_device().dictionary.find(address).is_some() || (0x1000..0x2000).contains(&number);
    let known_code = profile::emcy_codes().find(u32::from(number)).is_some();
    let mut readings = Vec::new();
    if known_object {
        readings.push(object(address));
    }
    if known_code {
        readings.push(emcy_code(number));
    }
    if !known_object {
        readings.push(object(address));
    }
    if number <= 0x7FF {
        readings.push(identifier(number));
    }
    readings
}

fn abort_code(code: u32) -> String {
    let mut text = format!("{code:08X}  SDO abort code: ");
    match profile::abort_codes().find(code) {
        Some(entry) => {
            let _ = writeln!(text, "{}\n          {}", entry.text, entry.hint);
        }
        None => text.push_str("none of CiA 301; see the manual of the device\n"),
    }
    text
}

fn emcy_code(code: u16) -> String {
    let mut text = format!("{code:04X}  EMCY error code: ");
    match profile::emcy_codes().find(u32::from(code)) {
        Some(entry) => {
            let _ = writeln!(text, "{}\n      {}", entry.text, entry.hint);
        }
        None => text.push_str("none of CiA 301; see the manual of the device\n"),
    }
    text
}

fn object(address: ObjectAddress) -> String {
    let mut text = format!("{address}  object: ");
    match Resolver::new(&profile::plain_device().dictionary, &NothingKnown).meaning(address) {
        Some(meaning) => {
            text.push_str(&meaning.name);
            if let Some(data_type) = meaning.data_type {
                let _ = write!(text, ", {}", data_type.name());
            }
            if !meaning.unit.is_empty() {
                let _ = write!(text, ", in {}", meaning.unit);
            }
        }
        None => text.push_str(range(address.index)),
    }
    text.push('\n');
    text
}

/// What lies in a part of the object dictionary (CiA 301 table 43).
fn range(index: u16) -> &'static str {
    match index {
        0x0000..=0x0FFF => "data types",
        0x1000..=0x1FFF => "communication object, not defined by CiA 301",
        0x2000..=0x5FFF => "manufacturer specific: see the device's EDS or manual",
        0x6000..=0x9FFF => "device profile (CiA 4xx): see the device's EDS or manual",
        0xA000..=0xAFFF => "network variables",
        0xB000..=0xBFFF => "system variables",
        0xC000..=0xFFFF => "reserved",
    }
}

/// An 11-bit identifier by the predefined connection set.
fn identifier(id: u16) -> String {
    let set = profile::connection_set();
    let node = |node: u8| format!("node {node}/{node:02X}");
    let what = match set.owner(id) {
        Owner::Unclassified => "no default use in CANopen".into(),
        Owner::Named(name) => format!("{name} (not decoded)"),
        Owner::Nmt => "NMT command, from the NMT master".into(),
        Owner::Sync => "SYNC".into(),
        Owner::Time => "TIME".into(),
        Owner::Emcy(id) => format!("EMCY of {}", node(id)),
        Owner::Pdo(name, id) => {
            let verb = if name.direction == PdoDirection::Transmit { "sent" } else { "received" };
            format!("{name}, {verb} by {}", node(id))
        }
        Owner::Sdo(Side::Server, id) => format!("SDO response of {} (server to client)", node(id)),
        Owner::Sdo(Side::Client, id) => format!("SDO request to {} (client to server)", node(id)),
        Owner::ErrorControl(id) => format!("heartbeat, boot-up or guarding of {}", node(id)),
        Owner::Lss(true) => "LSS, from the master".into(),
        Owner::Lss(false) => "LSS, from a slave".into(),
    };
    let mut text = format!("{id:03X}  COB-ID by the predefined connection set: {what}\n");
    let is_free = matches!(set.owner(id), Owner::Unclassified | Owner::Named(_));
    if let Some(why) = set.restriction(id).filter(|_| is_free) {
        let _ = writeln!(text, "     restricted ({why}): must not be configured for another service");
    }
    text
}

/// A frame in candump's log form: what its identifier means, and what the decoder makes of it alone.
fn frame(thing: &str) -> Option<String> {
    let line = format!("can0 {thing}\n");
    let mut reader = Reader::open(line.as_bytes(), &ReadOptions::default()).ok()?;
    let mut batch = Batch::new();
    let mut decoder =
        Decoder::new(SessionOptions { protocol: ProtocolChoice::Canopen, ..SessionOptions::default() });
    let options =
        TextOptions { pdo: PdoLines::All, all: true, frames: true, verbose: true, ..TextOptions::default() };
    let mut lines = Vec::new();
    let mut head = String::new();
    {
        let mut text = Text::new(&mut lines, options);
        let mut see = |event: &Event, bus: &Bus| text.write(event, bus);
        while reader.read(&mut batch).ok()? {
            for item in batch.items() {
                let Item::Frame(frame) = item else { continue };
                if let CanId::Standard(id) = frame.id {
                    head = identifier(id);
                }
                head.push_str(&command(frame));
                decoder.push(frame, reader.buses(), &mut see);
            }
        }
        // Without `finish`: a single frame of a transfer is no unfinished transfer.
    }
    (decoder.frames() > 0).then(|| format!("{head}{}", String::from_utf8_lossy(&lines)))
}

/// An SDO frame's own message, which the decoder only tells of whole transfers.
fn command(frame: &Frame) -> String {
    let CanId::Standard(id) = frame.id else {
        return "29-bit identifier: no default use in CANopen\n".into();
    };
    let Owner::Sdo(side, _) = profile::connection_set().owner(id) else { return String::new() };
    let parsed = sdo::parse(frame.data(), side, Phase::Commands);
    let mut text = match parsed {
        Ok(message) => format!("     {}\n", message.describe()),
        Err(missing) => {
            let (needed, offset, available) = (missing.needed, missing.offset, missing.available);
            format!(
                "     too short for its command: {available} of {needed} bytes there from byte {offset}\n"
            )
        }
    };
    if let Ok(sdo::Sdo::BlockSegment { sequence, last, .. }) =
        sdo::parse(frame.data(), side, Phase::BlockSegments)
        && sequence > 0
        && matches!(
            parsed,
            Ok(sdo::Sdo::DownloadSegment(_) | sdo::Sdo::UploadSegment(_) | sdo::Sdo::Unknown { .. })
        )
    {
        let last = if last { ", the last one" } else { "" };
        let _ = writeln!(text, "     within a block transfer: segment {sequence}{last}");
    }
    text
}
