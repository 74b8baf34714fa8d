//! Explains one frame in candump's log form: the meaning of its identifier, and its events.

use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::bus_file::{InitialValue, ObjectValue};
use cobscope_decoder::capture::{Batch, BusNames, Item, ReadOptions, Reader};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::frame::{CanId, Frame};
use cobscope_decoder::profile::device::Direction;
use cobscope_decoder::profile::object::Numbers;
use cobscope_decoder::profile::{self, Device, NoValues, Owner, Resolver, Value};
use cobscope_decoder::session::{AssignedBy, Assignment, Bus, ProtocolChoice, SessionOptions};
use cobscope_decoder::sink::EventSink as _;
use cobscope_decoder::sink::text::{PdoLines, Text, TextOptions};
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::sdo::{self, Payload, Phase, Sdo};
use cobscope_decoder::wire::isotp::Addresses;
use cobscope_decoder::wire::j1939::J1939Id;
use cobscope_decoder::words::plural;

use super::asked::LookupScope;
use super::{code, identifier, j1939, uds};
use crate::cmd::describe::{FIRM, object::equals};

/// Explains a frame; `None` if the text is not a frame.
pub(super) fn frame(thing: &str, asked: &LookupScope) -> Option<String> {
    let line = format!("can0 {thing}\n");
    let mut reader = Reader::open(line.as_bytes(), &ReadOptions::default()).ok()?;
    let mut batch = Batch::new();
    let mut readings = Vec::new();
    while reader.read(&mut batch).ok()? {
        for item in batch.items() {
            let Item::Frame(frame) = item else { continue };
            let head = match (uds::frame(frame, asked), frame.id) {
                (Some(isotp), _) => isotp,
                (None, CanId::Standard(id)) => identifier::identifier(id) + &command(frame, asked),
                (None, CanId::Extended(id)) => j1939::identifier(id).unwrap_or_default(),
            };
            let mut codes = Vec::new();
            let options = options(frame.id, asked);
            let lines =
                decoded(frame, reader.buses(), options, true, |event| codes.extend(explained(event, asked)));
            readings.push(format!("{head}{lines}"));
            readings.extend(by_mode(frame, reader.buses(), asked));
            readings.extend(codes);
        }
    }
    (!readings.is_empty()).then(|| readings.join("\n"))
}

/// Defect of a wrong frame with `#`: the part with other characters than hexadecimal digits, or its length.
pub(super) fn defect(thing: &str) -> Option<String> {
    let (id, data) = thing.split_once('#')?;
    let quoted = |text: &str| text.escape_debug().to_string();
    let is_hex = |text: &str| text.bytes().all(|byte| byte.is_ascii_hexdigit());
    if !is_hex(id) || !matches!(id.len(), 3 | 8) {
        return Some(format!("identifier \"{}\"; expected 3 or 8 hex digits", quoted(id)));
    }
    // After ## one digit contains the flags of CAN FD.
    let data = data.strip_prefix('#').map_or(data, |data| data.get(1..).unwrap_or_default());
    let bytes = data.replace('.', "");
    let wrong: String = bytes.chars().filter(|digit| !digit.is_ascii_hexdigit()).collect();
    if !wrong.is_empty() {
        return Some(format!(
            "data digits \"{}\"; expected pairs of hex digits (0 to 9, A to F)",
            quoted(&wrong)
        ));
    }
    if !bytes.len().is_multiple_of(2) {
        return Some(format!("{} data digits; expected pairs of hex digits", bytes.len()));
    }
    Some(format!("{} data bytes; expected max 8, or a length of CAN FD after ##", bytes.len() / 2))
}

/// Event lines of the frame.
fn decoded(
    frame: &Frame,
    names: &BusNames,
    options: SessionOptions,
    verbose: bool,
    mut see: impl FnMut(&Event),
) -> String {
    let mut lines = Vec::new();
    let mut decoder = Decoder::new(options);
    let options =
        TextOptions { pdo: PdoLines::All, all: true, frames: true, verbose, ..TextOptions::default() };
    let mut text = Text::new(&mut lines, options);
    // Without `finish`: a single frame of a transfer is not an unfinished transfer.
    decoder.push(frame, names, &mut |event: &Event, bus: &Bus| {
        if verbose || matches!(event.kind, EventKind::Pdo(_) | EventKind::J1939Message(_)) {
            text.write(event, bus);
        }
        see(event);
    });
    // Writing to memory cannot fail.
    let _ = text.finish();
    drop(text);
    String::from_utf8_lossy(&lines).into_owned()
}

/// A PDO whose contents depend on an object of the device, decoded for each value of the object.
fn by_mode(frame: &Frame, names: &BusNames, asked: &LookupScope) -> Option<String> {
    let device = asked.device.as_ref()?;
    let CanId::Standard(id) = frame.id else { return None };
    let Owner::Pdo(name, node) = profile::connection_set().owner(id) else { return None };
    let mut text = String::new();
    for pdo in device.pdos.iter().filter(|pdo| pdo.pdo == name && !pdo.fields.is_empty()) {
        let Some(when) = &pdo.when else { continue };
        let values = match &when.equals {
            Numbers::One(one) => std::slice::from_ref(one),
            Numbers::Any(any) => any.as_slice(),
        };
        for value in values {
            let object = when.object.object;
            let mut options = options(frame.id, asked);
            options.bus_file.everywhere.objects.push(InitialValue::new(
                node.into(),
                object,
                ObjectValue::Number(*value),
            ));
            let heading = equals(device, object, &Numbers::One(*value), "=");
            let lines = decoded(frame, names, options, false, |_| {});
            let _ = write!(text, "if {}:\n{lines}", heading.replace(FIRM, " "));
        }
    }
    (!text.is_empty()).then_some(text)
}

/// Session options that assign the device to the nodes of the frame.
fn options(id: CanId, asked: &LookupScope) -> SessionOptions {
    let assign = |device: &Arc<Device>| {
        let one =
            |node: NodeId| Assignment { bus: None, node, device: Arc::clone(device), by: AssignedBy::Option };
        nodes(id, device).into_iter().map(one).collect()
    };
    SessionOptions {
        protocol: match id {
            CanId::Standard(_) => ProtocolChoice::Canopen,
            CanId::Extended(_) => ProtocolChoice::J1939,
        },
        assignments: asked.device.as_ref().map(assign).unwrap_or_default(),
        ..SessionOptions::default()
    }
}

/// Nodes of a frame; all nodes if the device has its own identifiers.
fn nodes(id: CanId, device: &Device) -> Vec<NodeId> {
    let id = match id {
        CanId::Extended(id) => return addresses(id, device),
        CanId::Standard(_) if device.pdos.iter().any(|pdo| pdo.cob_id.is_some()) => {
            return (1..=127).map(NodeId::Canopen).collect();
        }
        CanId::Standard(id) => id,
    };
    match profile::connection_set().owner(id) {
        Owner::Emcy(node) | Owner::Pdo(_, node) | Owner::Sdo(_, node) | Owner::ErrorControl(node) => {
            vec![node.into()]
        }
        _ => Vec::new(),
    }
}

/// Source and destination address of a J1939 message.
fn addresses(id: u32, device: &Device) -> Vec<NodeId> {
    if let Some(found) = Addresses::of(id) {
        let ends = [found.source, found.target].into_iter().filter_map(|address| u8::try_from(address).ok());
        return ends.map(NodeId::Canopen).filter(|node| node.is_valid()).collect();
    }
    let Some(id) = J1939Id::of(id) else { return Vec::new() };
    let [first, last] = device.j1939.addresses.unwrap_or([0, 253]);
    let takes = |address: &u8| {
        let mut messages = device.messages.iter();
        messages.any(|it| it.direction == Direction::Receive && it.concerns(id.pgn, *address))
    };
    let receiver = (first..=last).find(takes).filter(|_| !device.messages.is_empty());
    receiver.into_iter().chain([id.source]).map(NodeId::J1939).filter(|node| node.is_valid()).collect()
}

/// Explanation of the error code in an event.
fn explained(event: &Event, asked: &LookupScope) -> Option<String> {
    match &event.kind {
        EventKind::Emcy(emergency) => {
            let code = emergency.code.filter(|code| *code != 0)?;
            code::emcy(asked, code, false)
        }
        EventKind::Dtc(dtc) => j1939::fault(asked, &format!("{}/{}", dtc.spn, dtc.fmi)),
        EventKind::SdoTransfer(transfer) => Some(code::abort(asked, transfer.abort?.code)),
        _ => None,
    }
}

/// The SDO command in a frame; the decoder reports only complete transfers.
fn command(frame: &Frame, asked: &LookupScope) -> String {
    let CanId::Standard(id) = frame.id else { return String::new() };
    let Owner::Sdo(side, _) = profile::connection_set().owner(id) else { return String::new() };
    let parsed = sdo::parse(frame.data(), side, Phase::Commands);
    let mut text = match parsed {
        Ok(message) => format!("     {}\n{}", message.describe(), carried(&message, asked)),
        Err(missing) => {
            let (needed, offset, available) = (missing.needed, missing.offset, missing.available);
            format!(
                "     too short for its command: needs {} from byte {offset}, found {available}\n",
                plural(needed, "byte")
            )
        }
    };
    if let Ok(Sdo::BlockSegment { sequence, last, .. }) = sdo::parse(frame.data(), side, Phase::BlockSegments)
        && sequence > 0
        && matches!(parsed, Ok(Sdo::DownloadSegment(_) | Sdo::UploadSegment(_) | Sdo::Unknown { .. }))
    {
        let last = if last { " (last)" } else { "" };
        let _ = writeln!(text, "     within a block transfer: segment {sequence}{last}");
    }
    text
}

/// `     1017:00 Producer heartbeat time = 1000 ms`: object and value of a message; the value only if
/// complete.
fn carried(message: &Sdo<'_>, asked: &LookupScope) -> String {
    let (object, payload) = match message {
        Sdo::InitiateDownload { object, payload } | Sdo::UploadInitiated { object, payload } => {
            (*object, Some(payload))
        }
        Sdo::DownloadInitiated { object }
        | Sdo::InitiateUpload { object }
        | Sdo::InitiateBlockDownload { object, .. }
        | Sdo::InitiateBlockUpload { object, .. } => (*object, None),
        _ => return String::new(),
    };
    let device = asked.device.as_ref().unwrap_or_else(|| profile::plain_device());
    let Some(meaning) = Resolver::new(&device.dictionary, &NoValues).meaning(object) else {
        return String::new();
    };
    let value = match payload {
        Some(Payload::Expedited { data, sized: true }) => match meaning.decode(data) {
            Value::Bytes(_) => String::new(),
            value => format!(" = {}", meaning.show(&value)),
        },
        _ => String::new(),
    };
    format!("     {object} {}{value}\n", meaning.name)
}
