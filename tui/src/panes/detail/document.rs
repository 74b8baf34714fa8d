//! Items of the pane below or next to the bits.
//!
//! ```text
//!   error emcy-raised: …                 findings, their causes, the text of the rule
//! Fields
//! ▶ a error code   8305h spool …         fields: the selected one highlights its bits
//! Related
//!   {70} 4.050 s TPDO1 …                 links
//! All event fields
//!   code = 0x8305                        all fields under their filter names
//! ```

use super::item::{DetailItem, ItemTarget};
use super::payload::PayloadBytes;
use super::{advice, exchange, judged, keys};
use crate::state::{JumpPlace, UiState};
use crate::theme::TextRole;
use crate::timeline::ReplayRow;
use crate::widgets::bits;
use cobscope_decoder::event::EventKind;
use cobscope_decoder::sink::escape;

/// All items of the event at the cursor.
pub(super) fn document_items(
    core: &UiState,
    row: Option<&ReplayRow>,
    payload: &PayloadBytes,
    chosen: Option<usize>,
) -> Vec<DetailItem> {
    let mut all = judged::finding_items(core, row);
    if !payload.bytes.is_empty() {
        all.push(DetailItem::heading_item(&format!("Fields ({})", payload.source)));
        all.extend(part_items(payload));
    }
    let Some(row) = row else {
        all.push(DetailItem::minor_item(
            "no event shown for this frame; v shows all events, c clears the filter",
        ));
        if let Some(before) = core.cursor_row().filter(|row| row.spot < core.cursor) {
            let text =
                format!("previous event {{{}}} {}", before.event.frames.last, event_text(core, before));
            all.push(
                DetailItem::new(&text, TextRole::Link)
                    .with_target(ItemTarget::Place(JumpPlace::Event(before.spot))),
            );
        }
        return all;
    };
    let bus =
        core.bus_state().and_then(|world| world.buses().iter().find(|bus| bus.index() == row.event.bus));
    let Some(bus) = bus.filter(|_| row.spot <= core.cursor) else {
        let text = "this event is after the cursor; Enter goes to it";
        all.insert(
            0,
            DetailItem::new(text, TextRole::Link).with_target(ItemTarget::Place(JumpPlace::Event(row.spot))),
        );
        return all;
    };
    let node = row.event.node.and_then(|node| bus.node(node));
    let advice = advice::advice_items(node, &row.event);
    if !advice.is_empty() {
        all.push(DetailItem::heading_item("Manual"));
        all.extend(advice);
    }
    let exchange = exchange::exchange_items(core, node, &row.event, chosen);
    if !exchange.is_empty() {
        all.push(DetailItem::heading_item("Transfer"));
        all.extend(exchange);
    }
    let keys = keys::event_fields(&row.event, bus);
    let related = related_items(core, row, &keys);
    if !related.is_empty() {
        all.push(DetailItem::heading_item("Related (Enter goes there)"));
        all.extend(related);
    }
    all.push(DetailItem::heading_item("All event fields (= filters)"));
    for key in keys {
        let item =
            DetailItem::new(&format!("{} = {}", key.name, key.value), TextRole::Text).with_filter(key.filter);
        all.push(match key.frame {
            Some(frame) => item.at_frame(frame),
            None => item,
        });
    }
    all
}

fn part_items(payload: &PayloadBytes) -> Vec<DetailItem> {
    let width = payload.parts.iter().map(|part| part.name.chars().count()).max().unwrap_or(0).min(MOST_NAME);
    let item = |(number, part): (usize, &super::payload::PayloadPart)| {
        let assumed = if part.is_assumed { "?" } else { "" };
        let text = format!("{} {:<width$}  {}{assumed}", bits::field_letter(number), part.name, part.value);
        let mut item = DetailItem::new(&text, TextRole::Text).with_target(ItemTarget::Part(number));
        item.notes = part.notes.iter().map(|note| escape(note).into_owned()).collect();
        item
    };
    payload.parts.iter().enumerate().map(item).collect()
}

/// Maximum width to which field names are padded.
const MOST_NAME: usize = 36;

/// Frames named by the event, and the previous and next event of the same node and kind.
fn related_items(core: &UiState, row: &ReplayRow, keys: &[keys::EventField]) -> Vec<DetailItem> {
    let mut all = Vec::new();
    for key in keys {
        if let Some(frame) = key.frame
            && ![row.event.frames.first, row.event.frames.last].contains(&frame)
        {
            let text = match core.shown_rows().iter().find(|other| other.spot.frame == frame) {
                Some(other) => format!("{} {{{frame}}} {}", key.name, event_text(core, other)),
                None => format!("{} {{{frame}}}", key.name),
            };
            all.push(DetailItem::new(&text, TextRole::Link).at_frame(frame));
        }
    }
    let kind = std::mem::discriminant(&row.event.kind);
    // Messages that only carry signals are related if they have the same identifier.
    let has_signals =
        matches!(row.event.kind, EventKind::Pdo(_) | EventKind::J1939Message(_) | EventKind::Frame(_));
    let is_like = |other: &&ReplayRow| {
        (!has_signals || other.id() == row.id())
            && (other.event.bus, other.event.node) == (row.event.bus, row.event.node)
            && std::mem::discriminant(&other.event.kind) == kind
    };
    let before = core.shown_rows().iter().rev().filter(|other| other.spot < row.spot).find(is_like);
    let after = core.shown_rows().iter().filter(|other| other.spot > row.spot).find(is_like);
    for (word, other) in [("previous", before), ("next", after)] {
        if let Some(other) = other {
            let text = format!("{word} {{{}}} {}", other.event.frames.last, event_text(core, other));
            all.push(
                DetailItem::new(&text, TextRole::Link)
                    .with_target(ItemTarget::Place(JumpPlace::Event(other.spot))),
            );
        }
    }
    all
}

fn event_text(core: &UiState, row: &ReplayRow) -> String {
    let time = core.time_words(row.event.time, 3).map_or(String::new(), |time| time + " ");
    format!("{time}{} {} {}", row.who, row.kind, row.news)
}
