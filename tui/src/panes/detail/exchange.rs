//! Transfer of an event: nodes, mode, duration, frames and data.
//!
//! ```text
//! upload 1008:00 Manufacturer device name, segmented, client → server: complete
//! 12 frames {20}..{31}, 5.0 ms, 25 bytes, announced 25
//!   {20}  0.113 s  →  40 08 10 00 00 00 00 00  initiate upload
//! ```

use cobscope_decoder::event::{Event, EventKind, IsoTpTransfer, J1939Transfer, SdoDirection, UdsMessage};
use cobscope_decoder::event::{SdoTransfer, UdsExchange};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::profile::{ValueStorage, uds_names};
use cobscope_decoder::query::record;
use cobscope_decoder::session::Node;
use cobscope_decoder::words::count_noun;

use super::item::{DetailItem, ItemTarget};
use super::payload::{abort_text, of_sdo};
use super::services;
use crate::panes::meaning::{self, hex_bytes, value_text};
use crate::state::UiState;
use crate::theme::{Glyph, TextRole};

/// Maximum number of data bytes shown.
const SHOWN_BYTES: usize = 256;
/// Number of bytes per line.
const BYTES_A_LINE: usize = 16;

/// Items of a transfer; empty for other events.
pub(super) fn exchange_items(
    core: &UiState,
    node: Option<&Node>,
    event: &Event,
    chosen: Option<usize>,
) -> Vec<DetailItem> {
    let mut items = Vec::new();
    match &event.kind {
        EventKind::SdoTransfer(transfer) => push_sdo(core, node, transfer, &mut items),
        EventKind::J1939Transfer(transfer) => push_j1939(transfer, &mut items),
        EventKind::UdsExchange(exchange) => push_diagnostic(core, exchange, &mut items),
        EventKind::IsoTpTransfer(transfer) => iso_tp(transfer, &mut items),
        _ => return items,
    }
    push_frames(core, event, chosen, &mut items);
    items
}

/// `12 frames {20}..{31}, 5.0 ms`.
fn extent_text(event_frames: u64, duration: Option<i64>, size: u64) -> String {
    let duration = duration.map_or(String::new(), |duration| format!(", {}", milliseconds_text(duration)));
    format!("{}{duration}, {}", count_noun(event_frames, "frame"), count_noun(size, "byte"))
}

/// `5.123 ms`.
fn milliseconds_text(nanoseconds: i64) -> String {
    let micros = nanoseconds / 1_000;
    format!("{}.{:03} ms", micros / 1_000, (micros % 1_000).abs())
}

fn push_sdo(core: &UiState, node: Option<&Node>, transfer: &SdoTransfer, items: &mut Vec<DetailItem>) {
    let client = transfer.client.map_or("client".into(), |client| format!("client {client}"));
    let way = transfer.direction.map_or("direction unknown", record::direction_name);
    let how = transfer.mode.map_or(String::new(), |mode| format!(", {}", record::mode_name(mode)));
    let head = format!(
        "{way}{how}, {client} on {}, server on {}: {}",
        transfer.request,
        transfer.response,
        transfer.outcome.name()
    );
    items.push(DetailItem::new(&head, TextRole::Text));
    let announced = transfer.announced.map_or(String::new(), |announced| format!(", {announced} announced"));
    let cut = match (transfer.cut_start, transfer.cut_end) {
        (true, _) => ", start not in the capture",
        (_, true) => ", end not in the capture",
        _ => "",
    };
    let extent = extent_text(transfer.frame_count, transfer.duration, transfer.size);
    items.push(DetailItem::minor_item(&format!("{extent}{announced}{cut}")));
    items.extend(partly_seen(transfer));
    if let Some(abort) = transfer.abort {
        let by = if abort.by_client { "client" } else { "server" };
        let device = node.map(|node| &**node.device());
        let text = abort_text(device, abort.code, transfer.object);
        items.push(DetailItem::new(&format!("abort {:08X}h by the {by}: {text}", abort.code), TextRole::Bad));
        let hint = cobscope_decoder::profile::abort_codes().find_code(abort.code).map(|code| &code.hint);
        items.extend(
            hint.filter(|hint| !hint.is_empty()).map(|hint| DetailItem::minor_item(&format!("  {hint}"))),
        );
    }
    if let Some(odd) = transfer.irregularity {
        let by = if odd.by_client { "client" } else { "server" };
        let text = format!("protocol violation by the {by} {{{}}}: {}", odd.frame, odd.what.name());
        items.push(DetailItem::new(&text, TextRole::Caution).at_frame(odd.frame));
    }
    items.extend(transfer.crc.map(|crc| DetailItem::minor_item(&format!("CRC {}", crc.name()))));
    push_value(core, node, transfer, items);
    if transfer.size > 4 {
        for (offset, data) in transfer.ranges() {
            push_dump(offset, data, items);
        }
    }
}

/// Bytes that the capture lacks, and blocks that were repeated.
fn partly_seen(transfer: &SdoTransfer) -> impl Iterator<Item = DetailItem> + use<> {
    let gap = (transfer.unseen > 0).then(|| {
        let segments = count_noun(transfer.missing_segments, "segment");
        let (seen, size) = (transfer.captured_bytes(), transfer.size);
        DetailItem::new(&format!("{seen} of {size} bytes seen, {segments} not captured"), TextRole::Caution)
    });
    let loss = transfer.first_loss.map(|(sequence, frame)| {
        let blocks = count_noun(transfer.losses, "block");
        let text = format!("{blocks} repeated in part: segment {sequence} not acknowledged");
        let item = DetailItem::new(&text, TextRole::Caution);
        match frame {
            Some(frame) => item.at_frame(frame),
            None => item,
        }
    });
    gap.into_iter().chain(loss)
}

/// The written or read value, the previous one and its storage.
fn push_value(core: &UiState, node: Option<&Node>, transfer: &SdoTransfer, items: &mut Vec<DetailItem>) {
    let Some(object) = transfer.object else { return };
    let meaning = transfer.meaning.as_deref();
    let name = meaning.map_or(String::new(), |meaning| format!(" {}", meaning.name));
    let is_shown = transfer.size > 0 && transfer.unseen == 0;
    if is_shown {
        items.push(DetailItem::new(
            &format!("{object}{name} = {}", value_text(meaning, &transfer.data)),
            TextRole::Text,
        ));
    } else if !name.is_empty() {
        items.push(DetailItem::new(&format!("{object}{name}"), TextRole::Text));
    }
    if let Some(meaning) = meaning.filter(|_| is_shown) {
        let mut notes = Vec::new();
        meaning::of_value(core, node, meaning, &meaning.decode(&transfer.data), &mut notes);
        items.extend(notes.iter().map(|note| DetailItem::minor_item(&format!("  {note}"))));
    }
    if let Some(previous) = &transfer.previous {
        let assumed = if transfer.previous_assumed { ", presumed" } else { "" };
        items
            .push(DetailItem::minor_item(&format!("  previous: {}{assumed}", value_text(meaning, previous))));
    }
    if transfer.direction != Some(SdoDirection::Download) {
        return;
    }
    let entry = node.and_then(|node| node.device().dictionary.find_object(object)?.entry);
    let storage = match entry.map(|entry| entry.storage) {
        Some(ValueStorage::Volatile) => "  storage: volatile",
        Some(ValueStorage::EachWrite) => {
            "  storage: every write goes to non-volatile memory (limited write cycles)"
        }
        Some(ValueStorage::Save) => "  storage: non-volatile after a store command (1010)",
        Some(ValueStorage::Fixed) => "  storage: constant",
        Some(ValueStorage::Unknown) | None => "",
    };
    if !storage.is_empty() {
        items.push(DetailItem::minor_item(storage));
    }
    items.extend(
        transfer.effect.map(|effect| DetailItem::minor_item(&format!("  active {}", effect.time_text()))),
    );
    items.extend(
        transfer
            .persists
            .map(|stays| DetailItem::minor_item(&format!("  survives a restart: {}", stays.name()))),
    );
}

fn push_j1939(transfer: &J1939Transfer, items: &mut Vec<DetailItem>) {
    let mode = transfer.mode.map_or("type unknown", |mode| mode.name());
    let group = transfer.pgn.map_or("PGN unknown".into(), |pgn| format!("PGN {}", pgn.number()));
    let name = transfer.name.as_deref().map_or(String::new(), |name| format!(" {name}"));
    let to = if transfer.destination == 255 { "all".into() } else { transfer.destination.to_string() };
    let outcome = transfer.outcome.name();
    let source = transfer.source;
    items
        .push(DetailItem::new(&format!("{group}{name}, {mode}, {source} → {to}: {outcome}"), TextRole::Text));
    let announced = transfer.announced.map_or(String::new(), |bytes| format!(", {bytes} announced"));
    let packets =
        transfer.packets.map_or(String::new(), |packets| format!(", {}", count_noun(packets, "packet")));
    let extent = extent_text(transfer.frame_count, transfer.duration, transfer.size);
    items.push(DetailItem::minor_item(&format!("{extent}{announced}{packets}")));
    if transfer.missing > 0 || transfer.repeated > 0 {
        let text =
            format!("{} missing, {} repeated", count_noun(transfer.missing, "packet"), transfer.repeated);
        items.push(DetailItem::new(&text, TextRole::Caution));
    }
    if let Some(abort) = transfer.abort {
        let by = if abort.by_sender { "originator" } else { "responder" };
        let text = cobscope_decoder::profile::transport_aborts().code_text(u32::from(abort.reason));
        items.push(DetailItem::new(&format!("abort {} by the {by}: {text}", abort.reason), TextRole::Bad));
    }
    items.extend(
        transfer.timer.map(|timer| DetailItem::new(&format!("time-out {}", timer.name()), TextRole::Bad)),
    );
    push_dump(0, &transfer.data, items);
}

fn iso_tp(transfer: &IsoTpTransfer, items: &mut Vec<DetailItem>) {
    let text = format!("ISO-TP message on {}: {}", transfer.id, transfer.outcome.name());
    items.push(DetailItem::new(&text, TextRole::Text));
    let extent = extent_text(transfer.frame_count, transfer.duration, transfer.size);
    items.push(DetailItem::minor_item(&format!("{extent}, {} announced", transfer.announced)));
    push_dump(0, &transfer.data, items);
}

fn push_diagnostic(core: &UiState, exchange: &UdsExchange, items: &mut Vec<DetailItem>) {
    let service = uds_names()
        .service_by_id(exchange.service)
        .map_or("unknown service", |service| service.title.as_str());
    let head = format!("{:02X}h {service}: {}", exchange.service, exchange.outcome.name());
    items.push(DetailItem::new(&head, TextRole::Text));
    if let Some(identifier) = exchange.identifier {
        let name = exchange.name().map_or(String::new(), |name| format!(" {name}"));
        let value = match (exchange.decoded_value(), exchange.meaning.as_deref()) {
            (Some(value), Some(meaning)) => format!(" = {}", meaning.format_value(&value)),
            (Some(value), None) => format!(" = {value}"),
            (None, _) => String::new(),
        };
        items.push(DetailItem::new(&format!("identifier {identifier:04X}h{name}{value}"), TextRole::Text));
    }
    if let (Some(meaning), Some(value)) = (exchange.meaning.as_deref(), exchange.decoded_value()) {
        let mut notes = Vec::new();
        meaning::of_value(core, None, meaning, &value, &mut notes);
        items.extend(notes.iter().map(|note| DetailItem::minor_item(&format!("  {note}"))));
    }
    if let Some(code) = exchange.nrc {
        let known = uds_names().code_entry(code);
        let text = known.map_or("unknown code", |known| known.text.as_str());
        items.push(DetailItem::new(&format!("negative response {code:02X}h: {text}"), TextRole::Bad));
        let hint = known.map(|known| &known.hint).filter(|hint| !hint.is_empty());
        items.extend(hint.map(|hint| DetailItem::minor_item(&format!("  {hint}"))));
    }
    let times = [("response after", exchange.latency), ("total", exchange.duration)];
    for (what, time) in times {
        items.extend(time.map(|time| DetailItem::minor_item(&format!("{what} {}", milliseconds_text(time)))));
    }
    if exchange.pending > 0 {
        items.push(DetailItem::minor_item(&format!(
            "{} \"response pending\"",
            count_noun(exchange.pending, "time")
        )));
    }
    for (what, message) in [("request", &exchange.request), ("response", &exchange.response)] {
        if let Some(message) = message {
            add_message(what, message, items);
        }
    }
}

fn add_message(what: &str, message: &UdsMessage, items: &mut Vec<DetailItem>) {
    let (first, last) = (message.frames.first, message.frames.last);
    let frames = if first == last { format!("{{{first}}}") } else { format!("{{{first}}}..{{{last}}}") };
    let text = format!("{what} {frames} on {}, {}", message.id, count_noun(message.size, "byte"));
    items.push(DetailItem::new(&text, TextRole::Text).at_frame(first));
    push_dump(0, &message.data, items);
}

/// The frames of the transfer by time; only the first and last one if they are not in memory.
fn push_frames(core: &UiState, event: &Event, chosen: Option<usize>, items: &mut Vec<DetailItem>) {
    let frames = core.window.as_ref().map_or(&[][..], |window| &window.frames);
    if frames.is_empty() {
        let (first, last) = (event.frames.first, event.frames.last);
        for (word, frame) in [("first", first), ("last", last)].into_iter().filter(|_| first != last) {
            items.push(DetailItem::new(&format!("{word} frame {{{frame}}}"), TextRole::Link).at_frame(frame));
        }
        return;
    }
    items.push(DetailItem::heading_item("Frames (Enter shows the bits)"));
    for (place, frame) in frames.iter().enumerate() {
        let shown = if chosen == Some(place) { "  (bits shown)" } else { "" };
        let text = format!("{}{shown}", frame_line(core, event, frame, frames));
        items.push(DetailItem::new(&text, TextRole::Text).with_target(ItemTarget::Frame(place)));
    }
}

fn frame_line(core: &UiState, event: &Event, frame: &Frame, all: &[Frame]) -> String {
    let arrow = core.theme.glyph(Glyph::Arrow);
    let time = core.time_text(frame.time, 6).unwrap_or_default();
    let (is_first_way, step) = match &event.kind {
        EventKind::SdoTransfer(transfer) => {
            let service = of_sdo(transfer, all, frame);
            (frame.id == transfer.request, service.shape_for(frame.data()).map_or("", |shape| shape.name))
        }
        EventKind::J1939Transfer(transfer) => {
            let is_from_sender = frame.id.number() & 0xFF == u32::from(transfer.source);
            let is_data = frame.id.number() >> 16 & 0xFF == 0xEB;
            let service = if is_data { &services::TP_DT } else { &services::TP_CM };
            (is_from_sender, service.shape_for(frame.data()).map_or("", |shape| shape.name))
        }
        EventKind::UdsExchange(exchange) => {
            let is_request = exchange.request.as_ref().is_some_and(|request| request.id == frame.id);
            (is_request, services::ISO_TP.shape_for(frame.data()).map_or("", |shape| shape.name))
        }
        _ => (true, services::ISO_TP.shape_for(frame.data()).map_or("", |shape| shape.name)),
    };
    let way = if is_first_way { format!("{arrow} ") } else { "  ".into() };
    format!("{{{}}} {time} {way}{} {}  {step}", frame.number, frame.id, hex_bytes(frame.data()))
}

/// `0010  05 83 21 …  .É!`.
fn push_dump(offset: u64, data: &[u8], items: &mut Vec<DetailItem>) {
    for (line, bytes) in data.iter().take(SHOWN_BYTES).collect::<Vec<_>>().chunks(BYTES_A_LINE).enumerate() {
        let bytes: Vec<u8> = bytes.iter().map(|byte| **byte).collect();
        let is_shown = |byte: u8| byte.is_ascii_graphic() || byte == b' ';
        let text: String =
            bytes.iter().map(|byte| if is_shown(*byte) { char::from(*byte) } else { '.' }).collect();
        let address = offset.saturating_add((line * BYTES_A_LINE) as u64);
        items.push(DetailItem::minor_item(&format!("  {address:04X}  {:<47}  {text}", hex_bytes(&bytes))));
    }
    if data.len() > SHOWN_BYTES {
        items.push(DetailItem::minor_item(&format!("  … {} bytes in total", data.len())));
    }
}
