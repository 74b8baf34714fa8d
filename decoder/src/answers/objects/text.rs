//! Objects of a node as a table.

use std::borrow::Cow;
use std::fmt::Write as _;

use crate::escape::escape;
use crate::figures::format_seconds;
use crate::frame::Timestamp;
use crate::profile::{DecodedValue, Persistence};
use crate::session::{Bus, Node, StoredObject};
use crate::wire::canopen::ObjectAddress;
use crate::words::count_noun;

/// Maximum widths of the name and value columns; most lines then fit 100 columns.
const WIDEST_NAME: usize = 50;
const WIDEST_VALUE: usize = 24;

/// Maximum number of bytes printed per value.
const SHOWN_BYTES: usize = 16;

/// Writes all objects of a node in columns; long names and values are truncated. `first` is the time of the first
/// frame.
pub fn write_table(node: &Node, first: Option<Timestamp>, output: &mut String) {
    let row = |(object, entry)| ObjectLine::row_of(node, object, entry);
    let rows: Vec<_> = node.store().sorted().into_iter().map(row).collect();
    let names = rows.iter().map(|row| column_width(&row.name, WIDEST_NAME)).max().unwrap_or_default();
    let values = rows.iter().map(|row| column_width(&row.value, WIDEST_VALUE)).max().unwrap_or_default();
    for row in &rows {
        let (name, value) = (cut_cell(&row.name, names), cut_cell(&row.value, values));
        let line = format!(
            "{}  {name:<names$}  {value:<values$}  {:<7}{}  {}{}",
            row.object,
            row.entry.origin.kind.origin_text(),
            value_place(row.entry, first),
            value_bytes(row.entry),
            pending_value(node, row.object),
        );
        let _ = writeln!(output, "{}", line.trim_end());
    }
}

/// One object with escaped texts.
struct ObjectLine<'a> {
    object: ObjectAddress,
    name: String,
    value: String,
    entry: &'a StoredObject,
}

impl<'a> ObjectLine<'a> {
    fn row_of(node: &Node, object: ObjectAddress, entry: &'a StoredObject) -> Self {
        let known = node.meaning(object);
        let value = match known.as_ref().map(|known| (known, known.decode(&entry.value))) {
            Some((_, DecodedValue::Bytes(_))) | None => String::new(),
            Some((known, value)) => known.format_value(&value),
        };
        let stale = if entry.stale { "?" } else { "" };
        let name = known.as_ref().map_or(String::new(), |known| escape(&known.name).into_owned());
        Self { object, name, value: format!("{}{stale}", escape(&value)), entry }
    }
}

/// Width of a cell, limited to `most`.
fn column_width(cell: &str, most: usize) -> usize {
    cell.chars().count().min(most)
}

/// A cell truncated to `width`.
fn cut_cell(cell: &str, width: usize) -> Cow<'_, str> {
    if cell.chars().count() <= width {
        return cell.into();
    }
    let mut cut: String = cell.chars().take(width.saturating_sub(1)).collect();
    cut.push('…');
    cut.into()
}

/// Bytes of a value, truncated if there are many.
fn value_bytes(entry: &StoredObject) -> String {
    let shown = entry.value.get(..SHOWN_BYTES).unwrap_or(&entry.value);
    let data = DecodedValue::Bytes(shown.to_vec());
    if entry.size > shown.len() as u64 {
        format!("{data} … {}", count_noun(entry.size, "byte"))
    } else {
        data.to_string()
    }
}

/// Pending new value and storage of an object.
fn pending_value(node: &Node, object: ObjectAddress) -> String {
    let waiting = node.store().waiting_value(object).map_or(String::new(), |waiting| {
        let meaning = node.meaning(object);
        let shown = meaning.map_or_else(
            || DecodedValue::Bytes(waiting.value.clone()).to_string(),
            |meaning| meaning.format_value(&meaning.decode(&waiting.value)),
        );
        format!("  → {} {}{}", escape(&shown), waiting.effect.time_text(), waiting.origin.origin_place())
    });
    let persists = match node.persistence_text(object) {
        Some(Persistence::No) => "  lost at a restart",
        Some(Persistence::NotStored) => "  not stored",
        _ => "",
    };
    format!("{waiting}{persists}")
}

/// `node 2/02 pump on can0`.
pub fn node_label(bus: &Bus, node: &Node) -> String {
    let name = node.name().map_or(String::new(), |name| format!(" {}", escape(name)));
    format!("{}{name} on {}", node.id().sentence_label(), escape(bus.name()))
}

/// ` {88} 1.234 s`: frame and time of a value; empty for a value from a file.
pub(super) fn value_place(entry: &StoredObject, first: Option<Timestamp>) -> String {
    let place = entry.origin.origin_place();
    let time = entry
        .origin
        .time
        .zip(first)
        .map_or(String::new(), |(time, first)| format!(" {} s", format_seconds(time.since(first))));
    format!("{place}{time}")
}
