//! The payload of an event and its fields.
//!
//! ```text
//! event ─▶ its own layout (PDO, J1939, DBC) ─┐
//!      └─▶ its frame ─▶ layout of its identifier, else the table of its service ─▶ parts
//! ```

mod words;

use std::sync::Arc;

use cobscope_decoder::event::{EventKind, Protocol, SdoTransfer};
use cobscope_decoder::frame::{BusIndex, CanId, Frame, FrameFlags};
use cobscope_decoder::profile::{BitOrder, DataType, Field, Layout, Owner, connection_set, uds};
use cobscope_decoder::session::{Bus, Node};
use cobscope_decoder::wire::canopen::ObjectAddress;
use cobscope_decoder::wire::canopen::emcy::ByteOrder;
use cobscope_decoder::wire::canopen::sdo::Side;
use cobscope_decoder::wire::j1939::{J1939Id, Pgn};

pub(super) use self::words::abort_text;
use super::services::{self, Read, Service, Slot};
use crate::panes::meaning::{self, hex};
use crate::state::Core;
use crate::timeline::{Row, SignalKey};

/// A field of a payload.
#[derive(Debug, Clone)]
pub(super) struct PayloadPart {
    /// Name of the field.
    pub(super) name: String,
    /// First bit.
    pub(super) bit: u16,
    /// Number of bits.
    pub(super) bits: u16,
    /// Byte order.
    pub(super) order: BitOrder,
    /// Value with unit or name.
    pub(super) value: String,
    /// Position of the field and conversion of its value.
    pub(super) notes: Vec<String>,
    /// Signal for the plot.
    pub(super) signal: Option<SignalKey>,
    /// The value is based on something not seen in the capture.
    pub(super) is_assumed: bool,
}

/// Bytes with their fields.
#[derive(Debug, Clone, Default)]
pub(super) struct Payload {
    /// Identifier and message.
    pub(super) title: String,
    pub(super) bytes: Vec<u8>,
    /// Fields in order.
    pub(super) parts: Vec<PayloadPart>,
    /// Origin of the layout.
    pub(super) source: String,
}

/// Context of a payload: bus, node and identifier.
struct PayloadPlace<'a> {
    core: &'a Core,
    bus: Option<&'a Bus>,
    node: Option<&'a Node>,
    index: BusIndex,
    id: Option<CanId>,
}

/// The payload of the event at the cursor, or of one of its frames.
pub(super) fn of(core: &Core, row: Option<&Row>, chosen: Option<&Frame>) -> Payload {
    let Some(row) = row else { return last_frame(core) };
    let bus = core.world().and_then(|world| world.buses().iter().find(|bus| bus.index() == row.event.bus));
    let node = row.event.node.and_then(|node| bus?.node(node));
    let id = chosen.or(row.frame.as_ref()).map(|frame| frame.id);
    let place = PayloadPlace { core, bus, node, index: row.event.bus, id };
    if let Some(frame) = chosen {
        return place.frame(frame, Some(row));
    }
    match &row.event.kind {
        EventKind::Pdo(pdo) if !pdo.is_request => {
            let place = PayloadPlace { id: Some(pdo.cob_id), ..place };
            place.signals(pdo.payload(), pdo.layout.as_ref(), None)
        }
        EventKind::J1939Message(message) => {
            let place = PayloadPlace { id: Some(message.can_id), ..place };
            place.signals(message.payload(), message.layout.as_ref(), of_group(message.id.pgn))
        }
        EventKind::J1939Transfer(transfer) => {
            let service = transfer.pgn.and_then(of_group);
            let mut payload =
                PayloadPlace { id: None, ..place }.signals(&transfer.data, transfer.layout.as_ref(), service);
            payload.title = "reassembled message".into();
            payload
        }
        EventKind::UdsExchange(exchange) => match exchange.response.as_ref().or(exchange.request.as_ref()) {
            Some(message) => place.uds(&message.data, exchange.response.is_some()),
            None => Payload::default(),
        },
        EventKind::IsoTpTransfer(transfer) => place.uds(&transfer.data, false),
        EventKind::Frame(undecoded) => {
            let place = PayloadPlace { id: Some(undecoded.frame.id), ..place };
            match &undecoded.message {
                Some(message) => place.signals(undecoded.frame.data(), Some(&message.layout), None),
                None => place.frame(&undecoded.frame, Some(row)),
            }
        }
        _ => row.frame.as_ref().map(|frame| place.frame(frame, Some(row))).unwrap_or_default(),
    }
}

/// The last frame before the cursor, if no event shows it.
fn last_frame(core: &Core) -> Payload {
    let row = core.world().and_then(|world| {
        let frame = world.frames();
        world.identifiers().rows().iter().find(|row| row.last_frame == frame)
    });
    let Some(row) = row else { return Payload::default() };
    let mut frame = Frame::data_frame(row.id, row.payload());
    frame.bus = row.bus;
    if row.is_remote {
        frame.flags = frame.flags.with(FrameFlags::REMOTE);
    }
    let bus = core.world().and_then(|world| world.buses().iter().find(|bus| bus.index() == row.bus));
    let node = row.node.and_then(|node| bus?.node(node));
    PayloadPlace { core, bus, node, index: row.bus, id: Some(row.id) }.frame(&frame, None)
}

impl PayloadPlace<'_> {
    /// Fields of a single frame.
    fn frame(&self, frame: &Frame, row: Option<&Row>) -> Payload {
        if frame.flags.contains(FrameFlags::REMOTE) || frame.flags.contains(FrameFlags::ERROR) {
            let what = if frame.flags.contains(FrameFlags::REMOTE) { "remote frame" } else { "error frame" };
            let title = format!("{}, {what}", self.title());
            return Payload { title, bytes: frame.data().to_vec(), ..Payload::default() };
        }
        let service = self.service(frame, row);
        let known = self.core.world().and_then(|world| {
            let mut rows = world.identifiers().rows().iter();
            rows.find(|row| row.bus == frame.bus && row.id == frame.id && !row.is_remote)
        });
        let layout = known.and_then(|known| known.layout.as_ref());
        match (layout, service) {
            (Some(layout), _) => self.signals(frame.data(), Some(layout), None),
            (None, Some(service)) => self.slots(frame.data(), service),
            (None, None) => Payload {
                title: self.title(),
                bytes: frame.data().to_vec(),
                source: "content unknown".into(),
                parts: Vec::new(),
            },
        }
    }

    /// The service of a frame, for its table of fields.
    fn service(&self, frame: &Frame, row: Option<&Row>) -> Option<&'static Service> {
        match row.map(|row| &row.event.kind) {
            Some(EventKind::SdoTransfer(transfer)) => {
                let frames = self.core.window.as_ref().map_or(&[][..], |window| &window.frames);
                return Some(of_sdo(transfer, frames, frame));
            }
            Some(EventKind::Emcy(emergency)) if emergency.cob_id == frame.id => {
                return Some(match emergency.byte_order {
                    ByteOrder::MsbFirst => &services::EMCY_SWAPPED,
                    ByteOrder::LsbFirst => &services::EMCY,
                });
            }
            _ => {}
        }
        match (frame.id, row.map(|row| row.event.protocol)) {
            (_, Some(Protocol::Uds)) => Some(&services::ISO_TP),
            (CanId::Extended(id), _) => J1939Id::of(id).and_then(|id| of_group(id.pgn)),
            (CanId::Standard(id), _) => match connection_set().owner(id) {
                Owner::Nmt => Some(&services::NMT),
                Owner::Sync => Some(&services::SYNC),
                Owner::Time => Some(&services::TIME),
                Owner::Emcy(_) => Some(&services::EMCY),
                Owner::ErrorControl(_) => Some(&services::ERROR_CONTROL),
                Owner::Lss(_) => Some(&services::LSS),
                Owner::Sdo(Side::Client, _) => Some(&services::SDO_REQUEST),
                Owner::Sdo(Side::Server, _) => Some(&services::SDO_RESPONSE),
                Owner::Unclassified | Owner::Named(_) | Owner::Pdo(..) | Owner::TestMarker => None,
            },
        }
    }

    /// Fields by the layout, else by the table of the service.
    fn signals(
        &self,
        bytes: &[u8],
        layout: Option<&Arc<Layout>>,
        service: Option<&'static Service>,
    ) -> Payload {
        let layout = match (layout, service) {
            (Some(layout), _) if !layout.fields.is_empty() => layout,
            (_, Some(service)) => return self.slots(bytes, service),
            _ => {
                let source = "content unknown: no mapping or database".into();
                return Payload { title: self.title(), bytes: bytes.to_vec(), source, parts: Vec::new() };
            }
        };
        let mut parts = Vec::new();
        for (number, field) in layout.fields.iter().enumerate() {
            if let Some(part) = self.signal(bytes, layout, number, field) {
                parts.push(part);
            }
        }
        let assumed = if layout.assumed { ", presumed: a default, or possibly changed since" } else { "" };
        let source = format!("layout: {}{assumed}", layout.origin.name());
        Payload { title: self.title(), bytes: bytes.to_vec(), parts, source }
    }

    fn signal(
        &self,
        bytes: &[u8],
        layout: &Arc<Layout>,
        number: usize,
        field: &Field,
    ) -> Option<PayloadPart> {
        let id = field.id.to_string();
        let name = match (field.name(), id.is_empty()) {
            (Some(name), true) => name.to_owned(),
            (Some(name), false) => format!("{id} {name}"),
            (None, true) => "unnamed".into(),
            (None, false) => id,
        };
        let signal = layout.signal(number, bytes);
        let meaning = field.meaning.as_deref();
        let is_assumed = layout.assumed || meaning.is_some_and(|meaning| meaning.assumed);
        let value = match (&signal, meaning) {
            (Some(signal), Some(meaning)) => meaning.show(&signal.value),
            (Some(signal), None) => signal.value.to_string(),
            (None, _) if field.extract(bytes).is_none() => "missing: frame too short".into(),
            // This multiplexed field is not selected; other fields use its bits.
            (None, _) => return None,
        };
        let mut notes = meaning::place(field);
        if let Some(signal) = &signal {
            notes.extend(meaning::notes(self.core, self.node, field, signal));
        }
        let signal = self.id.and_then(|id| SignalKey::new(self.index, id, layout, number));
        let (bit, bits, order) = (field.bit, field.bits, field.order);
        Some(PayloadPart { name, bit, bits, order, value, notes, signal, is_assumed })
    }

    /// Fields by the table of a service.
    fn slots(&self, bytes: &[u8], service: &'static Service) -> Payload {
        let name = service.shape(bytes).map_or("", |shape| shape.name);
        let parts = service.slots(bytes).into_iter().map(|(name, slot)| self.slot(bytes, name, slot));
        Payload {
            title: self.title(),
            bytes: bytes.to_vec(),
            parts: parts.collect(),
            source: format!("{name}: {}", service.source),
        }
    }

    fn slot(&self, bytes: &[u8], name: String, slot: Slot) -> PayloadPart {
        let rest = u16::try_from(bytes.len() * 8).unwrap_or(u16::MAX).saturating_sub(slot.bit);
        let bits = if slot.bits == 0 { rest } else { slot.bits };
        let value = if slot.read == Read::Bytes {
            let first = usize::from(slot.bit / 8);
            let end = first + usize::from(bits / 8);
            hex(bytes.get(first..end).unwrap_or_default())
        } else {
            let field = Field { order: slot.order, ..number(slot.bit, bits) };
            self.words(slot.read, bits, field.extract(bytes).unwrap_or(0), bytes)
        };
        let place = Field { order: slot.order, ..number(slot.bit, bits) };
        let notes = match slot.read {
            Read::Bytes => vec![format!("{} bytes from byte {}", bits / 8, slot.bit / 8)],
            _ => meaning::place(&place),
        };
        let (bit, order) = (slot.bit, slot.order);
        PayloadPart { name, bit, bits, order, value, notes, signal: None, is_assumed: false }
    }

    /// Fields of a UDS message: service, sub-function, identifier, data.
    fn uds(&self, bytes: &[u8], is_response: bool) -> Payload {
        let mut slots = services::UDS.slots(bytes);
        let first = bytes.first().copied().unwrap_or(0);
        let table = uds().service(first & !RESPONSE).filter(|_| first != NEGATIVE);
        if let Some(service) = table {
            let shape = if first & RESPONSE != 0 { service.response() } else { service.request() };
            let mut bit = 8;
            let mut push = |name: &str, bits: u16, order, read| {
                // A big-endian field is located by its most significant bit.
                let start = if order == BitOrder::BigEndian { bit + 7 } else { bit };
                let slot = Slot { name: "", bit: start, bits, order, read };
                bit += bits;
                slots.push((name.to_owned(), slot));
            };
            if shape.sub_function {
                push("sub-function", 8, BitOrder::LittleEndian, Read::Hex);
            }
            if let Some(place) = shape.identifier {
                let bits = if place.high.is_some() { 8 } else { 16 };
                push("identifier", bits, BitOrder::BigEndian, Read::UdsIdentifier);
            }
            push("data", 0, BitOrder::LittleEndian, Read::Bytes);
        }
        let length = u16::try_from(bytes.len() * 8).unwrap_or(u16::MAX);
        slots.retain(|(_, slot)| (slot.bit & !7).saturating_add(slot.bits.max(1)) <= length);
        let parts = slots.into_iter().map(|(name, slot)| self.slot(bytes, name, slot)).collect();
        let title = if is_response { "response" } else { "message" };
        Payload { title: title.into(), bytes: bytes.to_vec(), parts, source: services::UDS.source.into() }
    }

    /// `0A0 EMCY of 32`.
    fn title(&self) -> String {
        let Some(id) = self.id else { return String::new() };
        let what = self.bus.map(|bus| bus.describe_id(id)).unwrap_or_default();
        format!("{id} {what}").trim_end().to_owned()
    }
}

/// Bit of a service identifier that marks a response, and the identifier of a negative response.
const RESPONSE: u8 = 0x40;
const NEGATIVE: u8 = 0x7F;

fn number(bit: u16, bits: u16) -> Field {
    Field::of_object(ObjectAddress::new(0, 0), bit, bits, DataType::unsigned(bits))
}

/// Table of a J1939 group, used without a layout.
fn of_group(pgn: Pgn) -> Option<&'static Service> {
    const TABLES: &[(Pgn, &Service)] = &[
        (Pgn::TP_CM, &services::TP_CM),
        (Pgn::ETP_CM, &services::TP_CM),
        (Pgn::TP_DT, &services::TP_DT),
        (Pgn::ETP_DT, &services::TP_DT),
        (Pgn::REQUEST, &services::REQUEST),
        (Pgn::ACKNOWLEDGEMENT, &services::ACKNOWLEDGEMENT),
        (Pgn::ADDRESS_CLAIMED, &services::ADDRESS_CLAIM),
        (Pgn::DM1, &services::TROUBLE_CODES),
        (Pgn::DM2, &services::TROUBLE_CODES),
    ];
    TABLES.iter().find(|(group, _)| *group == pgn).map(|(_, service)| *service)
}

/// Table for a frame of an SDO transfer; data frames of a block are segments.
pub(super) fn of_sdo(transfer: &SdoTransfer, frames: &[Frame], frame: &Frame) -> &'static Service {
    use cobscope_decoder::event::{Direction, Mode};
    let commands =
        if frame.id == transfer.request { &services::SDO_REQUEST } else { &services::SDO_RESPONSE };
    let sender = match transfer.direction {
        Some(Direction::Download) => transfer.request,
        _ => transfer.response,
    };
    if transfer.mode != Some(Mode::Block) || frame.id != sender {
        return commands;
    }
    let is_sent = |other: &&Frame| other.id == sender;
    let first = frames.iter().find(is_sent).map(|other| other.number);
    let last = frames.iter().rev().find(is_sent).map(|other| other.number);
    let is_end = last == Some(frame.number) && frame.data().first().is_some_and(|byte| byte & 0xE1 == 0xC1);
    if first == Some(frame.number) || is_end { commands } else { &services::SDO_SEGMENT }
}
