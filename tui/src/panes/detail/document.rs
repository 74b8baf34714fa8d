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

use super::item::{Item, ItemTarget};
use super::payload::Payload;
use super::{advice, exchange, judged, keys};
use crate::state::{Core, JumpPlace};
use crate::theme::Role;
use crate::timeline::Row;
use crate::widgets::bits;
use cobscope_decoder::event::EventKind;
use cobscope_decoder::sink::escape;

/// All items of the event at the cursor.
pub(super) fn items(core: &Core, row: Option<&Row>, payload: &Payload, chosen: Option<usize>) -> Vec<Item> {
    let mut all = judged::items(core, row);
    if !payload.bytes.is_empty() {
        all.push(Item::heading(&format!("Fields ({})", payload.source)));
        all.extend(parts(payload));
    }
    let Some(row) = row else {
        all.push(Item::quiet("no event shown for this frame; v shows all events, c clears the filter"));
        if let Some(before) = core.row().filter(|row| row.spot < core.cursor) {
            let text =
                format!("previous event {{{}}} {}", before.event.frames.last, event_text(core, before));
            all.push(Item::new(&text, Role::Link).leading(ItemTarget::Place(JumpPlace::Event(before.spot))));
        }
        return all;
    };
    let bus = core.world().and_then(|world| world.buses().iter().find(|bus| bus.index() == row.event.bus));
    let Some(bus) = bus.filter(|_| row.spot <= core.cursor) else {
        let text = "this event is after the cursor; Enter goes to it";
        all.insert(0, Item::new(text, Role::Link).leading(ItemTarget::Place(JumpPlace::Event(row.spot))));
        return all;
    };
    let node = row.event.node.and_then(|node| bus.node(node));
    let advice = advice::items(node, &row.event);
    if !advice.is_empty() {
        all.push(Item::heading("Manual"));
        all.extend(advice);
    }
    let exchange = exchange::items(core, node, &row.event, chosen);
    if !exchange.is_empty() {
        all.push(Item::heading("Transfer"));
        all.extend(exchange);
    }
    let keys = keys::of(&row.event, bus);
    let related = related(core, row, &keys);
    if !related.is_empty() {
        all.push(Item::heading("Related (Enter goes there)"));
        all.extend(related);
    }
    all.push(Item::heading("All event fields (= filters)"));
    for key in keys {
        let item = Item::new(&format!("{} = {}", key.name, key.value), Role::Text).filtered(key.filter);
        all.push(match key.frame {
            Some(frame) => item.at(frame),
            None => item,
        });
    }
    all
}

fn parts(payload: &Payload) -> Vec<Item> {
    let width = payload.parts.iter().map(|part| part.name.chars().count()).max().unwrap_or(0).min(MOST_NAME);
    let item = |(number, part): (usize, &super::payload::PayloadPart)| {
        let assumed = if part.is_assumed { "?" } else { "" };
        let text = format!("{} {:<width$}  {}{assumed}", bits::letter(number), part.name, part.value);
        let mut item = Item::new(&text, Role::Text).leading(ItemTarget::Part(number));
        item.notes = part.notes.iter().map(|note| escape(note).into_owned()).collect();
        item
    };
    payload.parts.iter().enumerate().map(item).collect()
}

/// Maximum width to which field names are padded.
const MOST_NAME: usize = 36;

/// Frames named by the event, and the previous and next event of the same node and kind.
fn related(core: &Core, row: &Row, keys: &[keys::Key]) -> Vec<Item> {
    let mut all = Vec::new();
    for key in keys {
        if let Some(frame) = key.frame
            && ![row.event.frames.first, row.event.frames.last].contains(&frame)
        {
            let text = match core.rows().iter().find(|other| other.spot.frame == frame) {
                Some(other) => format!("{} {{{frame}}} {}", key.name, event_text(core, other)),
                None => format!("{} {{{frame}}}", key.name),
            };
            all.push(Item::new(&text, Role::Link).at(frame));
        }
    }
    let kind = std::mem::discriminant(&row.event.kind);
    // Messages that only carry signals are related if they have the same identifier.
    let has_signals =
        matches!(row.event.kind, EventKind::Pdo(_) | EventKind::J1939Message(_) | EventKind::Frame(_));
    let is_like = |other: &&Row| {
        (!has_signals || other.id() == row.id())
            && (other.event.bus, other.event.node) == (row.event.bus, row.event.node)
            && std::mem::discriminant(&other.event.kind) == kind
    };
    let before = core.rows().iter().rev().filter(|other| other.spot < row.spot).find(is_like);
    let after = core.rows().iter().filter(|other| other.spot > row.spot).find(is_like);
    for (word, other) in [("previous", before), ("next", after)] {
        if let Some(other) = other {
            let text = format!("{word} {{{}}} {}", other.event.frames.last, event_text(core, other));
            all.push(Item::new(&text, Role::Link).leading(ItemTarget::Place(JumpPlace::Event(other.spot))));
        }
    }
    all
}

fn event_text(core: &Core, row: &Row) -> String {
    let time = core.time_words(row.event.time, 3).map_or(String::new(), |time| time + " ");
    format!("{time}{} {} {}", row.who, row.kind, row.news)
}
