//! All known signals with their values at the cursor.
//!
//! ```text
//!   Node   From   Signal                    Value
//! ✓ 2/02   TPDO1  Actual pressure        124.9 bar
//!   2/02   TPDO1  Status byte            08h pres…
//! ```

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::sync::Arc;

use cobscope_decoder::frame::{BusIndex, CanId};
use cobscope_decoder::profile::{PdoDirection, SignalField, SignalId};
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::IdentifierRow;
use cobscope_decoder::wire::NodeId;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use crate::panes::common::chosen_columns;
use crate::state::{SearchPattern, UiState};
use crate::theme::{Glyph, TextRole};
use crate::timeline::{SignalKey, signal};
use crate::widgets::draw;
use crate::widgets::table::{ColumnWidth, TableCell, TableColumn, TableRow, TableState, TableWidget};

/// A signal with its texts.
#[derive(Debug, Clone)]
pub(super) struct SignalEntry {
    pub(super) key: SignalKey,
    node: String,
    from: String,
    order: Order,
}

/// Bus, node, received by the node, PDO number, identifier.
type Order = (u8, u8, bool, u16, u32);

/// The list of signals with its selection.
#[derive(Debug, Default)]
pub(super) struct SignalList {
    entries: Vec<SignalEntry>,
    /// Indices of the entries that match the search.
    shown: Vec<usize>,
    state: TableState,
    sought: Option<SearchPattern>,
    /// Fingerprint of the identifiers and layouts that the entries were made from.
    made_of: u64,
}

/// Maximum width of node names.
const MOST_NODE: u16 = 12;

/// Width of the values by the width of the list: (from, width).
const VALUES: [(u16, u16); 3] = [(110, 32), (70, 20), (0, 14)];

impl SignalList {
    /// Columns as wide as their content needs.
    pub(super) fn list_columns(&self, area: Rect) -> [TableColumn; 5] {
        let widest = |text: fn(&SignalEntry) -> &str, most: u16| {
            let widths = self.entries.iter().map(|entry| draw::text_width(text(entry)));
            ColumnWidth::Fixed(widths.max().unwrap_or(0).clamp(4, most))
        };
        let value = VALUES.iter().find(|(least, _)| area.width >= *least).map_or(0, |(_, value)| *value);
        [
            TableColumn::new("", ColumnWidth::Fixed(1)),
            TableColumn::new("Node", widest(|entry| &entry.node, MOST_NODE)).with_priority(3),
            TableColumn::new("From", widest(|entry| &entry.from, 8)).with_priority(2),
            TableColumn::new("Signal", ColumnWidth::Fill),
            TableColumn::new("Value", ColumnWidth::Fixed(value)).align_right().with_priority(4),
        ]
    }

    /// Rebuilds the entries if identifiers or layouts changed.
    pub(super) fn refresh_entries(&mut self, core: &UiState) {
        let end = core.timeline.end_state();
        let worlds: Vec<&ReplayState> = core.bus_state().into_iter().chain(end.as_deref()).collect();
        let made_of = layout_fingerprint(&worlds);
        if made_of == self.made_of {
            return;
        }
        self.made_of = made_of;
        let selected = self.selected_signal().cloned();
        self.entries = signal_entries(&worlds);
        self.narrow_entries();
        if let Some(key) = selected {
            self.select_signal(&key);
        }
        self.state.clamp_to(self.shown.len());
    }

    /// Selects a signal if it is listed.
    pub(super) fn select_signal(&mut self, key: &SignalKey) {
        let place = self.listed_entries().position(|entry| entry.key == *key);
        self.state.selected = place.unwrap_or(self.state.selected);
    }

    /// Lists only signals that match `text`; all if it is empty.
    pub(super) fn search_signals(&mut self, text: &str) {
        self.sought = match SearchPattern::new(text) {
            _ if text.trim().is_empty() => None,
            Ok(pattern) => Some(pattern),
            // An incomplete pattern: keep the last valid one.
            Err(_) => return,
        };
        self.narrow_entries();
        self.state.select_first();
    }

    /// Text of the search; empty if all signals are listed.
    pub(super) fn search_text(&self) -> &str {
        self.sought.as_ref().map_or("", |sought| &sought.text)
    }

    pub(super) fn is_narrowed(&self) -> bool {
        self.sought.is_some()
    }

    fn narrow_entries(&mut self) {
        let has = |entry: &SignalEntry| {
            let text = format!("{} {} {} {}", entry.node, entry.from, entry.key.name, entry.key.unit);
            self.sought.as_ref().is_none_or(|sought| sought.pattern.is_match(&text))
        };
        let places = self.entries.iter().enumerate().filter(|(_, entry)| has(entry));
        self.shown = places.map(|(place, _)| place).collect();
    }

    fn listed_entries(&self) -> impl Iterator<Item = &SignalEntry> {
        self.shown.iter().filter_map(|place| self.entries.get(*place))
    }

    pub(super) fn len(&self) -> usize {
        self.shown.len()
    }

    pub(super) fn selected_signal(&self) -> Option<&SignalKey> {
        self.entries.get(*self.shown.get(self.state.selected)?).map(|entry| &entry.key)
    }

    pub(super) fn move_by(&mut self, delta: isize) {
        self.state.move_by(delta, self.shown.len());
    }

    pub(super) fn page_selection(&mut self, delta: isize, height: usize) {
        self.state.page_selection(delta, height, self.shown.len());
    }

    /// Selects the row at a screen line.
    pub(super) fn click_row(&mut self, core: &UiState, area: Rect, y: u16) {
        let columns = self.list_columns(area);
        let table = TableWidget::new(&core.theme, &columns).row_count(self.len());
        if let Some(row) = table.row_at(area, y, &self.state) {
            self.state.selected = row;
        }
    }

    /// Draws the list; `look_of` returns the role of a plotted signal.
    pub(super) fn draw_list(
        &self,
        core: &UiState,
        area: Rect,
        buf: &mut Buffer,
        look_of: impl Fn(&SignalKey) -> Option<TextRole>,
    ) {
        let columns =
            chosen_columns(core, "signals", self.list_columns(Rect::ZERO), self.list_columns(area).to_vec());
        let others: u16 = columns
            .iter()
            .map(|column| match column.width {
                ColumnWidth::Fixed(width) => width + 1,
                ColumnWidth::Min(_) | ColumnWidth::Fill => 1,
            })
            .sum();
        let room = area.width.saturating_sub(others);
        let row = |index: usize| -> TableRow<'_> {
            let entry = self.shown.get(index).and_then(|place| self.entries.get(*place));
            let Some(entry) = entry else { return TableRow::default() };
            let style = look_of(&entry.key).map(|role| core.theme.role_style(role));
            let mark = if style.is_some() { core.theme.glyph(Glyph::Check) } else { "" };
            let style = style.unwrap_or_default();
            TableRow::new([
                TableCell::new(mark, style),
                entry.node.as_str().into(),
                TableCell::new(entry.from.as_str(), core.theme.role_style(TextRole::Quiet)),
                TableCell::new(fit_name(&entry.key.name, room), style),
                value_text(core, &entry.key).unwrap_or_default().into(),
            ])
        };
        let empty = match (core.bus_state(), self.is_narrowed()) {
            (None, _) => "reading …",
            (_, true) => "no signal matches; c shows all",
            _ if core.timeline.progress().is_complete() => {
                "no signals known; assign devices (--node), EDS (--eds) or DBC files (--dbc)"
            }
            _ => "no signals yet",
        };
        let table = TableWidget::new(&core.theme, &columns)
            .row_count(self.len())
            .with_rows(row)
            .with_state(&self.state)
            .with_empty_text(empty);
        table.render(area, buf);
    }

    /// Text of the selected signal, for the clipboard.
    pub(super) fn selected_text(&self, core: &UiState) -> Option<String> {
        let entry = self.entries.get(*self.shown.get(self.state.selected)?)?;
        let value = value_text(core, &entry.key).unwrap_or_default();
        Some(format!("{} {} {} {value}", entry.node, entry.from, entry.key.name))
    }
}

/// A name, or the part after its comma if the room is too small: many names share the part before it.
pub(super) fn fit_name(name: &str, room: u16) -> &str {
    match name.split_once(", ") {
        Some((_, rest)) if draw::text_width(name) > room => rest,
        _ => name,
    }
}

/// Last data of the signal's identifier before the cursor.
pub(super) fn row_at<'a>(core: &'a UiState, key: &SignalKey) -> Option<&'a IdentifierRow> {
    let is_it = |row: &&IdentifierRow| row.id == key.id && row.bus == key.bus && !row.is_remote;
    core.bus_state()?.identifiers().rows().iter().find(is_it)
}

/// Value at the cursor with its unit.
fn value_text(core: &UiState, key: &SignalKey) -> Option<String> {
    let row = row_at(core, key)?;
    let layout = row.layout.as_ref()?;
    let (place, field) = key.field_in(layout)?;
    Some(signal::value_text(layout, field, &layout.decode_signal(place, row.payload())?.value))
}

/// Value at the cursor as a number.
pub(super) fn cursor_value(core: &UiState, key: &SignalKey) -> Option<f64> {
    let row = row_at(core, key)?;
    let layout = row.layout.as_ref()?;
    let (place, field) = key.field_in(layout)?;
    field.plot_number(&layout.decode_signal(place, row.payload())?.value)
}

/// Fingerprint of identifiers and layouts.
fn layout_fingerprint(worlds: &[&ReplayState]) -> u64 {
    let mut hasher = DefaultHasher::new();
    for world in worlds {
        for row in world.identifiers().rows() {
            (row.id, row.bus, row.layout.as_ref().map(Arc::as_ptr)).hash(&mut hasher);
        }
        worlds.len().hash(&mut hasher);
    }
    hasher.finish()
}

/// The signals of several states, each once; the first entry with a known meaning is used.
fn signal_entries(worlds: &[&ReplayState]) -> Vec<SignalEntry> {
    let several = worlds.iter().any(|world| world.buses().len() > 1);
    let mut places = HashMap::new();
    let mut entries: Vec<SignalEntry> = Vec::new();
    for world in worlds {
        // A value that one node sends in several messages is listed once, for the most frequent message.
        let mut rows: Vec<_> = world.identifiers().rows().iter().filter(|row| !row.is_remote).collect();
        rows.sort_by_key(|row| (std::cmp::Reverse(row.count), row.id.number()));
        for row in rows {
            let Some(layout) = &row.layout else { continue };
            for key in SignalKey::signals_of(row.bus, row.id, layout) {
                let place = *places.entry(signal_identity(row, &key)).or_insert(entries.len());
                match entries.get_mut(place) {
                    None => entries.push(signal_entry(world, row, key, several)),
                    Some(known) if !is_meant(&known.key) && is_meant(&key) => {
                        *known = signal_entry(world, row, key, several);
                    }
                    Some(_) => {}
                }
            }
        }
    }
    entries.sort_by_key(|entry| (entry.order, entry.key.field));
    entries
}

fn is_meant(key: &SignalKey) -> bool {
    key.layout.fields.get(key.field).is_some_and(|field| field.meaning.is_some())
}

/// Identity of a signal across messages and time.
#[derive(PartialEq, Eq, Hash)]
struct SignalIdentity {
    bus: BusIndex,
    node: Option<NodeId>,
    direction: Option<PdoDirection>,
    /// Identifier; 0 for a PDO.
    message: u32,
    object: Option<u64>,
    /// Name of a signal without an object or SPN.
    name: Option<String>,
    /// Number of equal fields before this one.
    before: usize,
}

fn signal_identity(row: &IdentifierRow, key: &SignalKey) -> SignalIdentity {
    let id = key.layout.fields.get(key.field).map(|field| field.id);
    let object = match id {
        Some(SignalId::Object(object)) => Some(u64::from(object.index) << 8 | u64::from(object.sub)),
        Some(SignalId::Spn(spn)) => Some(1 << 40 | u64::from(spn)),
        Some(SignalId::Name) | None => None,
    };
    // The priority of a J1939 identifier does not change its content.
    let message = match (row.pdo, row.id) {
        (Some(_), _) => 0,
        (None, CanId::Extended(id)) => id & 0x03FF_FFFF,
        (None, id) => id.number(),
    };
    let is_same = |field: &&SignalField| Some(field.id) == id && object.is_some();
    SignalIdentity {
        bus: row.bus,
        node: row.node,
        direction: row.pdo.map(|pdo| pdo.direction),
        message,
        object,
        name: object.is_none().then(|| key.name.clone()),
        before: key.layout.fields.iter().take(key.field).filter(is_same).count(),
    }
}

fn signal_entry(world: &ReplayState, row: &IdentifierRow, key: SignalKey, several: bool) -> SignalEntry {
    let bus = world.buses().iter().find(|bus| bus.index() == row.bus);
    let name = row.node.and_then(|node| Some(escape(bus?.node(node)?.name()?).into_owned()));
    let node = match row.node {
        Some(NodeId::Canopen(id)) => format!("{id}/{id:02X}"),
        Some(NodeId::J1939(address)) => format!("SA{address:02X}"),
        None => String::new(),
    };
    let bus = bus.filter(|_| several).map_or(String::new(), |bus| format!("{} ", escape(bus.name())));
    let node = match name {
        Some(name) => format!("{bus}{node} {name}"),
        None => format!("{bus}{node}"),
    };
    let from = row.pdo.map_or_else(|| row.id.to_string(), |pdo| pdo.to_string());
    let is_received = row.pdo.is_some_and(|pdo| pdo.direction == PdoDirection::Receive);
    let number = row.pdo.map_or(0, |pdo| pdo.number);
    let of_node = row.node.map_or(u8::MAX, NodeId::number);
    SignalEntry { key, node, from, order: (row.bus.0, of_node, is_received, number, row.id.number()) }
}

#[cfg(test)]
mod tests {
    use cobscope_decoder::capture::BusNames;
    use cobscope_decoder::frame::Frame;
    use cobscope_decoder::profile::dbc::{self, Database};
    use cobscope_decoder::session::SessionOptions;

    use super::*;

    #[test]
    fn what_a_sender_says_with_two_priorities_is_one_signal() {
        // PGN F101 with any source address.
        let text = "VERSION \"\"\nBO_ 2565931518 SPEED: 8 N\n SG_ Speed : 0|8@1+ (1,0) [0|0] \"km/h\" N\n";
        let mut database = Database::default();
        database.add_file(dbc::parse_database(text.as_bytes()).unwrap());
        let options = SessionOptions { database: Arc::new(database), ..SessionOptions::default() };
        let mut world = ReplayState::new(options);
        let mut names = BusNames::default();
        names.index_of(b"can0").unwrap();
        for (number, id) in (1..).zip([0x18F1_0180, 0x0CF1_0180, 0x0CF1_0180, 0x18F1_0181]) {
            let frame = Frame { number, ..Frame::data_frame(CanId::from_extended(id), &[7; 8]) };
            world.push(&frame, &names, &mut |_| ());
        }
        let found = signal_entries(&[&world, &world]);
        let ids: Vec<_> = found.iter().map(|entry| entry.key.id.number()).collect();
        assert_eq!(ids, [0x0CF1_0180, 0x18F1_0181]);
    }

    #[test]
    fn a_long_name_is_cut_before_its_comma() {
        assert_eq!(fit_name("Command values, Nominal pressure", 40), "Command values, Nominal pressure");
        assert_eq!(fit_name("Command values, Nominal pressure", 20), "Nominal pressure");
        assert_eq!(fit_name("Pressure", 4), "Pressure");
    }
}
