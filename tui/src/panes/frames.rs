//! Frames at the cursor, one row per identifier: count, period, age and changed bytes.
//!
//! ```text
//! ID    Message                Count  Mean ms  Jitter    Age  Data
//! 000   NMT                        1                   5.680  01 00
//! 186   TPDO1 of 6                38   100.0   0.228  ⚠1.930  01 00
//! 705   heartbeat, guarding of 5  19   200.0   0.300  ⚠2.320  05
//! 8 identifiers, 154 frames; 27 error frames
//! ```
//!
//! Bytes changed by the last frame are highlighted; bytes that never changed are dimmed.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use cobscope_decoder::frame::{BusIndex, CanId};
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::session::Bus;
use cobscope_decoder::sink::escape;
use cobscope_decoder::statistics::{IdentifierRow, Identifiers, MOST_ROWS};
use cobscope_decoder::wire::j1939::J1939Id;
use cobscope_decoder::words::plural;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};

use super::common::{bus_short, bus_title, bus_width, chosen, has_buses, move_in};
use super::legend::{self, Legend};
use super::{Effect, Pane, Sorting};
use crate::action::Action;
use crate::figures::{millis, seconds};
use crate::state::Core;
use crate::theme::{Glyph, Role};
use crate::timeline::SignalKey;
use crate::widgets::draw;
use crate::widgets::table::{Cell, Column, Row, Table, TableState, Width};

/// Subject of a row: bus, identifier, and whether it counts remote frames.
type Key = (BusIndex, CanId, bool);

/// The table of identifiers.
#[derive(Debug)]
pub struct Frames {
    table: TableState,
    /// The selected row; sorting moves it.
    selected: Option<Key>,
    /// The highlighted row.
    marked: Option<Key>,
}

impl Default for Frames {
    fn default() -> Self {
        let table = TableState { column: ID, ..TableState::default() };
        Self { table, selected: None, marked: None }
    }
}

/// Intervals from which an identifier can be periodic.
const REGULAR: u64 = 3;

/// Intervals from which a silence longer than all before is overdue, however irregular the identifier is.
const MANY: u64 = 50;

/// Width of the pane from which payloads longer than eight bytes have more room.
const WIDE: u16 = 140;

fn columns(bus: u16, is_j1939: bool, data: u16) -> Vec<Column> {
    vec![
        Column::new(bus_title(bus), Width::Fixed(bus)),
        Column::new("ID", Width::Fixed(if is_j1939 { 9 } else { 5 })),
        Column::new("PGN", Width::Fixed(if is_j1939 { 6 } else { 0 })).right().priority(2),
        Column::new("SA", Width::Fixed(if is_j1939 { 2 } else { 0 })).priority(2),
        Column::new("Message", Width::Min(18)).priority(11),
        Column::new("Count", Width::Fixed(7)).right().priority(8),
        Column::new("Mean ms", Width::Fixed(7)).right().priority(7),
        Column::new("Jitter", Width::Fixed(7)).right().priority(6),
        Column::new("Gap", Width::Fixed(7)).right().priority(3),
        Column::new("Age s", Width::Fixed(8)).right().priority(10),
        Column::new("Len", Width::Fixed(3)).right().priority(4),
        Column::new("Data", Width::Fixed(data)).priority(12),
        Column::new("ASCII", Width::Fixed(8)).priority(1),
    ]
}

const ID: usize = 1;
const PGN: usize = 2;
const SOURCE: usize = 3;

fn key(row: &IdentifierRow) -> Key {
    (row.bus, row.id, row.is_remote)
}

/// Nanoseconds since the last frame.
fn age(core: &Core, row: &IdentifierRow) -> Option<i64> {
    Some(core.world()?.time()?.since(row.last_time?))
}

/// Whether the next frame is overdue. Requests, responses, commands and faults have no interval.
fn is_overdue(core: &Core, row: &IdentifierRow) -> bool {
    let bus = core.world().and_then(|world| world.buses().get(usize::from(row.bus.0)));
    if !bus.is_some_and(|bus| bus.is_periodic(row.id)) {
        return false;
    }
    let (Some(age), Some(mean)) = (age(core, row), row.intervals.mean()) else { return false };
    let (longest, count) = (row.intervals.longest().map_or(0, |(length, _)| length), row.intervals.count());
    let limit = mean.saturating_mul(3);
    let is_regular = count >= REGULAR && longest <= limit;
    age > limit && (is_regular || (count >= MANY && age > longest))
}

fn describe(world: &ReplayState, row: &IdentifierRow) -> String {
    let bus = world.buses().get(usize::from(row.bus.0));
    let what = bus.map_or(String::new(), |bus| bus.describe_id(row.id));
    escape(&what).into_owned()
}

/// PGN and source address of a J1939 identifier.
fn group(world: &ReplayState, row: &IdentifierRow) -> Option<J1939Id> {
    let CanId::Extended(id) = row.id else { return None };
    let is_j1939 = world.buses().get(usize::from(row.bus.0)).is_some_and(Bus::is_j1939);
    J1939Id::of(id).filter(|_| is_j1939)
}

/// Comparison of two rows.
type Compare<'a> = Box<dyn FnMut(&&IdentifierRow, &&IdentifierRow) -> Ordering + 'a>;

/// The rows by identifier, or by the column and direction of `sort`.
fn order<'a>(core: &Core, world: &'a ReplayState, sort: Option<(usize, bool)>) -> Vec<&'a IdentifierRow> {
    let mut rows: Vec<_> = world.identifiers().rows().iter().collect();
    rows.sort_by_key(|row| (row.bus, row.id.number(), key(row)));
    let Some((column, is_descending)) = sort else { return rows };
    let mut compare: Compare<'_> = match column {
        0 => Box::new(|one, other| one.bus.cmp(&other.bus)),
        ID => Box::new(|one, other| one.id.number().cmp(&other.id.number())),
        PGN | SOURCE => {
            let part = move |row: &IdentifierRow| {
                group(world, row).map(|id| if column == PGN { id.pgn.number() } else { u32::from(id.source) })
            };
            Box::new(move |one, other| part(one).cmp(&part(other)))
        }
        4 => {
            let names: BTreeMap<Key, String> =
                rows.iter().map(|row| (key(row), describe(world, row))).collect();
            Box::new(move |one, other| names.get(&key(one)).cmp(&names.get(&key(other))))
        }
        5 => Box::new(|one, other| one.count.cmp(&other.count)),
        6 => Box::new(|one, other| one.intervals.mean().cmp(&other.intervals.mean())),
        7 => Box::new(|one, other| one.intervals.jitter().cmp(&other.intervals.jitter())),
        8 => Box::new(|one, other| one.last_gap.cmp(&other.last_gap)),
        9 => Box::new(|one, other| age(core, one).cmp(&age(core, other))),
        10 => Box::new(|one, other| one.payload().len().cmp(&other.payload().len())),
        _ => Box::new(|one, other| one.payload().cmp(other.payload())),
    };
    rows.sort_by(|one, other| if is_descending { compare(other, one) } else { compare(one, other) });
    rows
}

/// Width of the data column: that of the longest payload, if the pane is wide enough.
fn data_width(identifiers: &Identifiers, area: Rect) -> u16 {
    let longest = identifiers.rows().iter().map(|row| row.payload().len()).max().unwrap_or(0).max(8);
    let most = if area.width >= WIDE { area.width - 100 } else { 23 };
    draw::cells(longest * 3 - 1).min(most)
}

impl Frames {
    fn at(&self, rows: &[&IdentifierRow]) -> usize {
        let at = self.selected.and_then(|wanted| rows.iter().position(|row| key(row) == wanted));
        at.unwrap_or(self.table.selected).min(rows.len().saturating_sub(1))
    }

    fn row<'a>(&self, core: &Core, world: &'a ReplayState) -> Option<&'a IdentifierRow> {
        let rows = order(core, world, self.table.sort);
        rows.get(self.at(&rows)).copied()
    }

    fn moves(&mut self, action: Action, core: &Core, world: &ReplayState) {
        let rows = order(core, world, self.table.sort);
        let (len, height) = (rows.len(), usize::from(core.height).saturating_sub(2));
        self.table.selected = self.at(&rows);
        move_in(&mut self.table, action, height, len);
        self.selected = rows.get(self.table.selected).map(|row| key(row));
    }

    fn columns(core: &Core, world: &ReplayState, area: Rect) -> Vec<Column> {
        let is_j1939 = world.identifiers().rows().iter().any(|row| matches!(row.id, CanId::Extended(_)));
        let shown = columns(bus_width(core, area.width), is_j1939, data_width(world.identifiers(), area));
        chosen(core, "frames", columns(4, true, 0), shown)
    }

    /// Indices of the visible columns.
    fn shown(core: &Core, world: &ReplayState) -> Vec<usize> {
        let area = Rect::new(0, 0, core.width, core.height.saturating_sub(1));
        let columns = Self::columns(core, world, area);
        Table::new(&core.theme, &columns).row_count(world.identifiers().rows().len()).shown(area)
    }

    fn draw_row(
        &self,
        core: &Core,
        world: &ReplayState,
        row: &IdentifierRow,
        (bus_room, width): (u16, u16),
    ) -> Row<'static> {
        let theme = &core.theme;
        let quiet = theme.style(Role::Quiet);
        let bus = world.buses().get(usize::from(row.bus.0)).map_or("", |bus| bus.name());
        let group = group(world, row);
        let figure = |value: Option<i64>| value.map(short).unwrap_or_default();
        let age = age(core, row).map(seconds).unwrap_or_default();
        let age = if is_overdue(core, row) {
            Cell::new(format!("{}{age}", theme.glyph(Glyph::Warning)), theme.style(Role::Caution))
        } else {
            Cell::from(age)
        };
        let id = if row.is_remote { format!("{}R", row.id) } else { row.id.to_string() };
        let cells = Row::new([
            Cell::new(bus_short(core, &escape(bus), bus_room), quiet),
            Cell::from(id),
            Cell::from(group.map(|id| format!("{:05X}", id.pgn.number())).unwrap_or_default()),
            Cell::from(group.map(|id| format!("{:02X}", id.source)).unwrap_or_default()),
            Cell::from(describe(world, row)),
            Cell::from(row.count.to_string()),
            Cell::from(figure(row.intervals.mean())),
            Cell::new(figure(row.intervals.jitter()), quiet),
            Cell::new(figure(row.last_gap), quiet),
            age,
            Cell::new(row.payload().len().to_string(), quiet),
            Cell::from(data(core, row, width)),
            Cell::new(ascii(row), quiet),
        ]);
        let is_marked = self.marked == Some(key(row));
        cells.style(if is_marked { theme.style(Role::Highlight(1)) } else { Style::new() })
    }

    /// Plots all numeric signals of a row.
    fn plot(row: &IdentifierRow) -> Vec<Effect> {
        let Some(layout) = &row.layout else {
            return vec![Effect::Refuse(format!("{}: bit layout unknown", row.id))];
        };
        let effects: Vec<Effect> = SignalKey::all(row.bus, row.id, layout).map(Effect::Plot).collect();
        if effects.is_empty() {
            return vec![Effect::Refuse(format!("{}: no numeric signals", row.id))];
        }
        effects
    }
}

/// Milliseconds in at most seven characters.
fn short(nanoseconds: i64) -> String {
    let text = millis(nanoseconds);
    if text.len() <= 7 { text } else { text.split('.').next().unwrap_or_default().to_owned() }
}

/// Bytes of the last frame: changed by it, changed before, never changed.
fn data(core: &Core, row: &IdentifierRow, width: u16) -> Line<'static> {
    if row.is_remote {
        return Line::styled("remote", core.theme.style(Role::Quiet));
    }
    let room = usize::from(width.saturating_add(1) / 3);
    let payload = row.payload();
    let shown = if payload.len() > room { room.saturating_sub(1) } else { payload.len() };
    let mut spans = Vec::new();
    for (at, byte) in payload.iter().take(shown).enumerate() {
        let is_in = |bits: u64| bits >> at.min(63) & 1 == 1;
        let role = match () {
            () if is_in(row.changed) => Role::Changed,
            () if is_in(row.ever_changed) => Role::Text,
            () => Role::Quiet,
        };
        if at > 0 {
            spans.push(Span::raw(" "));
        }
        spans.push(Span::styled(format!("{byte:02X}"), core.theme.style(role)));
    }
    if shown < payload.len() {
        spans.push(Span::raw(format!(" {}", core.theme.glyph(Glyph::Ellipsis))));
    }
    Line::from(spans)
}

/// The bytes as ASCII; a dot for each non-printable character.
fn ascii(row: &IdentifierRow) -> String {
    let shown = |byte: &u8| if byte.is_ascii_graphic() || *byte == b' ' { char::from(*byte) } else { '.' };
    row.payload().iter().take(8).map(shown).collect()
}

/// The summary below the table.
fn total(core: &Core, world: &ReplayState) -> Line<'static> {
    let identifiers = world.identifiers();
    let theme = &core.theme;
    let rows = identifiers.rows();
    let frames: u64 = rows.iter().map(|row| row.count).sum();
    let mut spans = vec![Span::styled(
        format!("{}, {} up to the cursor", plural(rows.len(), "identifier"), plural(frames, "frame")),
        theme.style(Role::Quiet),
    )];
    let mut add = |count: u64, text: String, role: Role| {
        if count > 0 {
            spans.push(Span::styled(format!("; {text}"), theme.style(role)));
        }
    };
    let overdue = rows.iter().filter(|row| is_overdue(core, row)).count() as u64;
    add(overdue, format!("{overdue} overdue"), Role::Caution);
    let errors = world.counts().errors;
    add(errors, plural(errors, "error frame"), Role::Bad);
    let others = identifiers.others();
    add(
        others,
        format!("{} of identifiers beyond the first {MOST_ROWS}", plural(others, "frame")),
        Role::Caution,
    );
    Line::from(spans)
}

impl Pane for Frames {
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer) {
        let Some(world) = core.world() else {
            let text = Line::styled("reading …", core.theme.style(Role::Quiet));
            return draw::line(buf, area, &text, draw::Align::Left, &core.theme);
        };
        let inside = Rect { height: area.height.saturating_sub(1), ..area };
        let rows = order(core, world, self.table.sort);
        let columns = Self::columns(core, world, area);
        let widths = (bus_width(core, area.width), data_width(world.identifiers(), area));
        let state = TableState { selected: self.at(&rows), ..self.table.clone() };
        let row = |index: usize| -> Row<'_> {
            rows.get(index).map_or_else(Row::default, |row| self.draw_row(core, world, row, widths))
        };
        let table = Table::new(&core.theme, &columns).row_count(rows.len()).rows(row).state(&state);
        table.empty("no frames up to the cursor").render(inside, buf);
        let below = Rect { y: inside.bottom(), height: area.height - inside.height, ..area };
        draw::line(buf, below, &total(core, world), draw::Align::Left, &core.theme);
    }

    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        let Some(world) = core.world() else { return Vec::new() };
        match action {
            Action::Down | Action::Up | Action::PageDown | Action::PageUp | Action::Top | Action::Bottom => {
                self.moves(action, core, world);
            }
            Action::Left => self.table.move_column(-1, &Self::shown(core, world)),
            Action::Right => self.table.move_column(1, &Self::shown(core, world)),
            Action::Sort => {
                self.selected = self.row(core, world).map(key);
                self.table.cycle_sort(&Self::shown(core, world));
            }
            Action::Highlight => {
                let row = self.row(core, world).map(key);
                self.marked = if self.marked == row { None } else { row };
            }
            Action::Clear => self.marked = None,
            Action::Plot => return self.row(core, world).map_or_else(Vec::new, Self::plot),
            Action::Open => {
                let Some(row) = self.row(core, world) else { return Vec::new() };
                let Some(bus) = world.buses().get(usize::from(row.bus.0)) else { return Vec::new() };
                let node = row.node.map(|node| Effect::Node((row.bus, node)));
                let said = format!("events of {}; v also shows repetitions", row.id);
                let rest = [Effect::Filter(filter(core, bus, row)), Effect::Say(said), Effect::ShowEvents];
                return node.into_iter().chain(rest).collect();
            }
            _ => {}
        }
        Vec::new()
    }

    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect> {
        let Some(world) = core.world() else { return Vec::new() };
        let inside = Rect { height: area.height.saturating_sub(1), ..area };
        let rows = order(core, world, self.table.sort);
        let columns = Self::columns(core, world, area);
        let table = Table::new(&core.theme, &columns).row_count(rows.len());
        if let Some(column) = table.column_at(inside, x) {
            self.table.column = column;
        }
        let state = TableState { selected: self.at(&rows), ..self.table.clone() };
        if Table::is_title_at(inside, y) {
            self.table.cycle_sort(&table.shown(inside));
        } else if let Some(row) = table.row_at(inside, y, &state).and_then(|row| rows.get(row)) {
            self.selected = Some(key(row));
        }
        Vec::new()
    }

    fn sorting(&self) -> Sorting {
        self.table.sort
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.table.sort = sorting;
    }

    fn legend(&self) -> &'static Legend {
        &legend::FRAMES
    }

    fn heads(&self) -> Vec<Column> {
        columns(4, true, 0)
    }

    fn performs(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Sort, Action::Highlight, Action::Plot]
    }

    fn actions(&self) -> &'static [Action] {
        &[
            Action::Open,
            Action::Sort,
            Action::Highlight,
            Action::Plot,
            Action::FilterCell,
            Action::GoTo,
            Action::NextFinding,
        ]
    }

    fn filter_of_cell(&self, core: &Core) -> Option<String> {
        let world = core.world()?;
        let row = self.row(core, world)?;
        let bus = world.buses().get(usize::from(row.bus.0))?;
        let group = group(world, row);
        Some(match (self.table.column_in(&Self::shown(core, world)), group) {
            (0, _) => format!("bus == {:?}", bus.name()),
            (PGN, Some(group)) => format!("pgn == {}", group.pgn.number()),
            (SOURCE, Some(group)) => format!("source_address == 0x{:02X}", group.source),
            _ => filter(core, bus, row),
        })
    }

    fn line(&self, core: &Core) -> Option<String> {
        let world = core.world()?;
        let row = self.row(core, world)?;
        let data: Vec<String> = row.payload().iter().map(|byte| format!("{byte:02X}")).collect();
        Some(format!(
            "{} {} {}, last {}",
            row.id,
            describe(world, row),
            plural(row.count, "frame"),
            data.join(" ")
        ))
    }
}

/// A filter for the events of a row.
fn filter(core: &Core, bus: &Bus, row: &IdentifierRow) -> String {
    let filter = bus.filter_of_id(row.id);
    if has_buses(core) { format!("bus == {:?} && {filter}", bus.name()) } else { filter }
}
