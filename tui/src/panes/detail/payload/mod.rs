//! The payload of an event and its fields.
//!
//! ```text
//! event ─▶ its own layout (PDO, J1939, DBC) ─┐
//!      └─▶ its frame ─▶ layout of its identifier, else the table of its service ─▶ parts
//! ```

mod words;

use std::sync::Arc;

use cobscope_decoder::event::{EventKind, EventProtocol, SdoTransfer};
use cobscope_decoder::frame::{BusIndex, CanId, Frame, FrameFlags};
use cobscope_decoder::profile::{
    BitOrder, DataType, IdentifierOwner, PayloadLayout, SignalField, connection_set, uds_names,
};
use cobscope_decoder::session::{Bus, Node};
use cobscope_decoder::wire::canopen::ObjectAddress;
use cobscope_decoder::wire::canopen::emcy::EmcyByteOrder;
use cobscope_decoder::wire::canopen::sdo::SdoSide;
use cobscope_decoder::wire::j1939::{J1939Id, Pgn};

pub(super) use self::words::abort_text;
use super::services::{self, FieldPresentation, ServiceDescription, ServiceField};
use crate::panes::meaning::{self, hex_bytes};
use crate::state::UiState;
use crate::timeline::{ReplayRow, SignalKey};

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
pub(super) struct PayloadBytes {
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
    core: &'a UiState,
    bus: Option<&'a Bus>,
    node: Option<&'a Node>,
    index: BusIndex,
    id: Option<CanId>,
}

/// The payload of the event at the cursor, or of one of its frames.
pub(super) fn payload_of(core: &UiState, row: Option<&ReplayRow>, chosen: Option<&Frame>) -> PayloadBytes {
    let Some(row) = row else { return last_frame(core) };
    let bus =
        core.bus_state().and_then(|world| world.buses().iter().find(|bus| bus.index() == row.event.bus));
    let node = row.event.node.and_then(|node| bus?.node(node));
    let id = chosen.or(row.frame.as_ref()).map(|frame| frame.id);
    let place = PayloadPlace { core, bus, node, index: row.event.bus, id };
    if let Some(frame) = chosen {
        return place.frame_payload(frame, Some(row));
    }
    match &row.event.kind {
        EventKind::Pdo(pdo) if !pdo.is_request => {
            let place = PayloadPlace { id: Some(pdo.cob_id), ..place };
            place.signal_payload(pdo.payload(), pdo.layout.as_ref(), None)
        }
        EventKind::J1939Message(message) => {
            let place = PayloadPlace { id: Some(message.can_id), ..place };
            place.signal_payload(message.payload(), message.layout.as_ref(), of_group(message.id.pgn))
        }
        EventKind::J1939Transfer(transfer) => {
            let service = transfer.pgn.and_then(of_group);
            let mut payload = PayloadPlace { id: None, ..place }.signal_payload(
                &transfer.data,
                transfer.layout.as_ref(),
                service,
            );
            payload.title = "reassembled message".into();
            payload
        }
        EventKind::UdsExchange(exchange) => match exchange.response.as_ref().or(exchange.request.as_ref()) {
            Some(message) => place.uds_payload(&message.data, exchange.response.is_some()),
            None => PayloadBytes::default(),
        },
        EventKind::IsoTpTransfer(transfer) => place.uds_payload(&transfer.data, false),
        EventKind::Frame(undecoded) => {
            let place = PayloadPlace { id: Some(undecoded.frame.id), ..place };
            match &undecoded.message {
                Some(message) => place.signal_payload(undecoded.frame.data(), Some(&message.layout), None),
                None => place.frame_payload(&undecoded.frame, Some(row)),
            }
        }
        _ => row.frame.as_ref().map(|frame| place.frame_payload(frame, Some(row))).unwrap_or_default(),
    }
}

/// The last frame before the cursor, if no event shows it.
fn last_frame(core: &UiState) -> PayloadBytes {
    let row = core.bus_state().and_then(|world| {
        let frame = world.frames();
        world.identifiers().rows().iter().find(|row| row.last_frame == frame)
    });
    let Some(row) = row else { return PayloadBytes::default() };
    let mut frame = Frame::data_frame(row.id, row.payload());
    frame.bus = row.bus;
    if row.is_remote {
        frame.flags = frame.flags.with(FrameFlags::REMOTE);
    }
    let bus = core.bus_state().and_then(|world| world.buses().iter().find(|bus| bus.index() == row.bus));
    let node = row.node.and_then(|node| bus?.node(node));
    PayloadPlace { core, bus, node, index: row.bus, id: Some(row.id) }.frame_payload(&frame, None)
}

impl PayloadPlace<'_> {
    /// Fields of a single frame.
    fn frame_payload(&self, frame: &Frame, row: Option<&ReplayRow>) -> PayloadBytes {
        if frame.flags.contains(FrameFlags::REMOTE) || frame.flags.contains(FrameFlags::ERROR) {
            let what = if frame.flags.contains(FrameFlags::REMOTE) { "remote frame" } else { "error frame" };
            let title = format!("{}, {what}", self.payload_title());
            return PayloadBytes { title, bytes: frame.data().to_vec(), ..PayloadBytes::default() };
        }
        let service = self.frame_service(frame, row);
        let known = self.core.bus_state().and_then(|world| {
            let mut rows = world.identifiers().rows().iter();
            rows.find(|row| row.bus == frame.bus && row.id == frame.id && !row.is_remote)
        });
        let layout = known.and_then(|known| known.layout.as_ref());
        match (layout, service) {
            (Some(layout), _) => self.signal_payload(frame.data(), Some(layout), None),
            (None, Some(service)) => self.service_payload(frame.data(), service),
            (None, None) => PayloadBytes {
                title: self.payload_title(),
                bytes: frame.data().to_vec(),
                source: "content unknown".into(),
                parts: Vec::new(),
            },
        }
    }

    /// The service of a frame, for its table of fields.
    fn frame_service(&self, frame: &Frame, row: Option<&ReplayRow>) -> Option<&'static ServiceDescription> {
        match row.map(|row| &row.event.kind) {
            Some(EventKind::SdoTransfer(transfer)) => {
                let frames = self.core.window.as_ref().map_or(&[][..], |window| &window.frames);
                return Some(of_sdo(transfer, frames, frame));
            }
            Some(EventKind::Emcy(emergency)) if emergency.cob_id == frame.id => {
                return Some(match emergency.byte_order {
                    EmcyByteOrder::MsbFirst => &services::EMCY_SWAPPED,
                    EmcyByteOrder::LsbFirst => &services::EMCY,
                });
            }
            _ => {}
        }
        match (frame.id, row.map(|row| row.event.protocol)) {
            (_, Some(EventProtocol::Uds)) => Some(&services::ISO_TP),
            (CanId::Extended(id), _) => J1939Id::from_identifier(id).and_then(|id| of_group(id.pgn)),
            (CanId::Standard(id), _) => match connection_set().owner_of(id) {
                IdentifierOwner::Nmt => Some(&services::NMT),
                IdentifierOwner::Sync => Some(&services::SYNC),
                IdentifierOwner::Time => Some(&services::TIME),
                IdentifierOwner::Emcy(_) => Some(&services::EMCY),
                IdentifierOwner::ErrorControl(_) => Some(&services::ERROR_CONTROL),
                IdentifierOwner::Lss(_) => Some(&services::LSS),
                IdentifierOwner::Sdo(SdoSide::Client, _) => Some(&services::SDO_REQUEST),
                IdentifierOwner::Sdo(SdoSide::Server, _) => Some(&services::SDO_RESPONSE),
                IdentifierOwner::Unclassified
                | IdentifierOwner::Named(_)
                | IdentifierOwner::Pdo(..)
                | IdentifierOwner::TestMarker => None,
            },
        }
    }

    /// Fields by the layout, else by the table of the service.
    fn signal_payload(
        &self,
        bytes: &[u8],
        layout: Option<&Arc<PayloadLayout>>,
        service: Option<&'static ServiceDescription>,
    ) -> PayloadBytes {
        let layout = match (layout, service) {
            (Some(layout), _) if !layout.fields.is_empty() => layout,
            (_, Some(service)) => return self.service_payload(bytes, service),
            _ => {
                let source = "content unknown: no mapping or database".into();
                return PayloadBytes {
                    title: self.payload_title(),
                    bytes: bytes.to_vec(),
                    source,
                    parts: Vec::new(),
                };
            }
        };
        let mut parts = Vec::new();
        for (number, field) in layout.fields.iter().enumerate() {
            if let Some(part) = self.signal_part(bytes, layout, number, field) {
                parts.push(part);
            }
        }
        let assumed = if layout.assumed { ", presumed: a default, or possibly changed since" } else { "" };
        let source = format!("layout: {}{assumed}", layout.origin.name());
        PayloadBytes { title: self.payload_title(), bytes: bytes.to_vec(), parts, source }
    }

    fn signal_part(
        &self,
        bytes: &[u8],
        layout: &Arc<PayloadLayout>,
        number: usize,
        field: &SignalField,
    ) -> Option<PayloadPart> {
        let id = field.id.to_string();
        let name = match (field.name(), id.is_empty()) {
            (Some(name), true) => name.to_owned(),
            (Some(name), false) => format!("{id} {name}"),
            (None, true) => "unnamed".into(),
            (None, false) => id,
        };
        let signal = layout.decode_signal(number, bytes);
        let meaning = field.meaning.as_deref();
        let is_assumed = layout.assumed || meaning.is_some_and(|meaning| meaning.assumed);
        let value = match (&signal, meaning) {
            (Some(signal), Some(meaning)) => meaning.format_value(&signal.value),
            (Some(signal), None) => signal.value.to_string(),
            (None, _) if field.extract_bits(bytes).is_none() => "missing: frame too short".into(),
            // This multiplexed field is not selected; other fields use its bits.
            (None, _) => return None,
        };
        let mut notes = meaning::field_place(field);
        if let Some(signal) = &signal {
            notes.extend(meaning::field_notes(self.core, self.node, field, signal));
        }
        let signal = self.id.and_then(|id| SignalKey::new(self.index, id, layout, number));
        let (bit, bits, order) = (field.bit, field.bits, field.order);
        Some(PayloadPart { name, bit, bits, order, value, notes, signal, is_assumed })
    }

    /// Fields by the table of a service.
    fn service_payload(&self, bytes: &[u8], service: &'static ServiceDescription) -> PayloadBytes {
        let name = service.shape_for(bytes).map_or("", |shape| shape.name);
        let parts =
            service.slots_for(bytes).into_iter().map(|(name, slot)| self.slot_part(bytes, name, slot));
        PayloadBytes {
            title: self.payload_title(),
            bytes: bytes.to_vec(),
            parts: parts.collect(),
            source: format!("{name}: {}", service.source),
        }
    }

    fn slot_part(&self, bytes: &[u8], name: String, slot: ServiceField) -> PayloadPart {
        let rest = u16::try_from(bytes.len() * 8).unwrap_or(u16::MAX).saturating_sub(slot.bit);
        let bits = if slot.bits == 0 { rest } else { slot.bits };
        let value = if slot.read == FieldPresentation::Bytes {
            let first = usize::from(slot.bit / 8);
            let end = first + usize::from(bits / 8);
            hex_bytes(bytes.get(first..end).unwrap_or_default())
        } else {
            let field = SignalField { order: slot.order, ..plain_field(slot.bit, bits) };
            self.number_text(slot.read, bits, field.extract_bits(bytes).unwrap_or(0), bytes)
        };
        let place = SignalField { order: slot.order, ..plain_field(slot.bit, bits) };
        let notes = match slot.read {
            FieldPresentation::Bytes => vec![format!("{} bytes from byte {}", bits / 8, slot.bit / 8)],
            _ => meaning::field_place(&place),
        };
        let (bit, order) = (slot.bit, slot.order);
        PayloadPart { name, bit, bits, order, value, notes, signal: None, is_assumed: false }
    }

    /// Fields of a UDS message: service, sub-function, identifier, data.
    fn uds_payload(&self, bytes: &[u8], is_response: bool) -> PayloadBytes {
        let mut slots = services::UDS.slots_for(bytes);
        let first = bytes.first().copied().unwrap_or(0);
        let table = uds_names().service_by_id(first & !RESPONSE).filter(|_| first != NEGATIVE);
        if let Some(service) = table {
            let shape = if first & RESPONSE != 0 { service.response() } else { service.request() };
            let mut bit = 8;
            let mut push = |name: &str, bits: u16, order, read| {
                // A big-endian field is located by its most significant bit.
                let start = if order == BitOrder::BigEndian { bit + 7 } else { bit };
                let slot = ServiceField { name: "", bit: start, bits, order, read };
                bit += bits;
                slots.push((name.to_owned(), slot));
            };
            if shape.sub_function {
                push("sub-function", 8, BitOrder::LittleEndian, FieldPresentation::Hex);
            }
            if let Some(place) = shape.identifier {
                let bits = if place.high.is_some() { 8 } else { 16 };
                push("identifier", bits, BitOrder::BigEndian, FieldPresentation::UdsIdentifier);
            }
            push("data", 0, BitOrder::LittleEndian, FieldPresentation::Bytes);
        }
        let length = u16::try_from(bytes.len() * 8).unwrap_or(u16::MAX);
        slots.retain(|(_, slot)| (slot.bit & !7).saturating_add(slot.bits.max(1)) <= length);
        let parts = slots.into_iter().map(|(name, slot)| self.slot_part(bytes, name, slot)).collect();
        let title = if is_response { "response" } else { "message" };
        PayloadBytes {
            title: title.into(),
            bytes: bytes.to_vec(),
            parts,
            source: services::UDS.source.into(),
        }
    }

    /// `0A0 EMCY of 32`.
    fn payload_title(&self) -> String {
        let Some(id) = self.id else { return String::new() };
        let what = self.bus.map(|bus| bus.describe_id(id)).unwrap_or_default();
        format!("{id} {what}").trim_end().to_owned()
    }
}

/// Bit of a service identifier that marks a response, and the identifier of a negative response.
const RESPONSE: u8 = 0x40;
const NEGATIVE: u8 = 0x7F;

fn plain_field(bit: u16, bits: u16) -> SignalField {
    SignalField::of_object(ObjectAddress::new(0, 0), bit, bits, DataType::unsigned_of(bits))
}

/// Table of a J1939 group, used without a layout.
fn of_group(pgn: Pgn) -> Option<&'static ServiceDescription> {
    const TABLES: &[(Pgn, &ServiceDescription)] = &[
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
pub(super) fn of_sdo(transfer: &SdoTransfer, frames: &[Frame], frame: &Frame) -> &'static ServiceDescription {
    use cobscope_decoder::event::{SdoDirection, SdoMode};
    let commands =
        if frame.id == transfer.request { &services::SDO_REQUEST } else { &services::SDO_RESPONSE };
    let sender = match transfer.direction {
        Some(SdoDirection::Download) => transfer.request,
        _ => transfer.response,
    };
    if transfer.mode != Some(SdoMode::Block) || frame.id != sender {
        return commands;
    }
    let is_sent = |other: &&Frame| other.id == sender;
    let first = frames.iter().find(is_sent).map(|other| other.number);
    let last = frames.iter().rev().find(is_sent).map(|other| other.number);
    let is_end = last == Some(frame.number) && frame.data().first().is_some_and(|byte| byte & 0xE1 == 0xC1);
    if first == Some(frame.number) || is_end { commands } else { &services::SDO_SEGMENT }
}
