//! Explains one frame: the meaning of its identifier, and its events.

use std::fmt::Write as _;
use std::sync::Arc;

use cobscope_decoder::bus_file::{InitialValue, ObjectValue};
use cobscope_decoder::capture::{Batch, BatchItem, BusNames, CaptureReader, ReadOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags};
use cobscope_decoder::profile::device::MessageDirection;
use cobscope_decoder::profile::object::NumberList;
use cobscope_decoder::profile::{
    self, DecodedValue, DeviceProfile, EntryResolver, IdentifierOwner, NoValues,
};
use cobscope_decoder::session::{AssignedBy, Assignment, Bus, ProtocolChoice, SessionOptions};
use cobscope_decoder::sink::EventSink as _;
use cobscope_decoder::sink::text::{PdoLines, TextOptions, TextSink};
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::sdo::{self, InitiateData, SdoMessage, SdoSide, TransferPhase};
use cobscope_decoder::wire::isotp::IsoTpAddresses;
use cobscope_decoder::wire::j1939::J1939Id;
use cobscope_decoder::words::count_noun;

use super::asked::LookupScope;
use super::{code, identifier, j1939, uds};
use crate::run::describe::{FIRM, object::equality_text};

/// Bit of SocketCAN that marks error frames.
const ERROR_FLAG: u32 = 0x2000_0000;

/// Explains a frame in candump's log form; `None` if the text is not a frame.
pub(super) fn explain_frame(thing: &str, asked: &LookupScope) -> Option<String> {
    explain_line(&format!("can0 {thing}\n"), &ReadOptions::default(), asked)
}

/// Explains a line of any capture, such as `601 40 41 60 00 00 00 00 00`; `None` if the text is not a frame.
pub(super) fn explain_pasted(thing: &str, asked: &LookupScope) -> Option<String> {
    let line = format!("{thing}\n");
    let words: Vec<&str> = thing.split_whitespace().collect();
    let is_hex = |word: &&str| word.bytes().all(|byte| byte.is_ascii_hexdigit());
    let is_byte = |word: &&str| word.len() == 2 && is_hex(word);
    // One line alone does not prove that its first number is an identifier, but the user asks about a frame.
    let columns = match words.as_slice() {
        [id, data @ ..] if is_hex(id) && matches!(id.len(), 3..=8) && data.iter().all(is_byte) => {
            "id data".parse().ok()
        }
        _ => None,
    };
    explain_line(&line, &ReadOptions { columns, ..ReadOptions::default() }, asked)
}

/// Explains the frames of a line.
fn explain_line(line: &str, options: &ReadOptions, asked: &LookupScope) -> Option<String> {
    let mut reader = CaptureReader::open(line.as_bytes(), options).ok()?;
    let mut batch = Batch::new();
    let mut readings = Vec::new();
    while reader.read(&mut batch).ok()? {
        for item in batch.items() {
            let BatchItem::Frame(frame) = item else { continue };
            let head = match (uds::explain_frame(frame, asked), frame.id) {
                _ if frame.flags.contains(FrameFlags::ERROR) => {
                    let class = frame.id.number() | ERROR_FLAG;
                    format!("{class:08X}  error frame of SocketCAN (linux/can/error.h)\n")
                }
                (Some(isotp), _) => isotp,
                (None, CanId::Standard(id)) => {
                    identifier::explain_identifier(id) + &explain_command(frame, asked)
                }
                (None, CanId::Extended(id)) => j1939::explain_identifier(id).unwrap_or_default(),
            };
            let mut codes = Vec::new();
            let options = session_options(frame.id, asked);
            let lines = decode_lines(frame, reader.buses(), options, true, |event| {
                codes.extend(explain_event(event, asked));
            });
            readings.push(format!("{head}{lines}"));
            readings.extend(by_mode(frame, reader.buses(), asked));
            readings.extend(codes);
        }
    }
    (!readings.is_empty()).then(|| readings.join("\n"))
}

/// Defect of a wrong frame with `#`: the part with other characters than hexadecimal digits, or its length.
pub(super) fn frame_defect(thing: &str) -> Option<String> {
    let (id, data) = thing.split_once('#')?;
    let quoted = |text: &str| text.escape_debug().to_string();
    let is_hex = |text: &str| text.bytes().all(|byte| byte.is_ascii_hexdigit());
    if !is_hex(id) || !matches!(id.len(), 3..=8) {
        return Some(format!("identifier \"{}\"; expected 3 to 8 hex digits", quoted(id)));
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
fn decode_lines(
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
    let mut text = TextSink::new(&mut lines, options);
    // Without `finish`: a single frame of a transfer is not an unfinished transfer.
    decoder.push(frame, names, &mut |event: &Event, bus: &Bus| {
        if verbose || matches!(event.kind, EventKind::Pdo(_) | EventKind::J1939Message(_)) {
            text.write_event(event, bus);
        }
        see(event);
    });
    // Writing to memory cannot fail.
    let _ = text.finish_output();
    drop(text);
    String::from_utf8_lossy(&lines).into_owned()
}

/// A PDO whose contents depend on an object of the device, decoded for each value of the object.
fn by_mode(frame: &Frame, names: &BusNames, asked: &LookupScope) -> Option<String> {
    let device = asked.device.as_ref()?;
    let CanId::Standard(id) = frame.id else { return None };
    let IdentifierOwner::Pdo(name, node) = profile::connection_set().owner_of(id) else { return None };
    let mut text = String::new();
    for pdo in device.pdos.iter().filter(|pdo| pdo.pdo == name && !pdo.fields.is_empty()) {
        let Some(when) = &pdo.when else { continue };
        let values = match &when.equals {
            NumberList::One(one) => std::slice::from_ref(one),
            NumberList::Any(any) => any.as_slice(),
        };
        for value in values {
            let object = when.object.object;
            let mut options = session_options(frame.id, asked);
            options.bus_file.everywhere.objects.push(InitialValue::new(
                node.into(),
                object,
                ObjectValue::Number(*value),
            ));
            let heading = equality_text(device, object, &NumberList::One(*value), "=");
            let lines = decode_lines(frame, names, options, false, |_| {});
            let _ = write!(text, "if {}:\n{lines}", heading.replace(FIRM, " "));
        }
    }
    (!text.is_empty()).then_some(text)
}

/// Session options that assign the device to the nodes of the frame.
fn session_options(id: CanId, asked: &LookupScope) -> SessionOptions {
    let assign = |device: &Arc<DeviceProfile>| {
        let one =
            |node: NodeId| Assignment { bus: None, node, device: Arc::clone(device), by: AssignedBy::Option };
        frame_nodes(id, device).into_iter().map(one).collect()
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
fn frame_nodes(id: CanId, device: &DeviceProfile) -> Vec<NodeId> {
    let id = match id {
        CanId::Extended(id) => return frame_addresses(id, device),
        CanId::Standard(_) if device.pdos.iter().any(|pdo| pdo.cob_id.is_some()) => {
            return (1..=127).map(NodeId::Canopen).collect();
        }
        CanId::Standard(id) => id,
    };
    match profile::connection_set().owner_of(id) {
        IdentifierOwner::Emcy(node)
        | IdentifierOwner::Pdo(_, node)
        | IdentifierOwner::Sdo(_, node)
        | IdentifierOwner::ErrorControl(node) => {
            vec![node.into()]
        }
        _ => Vec::new(),
    }
}

/// Source and destination address of a J1939 message.
fn frame_addresses(id: u32, device: &DeviceProfile) -> Vec<NodeId> {
    if let Some(found) = IsoTpAddresses::from_identifier(id) {
        let ends = [found.source, found.target].into_iter().filter_map(|address| u8::try_from(address).ok());
        return ends.map(NodeId::Canopen).filter(|node| node.is_valid()).collect();
    }
    let Some(id) = J1939Id::from_identifier(id) else { return Vec::new() };
    let [first, last] = device.j1939.addresses.unwrap_or([0, 253]);
    let takes = |address: &u8| {
        let mut messages = device.messages.iter();
        messages.any(|it| it.direction == MessageDirection::Receive && it.is_for(id.pgn, *address))
    };
    let receiver = (first..=last).find(takes).filter(|_| !device.messages.is_empty());
    receiver.into_iter().chain([id.source]).map(NodeId::J1939).filter(|node| node.is_valid()).collect()
}

/// Explanation of the error code in an event.
fn explain_event(event: &Event, asked: &LookupScope) -> Option<String> {
    match &event.kind {
        EventKind::Emcy(emergency) => {
            let code = emergency.code.filter(|code| *code != 0)?;
            code::explain_emcy(asked, code, false)
        }
        EventKind::Dtc(dtc) => j1939::explain_fault(asked, &format!("{}/{}", dtc.spn, dtc.fmi)),
        EventKind::SdoTransfer(transfer) => Some(code::explain_abort(asked, transfer.abort?.code)),
        _ => None,
    }
}

/// The SDO command in a frame; the decoder reports only complete transfers.
fn explain_command(frame: &Frame, asked: &LookupScope) -> String {
    let CanId::Standard(id) = frame.id else { return String::new() };
    let IdentifierOwner::Sdo(side, _) = profile::connection_set().owner_of(id) else { return String::new() };
    command_text(frame.data(), side, asked)
}

/// Explains eight bytes without an identifier as a command of one side; `None` if the side has no such command.
pub(super) fn explain_sdo_bytes(
    data: &[u8],
    side: SdoSide,
    name: &str,
    asked: &LookupScope,
) -> Option<String> {
    let message = sdo::parse(data, side, TransferPhase::Commands).ok()?;
    let first = data.first().copied()?;
    // Upload requests have no further bits; responses state a size or data.
    let is_other_side = match side {
        SdoSide::Client => (0x41..=0x4F).contains(&first),
        SdoSide::Server => first == 0x40,
    };
    if is_other_side || matches!(message, SdoMessage::Unknown { .. }) {
        return None;
    }
    let text = command_text(data, side, asked);
    let mut text = format!("{name}: {}", text.trim_start());
    if let [0x80, _, _, _, code @ ..] = data
        && let Ok(code) = <[u8; 4]>::try_from(code)
    {
        text.push_str(&code::explain_abort(asked, u32::from_le_bytes(code)));
    }
    Some(text)
}

/// The command in the data of one side.
fn command_text(data: &[u8], side: SdoSide, asked: &LookupScope) -> String {
    let parsed = sdo::parse(data, side, TransferPhase::Commands);
    let mut text = match parsed {
        Ok(message) => format!("     {}\n{}", message.message_text(), carried_value(&message, asked)),
        Err(missing) => {
            let (needed, offset, available) = (missing.needed, missing.offset, missing.available);
            format!(
                "     too short for its command: needs {} from byte {offset}, found {available}\n",
                count_noun(needed, "byte")
            )
        }
    };
    if let Ok(SdoMessage::BlockSegment { sequence, last, .. }) =
        sdo::parse(data, side, TransferPhase::BlockSegments)
        && sequence > 0
        && matches!(
            parsed,
            Ok(SdoMessage::DownloadSegment(_) | SdoMessage::UploadSegment(_) | SdoMessage::Unknown { .. })
        )
    {
        let last = if last { " (last)" } else { "" };
        let _ = writeln!(text, "     within a block transfer: segment {sequence}{last}");
    }
    text
}

/// `     1017:00 Producer heartbeat time = 1000 ms`: object and value of a message; the value only if
/// complete.
fn carried_value(message: &SdoMessage<'_>, asked: &LookupScope) -> String {
    let (object, payload) = match message {
        SdoMessage::InitiateDownload { object, payload }
        | SdoMessage::UploadInitiated { object, payload } => (*object, Some(payload)),
        SdoMessage::DownloadInitiated { object }
        | SdoMessage::InitiateUpload { object }
        | SdoMessage::InitiateBlockDownload { object, .. }
        | SdoMessage::InitiateBlockUpload { object, .. } => (*object, None),
        _ => return String::new(),
    };
    let device = asked.device.as_ref().unwrap_or_else(|| profile::plain_device());
    let Some(meaning) = EntryResolver::new(&device.dictionary, &NoValues).resolve_meaning(object) else {
        return String::new();
    };
    let value = match payload {
        Some(InitiateData::Expedited { data, sized: true }) => match meaning.decode(data) {
            DecodedValue::Bytes(_) => String::new(),
            value => format!(" = {}", meaning.format_value(&value)),
        },
        _ => String::new(),
    };
    format!("     {object} {}{value}\n", meaning.name)
}
