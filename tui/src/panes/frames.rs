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
use cobscope_decoder::statistics::{IdentifierRow, IdentifierRows, MOST_ROWS};
use cobscope_decoder::wire::j1939::J1939Id;
use cobscope_decoder::words::count_noun;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};

use super::common::{bus_short, bus_title, bus_width, chosen_columns, has_buses, move_in};
use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest, Sorting};
use crate::action::Action;
use crate::state::UiState;
use crate::theme::{Glyph, TextRole};
use crate::timeline::SignalKey;
use crate::widgets::draw;
use crate::widgets::table::{ColumnWidth, TableCell, TableColumn, TableRow, TableState, TableWidget};
use cobscope_decoder::figures::{format_millis, format_seconds};

/// Subject of a row: bus, identifier, and whether it counts remote frames.
type Key = (BusIndex, CanId, bool);

/// The table of identifiers.
#[derive(Debug)]
pub struct FramesPane {
    table: TableState,
    /// The selected row; sorting moves it.
    selected: Option<Key>,
    /// The highlighted row.
    marked: Option<Key>,
}

impl Default for FramesPane {
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

fn frame_columns(bus: u16, is_j1939: bool, data: u16) -> Vec<TableColumn> {
    vec![
        TableColumn::new(bus_title(bus), ColumnWidth::Fixed(bus)),
        TableColumn::new("ID", ColumnWidth::Fixed(if is_j1939 { 9 } else { 5 })),
        TableColumn::new("PGN", ColumnWidth::Fixed(if is_j1939 { 6 } else { 0 }))
            .align_right()
            .with_priority(2),
        TableColumn::new("SA", ColumnWidth::Fixed(if is_j1939 { 2 } else { 0 })).with_priority(2),
        TableColumn::new("Message", ColumnWidth::Min(18)).with_priority(11),
        TableColumn::new("Count", ColumnWidth::Fixed(7)).align_right().with_priority(8),
        TableColumn::new("Mean ms", ColumnWidth::Fixed(7)).align_right().with_priority(7),
        TableColumn::new("Jitter", ColumnWidth::Fixed(7)).align_right().with_priority(6),
        TableColumn::new("Gap", ColumnWidth::Fixed(7)).align_right().with_priority(3),
        TableColumn::new("Age s", ColumnWidth::Fixed(8)).align_right().with_priority(10),
        TableColumn::new("Len", ColumnWidth::Fixed(3)).align_right().with_priority(4),
        TableColumn::new("Data", ColumnWidth::Fixed(data)).with_priority(12),
        TableColumn::new("ASCII", ColumnWidth::Fixed(8)).with_priority(1),
    ]
}

const ID: usize = 1;
const PGN: usize = 2;
const SOURCE: usize = 3;

fn row_key(row: &IdentifierRow) -> Key {
    (row.bus, row.id, row.is_remote)
}

/// Nanoseconds since the last frame.
fn frame_age(core: &UiState, row: &IdentifierRow) -> Option<i64> {
    Some(core.bus_state()?.last_time()?.since(row.last_time?))
}

/// Whether the next frame is overdue. Requests, responses, commands and faults have no interval.
fn is_overdue(core: &UiState, row: &IdentifierRow) -> bool {
    let bus = core.bus_state().and_then(|world| world.buses().get(usize::from(row.bus.0)));
    if !bus.is_some_and(|bus| bus.is_periodic(row.id)) {
        return false;
    }
    let (Some(age), Some(mean)) = (frame_age(core, row), row.intervals.mean()) else { return false };
    let (longest, count) = (row.intervals.longest().map_or(0, |(length, _)| length), row.intervals.count());
    let limit = mean.saturating_mul(3);
    let is_regular = count >= REGULAR && longest <= limit;
    age > limit && (is_regular || (count >= MANY && age > longest))
}

fn describe_row(world: &ReplayState, row: &IdentifierRow) -> String {
    let bus = world.buses().get(usize::from(row.bus.0));
    let what = bus.map_or(String::new(), |bus| bus.describe_id(row.id));
    escape(&what).into_owned()
}

/// PGN and source address of a J1939 identifier.
fn j1939_group(world: &ReplayState, row: &IdentifierRow) -> Option<J1939Id> {
    let CanId::Extended(id) = row.id else { return None };
    let is_j1939 = world.buses().get(usize::from(row.bus.0)).is_some_and(|bus| bus.protocols().is_j1939());
    J1939Id::from_identifier(id).filter(|_| is_j1939)
}

/// Comparison of two rows.
type Compare<'a> = Box<dyn FnMut(&&IdentifierRow, &&IdentifierRow) -> Ordering + 'a>;

/// The rows by identifier, or by the column and direction of `sort`.
fn sort_rows<'a>(
    core: &UiState,
    world: &'a ReplayState,
    sort: Option<(usize, bool)>,
) -> Vec<&'a IdentifierRow> {
    let mut rows: Vec<_> = world.identifiers().rows().iter().collect();
    rows.sort_by_key(|row| (row.bus, row.id.number(), row_key(row)));
    let Some((column, is_descending)) = sort else { return rows };
    let mut compare: Compare<'_> = match column {
        0 => Box::new(|one, other| one.bus.cmp(&other.bus)),
        ID => Box::new(|one, other| one.id.number().cmp(&other.id.number())),
        PGN | SOURCE => {
            let part = move |row: &IdentifierRow| {
                j1939_group(world, row)
                    .map(|id| if column == PGN { id.pgn.number() } else { u32::from(id.source) })
            };
            Box::new(move |one, other| part(one).cmp(&part(other)))
        }
        4 => {
            let names: BTreeMap<Key, String> =
                rows.iter().map(|row| (row_key(row), describe_row(world, row))).collect();
            Box::new(move |one, other| names.get(&row_key(one)).cmp(&names.get(&row_key(other))))
        }
        5 => Box::new(|one, other| one.count.cmp(&other.count)),
        6 => Box::new(|one, other| one.intervals.mean().cmp(&other.intervals.mean())),
        7 => Box::new(|one, other| one.intervals.jitter().cmp(&other.intervals.jitter())),
        8 => Box::new(|one, other| one.last_gap.cmp(&other.last_gap)),
        9 => Box::new(|one, other| frame_age(core, one).cmp(&frame_age(core, other))),
        10 => Box::new(|one, other| one.payload().len().cmp(&other.payload().len())),
        _ => Box::new(|one, other| one.payload().cmp(other.payload())),
    };
    rows.sort_by(|one, other| if is_descending { compare(other, one) } else { compare(one, other) });
    rows
}

/// Width of the data column: that of the longest payload, if the pane is wide enough.
fn data_width(identifiers: &IdentifierRows, area: Rect) -> u16 {
    let longest = identifiers.rows().iter().map(|row| row.payload().len()).max().unwrap_or(0).max(8);
    let most = if area.width >= WIDE { area.width - 100 } else { 23 };
    draw::to_cells(longest * 3 - 1).min(most)
}

impl FramesPane {
    fn selected_index(&self, rows: &[&IdentifierRow]) -> usize {
        let at = self.selected.and_then(|wanted| rows.iter().position(|row| row_key(row) == wanted));
        at.unwrap_or(self.table.selected).min(rows.len().saturating_sub(1))
    }

    fn selected_row<'a>(&self, core: &UiState, world: &'a ReplayState) -> Option<&'a IdentifierRow> {
        let rows = sort_rows(core, world, self.table.sort);
        rows.get(self.selected_index(&rows)).copied()
    }

    fn move_selection(&mut self, action: Action, core: &UiState, world: &ReplayState) {
        let rows = sort_rows(core, world, self.table.sort);
        let (len, height) = (rows.len(), usize::from(core.height).saturating_sub(2));
        self.table.selected = self.selected_index(&rows);
        move_in(&mut self.table, action, height, len);
        self.selected = rows.get(self.table.selected).map(|row| row_key(row));
    }

    fn frame_columns(core: &UiState, world: &ReplayState, area: Rect) -> Vec<TableColumn> {
        let is_j1939 = world.identifiers().rows().iter().any(|row| matches!(row.id, CanId::Extended(_)));
        let shown =
            frame_columns(bus_width(core, area.width), is_j1939, data_width(world.identifiers(), area));
        chosen_columns(core, "frames", frame_columns(4, true, 0), shown)
    }

    /// Indices of the visible columns.
    fn visible_columns(core: &UiState, world: &ReplayState) -> Vec<usize> {
        let area = Rect::new(0, 0, core.width, core.height.saturating_sub(1));
        let columns = Self::frame_columns(core, world, area);
        TableWidget::new(&core.theme, &columns)
            .row_count(world.identifiers().rows().len())
            .visible_columns(area)
    }

    fn draw_row(
        &self,
        core: &UiState,
        world: &ReplayState,
        row: &IdentifierRow,
        (bus_room, width): (u16, u16),
    ) -> TableRow<'static> {
        let theme = &core.theme;
        let quiet = theme.role_style(TextRole::Quiet);
        let bus = world.buses().get(usize::from(row.bus.0)).map_or("", |bus| bus.name());
        let group = j1939_group(world, row);
        let figure = |value: Option<i64>| value.map(short_milliseconds).unwrap_or_default();
        let age = frame_age(core, row).map(format_seconds).unwrap_or_default();
        let age = if is_overdue(core, row) {
            TableCell::new(
                format!("{}{age}", theme.glyph(Glyph::Warning)),
                theme.role_style(TextRole::Caution),
            )
        } else {
            TableCell::from(age)
        };
        let id = if row.is_remote { format!("{}R", row.id) } else { row.id.to_string() };
        let cells = TableRow::new([
            TableCell::new(bus_short(core, &escape(bus), bus_room), quiet),
            TableCell::from(id),
            TableCell::from(group.map(|id| format!("{:05X}", id.pgn.number())).unwrap_or_default()),
            TableCell::from(group.map(|id| format!("{:02X}", id.source)).unwrap_or_default()),
            TableCell::from(describe_row(world, row)),
            TableCell::from(row.count.to_string()),
            TableCell::from(figure(row.intervals.mean())),
            TableCell::new(figure(row.intervals.jitter()), quiet),
            TableCell::new(figure(row.last_gap), quiet),
            age,
            TableCell::new(row.payload().len().to_string(), quiet),
            TableCell::from(data_line(core, row, width)),
            TableCell::new(ascii_text(row), quiet),
        ]);
        let is_marked = self.marked == Some(row_key(row));
        cells.with_style(if is_marked { theme.role_style(TextRole::Highlight(1)) } else { Style::new() })
    }

    /// Plots all numeric signals of a row.
    fn plot_row(row: &IdentifierRow) -> Vec<PaneRequest> {
        let Some(layout) = &row.layout else {
            return vec![PaneRequest::Refuse(format!("{}: bit layout unknown", row.id))];
        };
        let effects: Vec<PaneRequest> =
            SignalKey::signals_of(row.bus, row.id, layout).map(PaneRequest::Plot).collect();
        if effects.is_empty() {
            return vec![PaneRequest::Refuse(format!("{}: no numeric signals", row.id))];
        }
        effects
    }
}

/// Milliseconds in at most seven characters.
fn short_milliseconds(nanoseconds: i64) -> String {
    let text = format_millis(nanoseconds);
    if text.len() <= 7 { text } else { text.split('.').next().unwrap_or_default().to_owned() }
}

/// Bytes of the last frame: changed by it, changed before, never changed.
fn data_line(core: &UiState, row: &IdentifierRow, width: u16) -> Line<'static> {
    if row.is_remote {
        return Line::styled("remote", core.theme.role_style(TextRole::Quiet));
    }
    let room = usize::from(width.saturating_add(1) / 3);
    let payload = row.payload();
    let shown = if payload.len() > room { room.saturating_sub(1) } else { payload.len() };
    let mut spans = Vec::new();
    for (at, byte) in payload.iter().take(shown).enumerate() {
        let is_in = |bits: u64| bits >> at.min(63) & 1 == 1;
        let role = match () {
            () if is_in(row.changed) => TextRole::Changed,
            () if is_in(row.ever_changed) => TextRole::Text,
            () => TextRole::Quiet,
        };
        if at > 0 {
            spans.push(Span::raw(" "));
        }
        spans.push(Span::styled(format!("{byte:02X}"), core.theme.role_style(role)));
    }
    if shown < payload.len() {
        spans.push(Span::raw(format!(" {}", core.theme.glyph(Glyph::Ellipsis))));
    }
    Line::from(spans)
}

/// The bytes as ASCII; a dot for each non-printable character.
fn ascii_text(row: &IdentifierRow) -> String {
    let shown = |byte: &u8| if byte.is_ascii_graphic() || *byte == b' ' { char::from(*byte) } else { '.' };
    row.payload().iter().take(8).map(shown).collect()
}

/// The summary below the table.
fn total_line(core: &UiState, world: &ReplayState) -> Line<'static> {
    let identifiers = world.identifiers();
    let theme = &core.theme;
    let rows = identifiers.rows();
    let frames: u64 = rows.iter().map(|row| row.count).sum();
    let mut spans = vec![Span::styled(
        format!("{}, {} up to the cursor", count_noun(rows.len(), "identifier"), count_noun(frames, "frame")),
        theme.role_style(TextRole::Quiet),
    )];
    let mut add = |count: u64, text: String, role: TextRole| {
        if count > 0 {
            spans.push(Span::styled(format!("; {text}"), theme.role_style(role)));
        }
    };
    let overdue = rows.iter().filter(|row| is_overdue(core, row)).count() as u64;
    add(overdue, format!("{overdue} overdue"), TextRole::Caution);
    let errors = world.problem_counts().errors;
    add(errors, count_noun(errors, "error frame"), TextRole::Bad);
    let others = identifiers.other_frames();
    add(
        others,
        format!("{} of identifiers beyond the first {MOST_ROWS}", count_noun(others, "frame")),
        TextRole::Caution,
    );
    Line::from(spans)
}

impl Pane for FramesPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        let Some(world) = core.bus_state() else {
            let text = Line::styled("reading …", core.theme.role_style(TextRole::Quiet));
            return draw::draw_line(buf, area, &text, draw::TextAlignment::Left, &core.theme);
        };
        let inside = Rect { height: area.height.saturating_sub(1), ..area };
        let rows = sort_rows(core, world, self.table.sort);
        let columns = Self::frame_columns(core, world, area);
        let widths = (bus_width(core, area.width), data_width(world.identifiers(), area));
        let state = TableState { selected: self.selected_index(&rows), ..self.table.clone() };
        let row = |index: usize| -> TableRow<'_> {
            rows.get(index).map_or_else(TableRow::default, |row| self.draw_row(core, world, row, widths))
        };
        let table =
            TableWidget::new(&core.theme, &columns).row_count(rows.len()).with_rows(row).with_state(&state);
        table.with_empty_text("no frames up to the cursor").render(inside, buf);
        let below = Rect { y: inside.bottom(), height: area.height - inside.height, ..area };
        draw::draw_line(buf, below, &total_line(core, world), draw::TextAlignment::Left, &core.theme);
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        let Some(world) = core.bus_state() else { return Vec::new() };
        match action {
            Action::Down | Action::Up | Action::PageDown | Action::PageUp | Action::Top | Action::Bottom => {
                self.move_selection(action, core, world);
            }
            Action::Left => self.table.move_column(-1, &Self::visible_columns(core, world)),
            Action::Right => self.table.move_column(1, &Self::visible_columns(core, world)),
            Action::Sort => {
                self.selected = self.selected_row(core, world).map(row_key);
                self.table.cycle_sort(&Self::visible_columns(core, world));
            }
            Action::Highlight => {
                let row = self.selected_row(core, world).map(row_key);
                self.marked = if self.marked == row { None } else { row };
            }
            Action::Clear => self.marked = None,
            Action::Plot => return self.selected_row(core, world).map_or_else(Vec::new, Self::plot_row),
            Action::Open => {
                let Some(row) = self.selected_row(core, world) else { return Vec::new() };
                let Some(bus) = world.buses().get(usize::from(row.bus.0)) else { return Vec::new() };
                let node = row.node.map(|node| PaneRequest::Node((row.bus, node)));
                let stated = format!("events of {}; v also shows repetitions", row.id);
                let rest = [
                    PaneRequest::Filter(row_filter(core, bus, row)),
                    PaneRequest::Say(stated),
                    PaneRequest::ShowEvents,
                ];
                return node.into_iter().chain(rest).collect();
            }
            _ => {}
        }
        Vec::new()
    }

    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        let Some(world) = core.bus_state() else { return Vec::new() };
        let inside = Rect { height: area.height.saturating_sub(1), ..area };
        let rows = sort_rows(core, world, self.table.sort);
        let columns = Self::frame_columns(core, world, area);
        let table = TableWidget::new(&core.theme, &columns).row_count(rows.len());
        if let Some(column) = table.column_at(inside, x) {
            self.table.column = column;
        }
        let state = TableState { selected: self.selected_index(&rows), ..self.table.clone() };
        if TableWidget::is_title_at(inside, y) {
            self.table.cycle_sort(&table.visible_columns(inside));
        } else if let Some(row) = table.row_at(inside, y, &state).and_then(|row| rows.get(row)) {
            self.selected = Some(row_key(row));
        }
        Vec::new()
    }

    fn table_sorting(&self) -> Sorting {
        self.table.sort
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.table.sort = sorting;
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::FRAMES
    }

    fn table_heads(&self) -> Vec<TableColumn> {
        frame_columns(4, true, 0)
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Sort, Action::Highlight, Action::Plot]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
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

    fn filter_of_cell(&self, core: &UiState) -> Option<String> {
        let world = core.bus_state()?;
        let row = self.selected_row(core, world)?;
        let bus = world.buses().get(usize::from(row.bus.0))?;
        let group = j1939_group(world, row);
        Some(match (self.table.column_in(&Self::visible_columns(core, world)), group) {
            (0, _) => format!("bus == {:?}", bus.name()),
            (PGN, Some(group)) => format!("pgn == {}", group.pgn.number()),
            (SOURCE, Some(group)) => format!("source_address == 0x{:02X}", group.source),
            _ => row_filter(core, bus, row),
        })
    }

    fn selected_line(&self, core: &UiState) -> Option<String> {
        let world = core.bus_state()?;
        let row = self.selected_row(core, world)?;
        let data: Vec<String> = row.payload().iter().map(|byte| format!("{byte:02X}")).collect();
        Some(format!(
            "{} {} {}, last {}",
            row.id,
            describe_row(world, row),
            count_noun(row.count, "frame"),
            data.join(" ")
        ))
    }
}

/// A filter for the events of a row.
fn row_filter(core: &UiState, bus: &Bus, row: &IdentifierRow) -> String {
    let filter = bus.filter_of_id(row.id);
    if has_buses(core) { format!("bus == {:?} && {filter}", bus.name()) } else { filter }
}
