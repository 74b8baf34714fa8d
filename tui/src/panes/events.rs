//! Events around the cursor, one line each; the selected line is the cursor.
//!
//! ```text
//!     No     Time       Δt  Bus   ID  Node        Kind   Object   Event             Data
//!    604    4.010    0.012  can0  220 32/20 boom  SETPT           0.0 → +37.5 %     0F 00 …
//! ! 1842  371.204  367.194  can0  0A0 32/20 boom  EMCY   8305     spool position …  05 83 21 …
//! ```

use std::borrow::Cow;

use cobscope_decoder::sink::text::Tone;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;

use super::detail::Detail;
use super::legend::{self, Legend};
use super::{Effect, Pane};
use crate::action::Action;
use crate::state::{Core, JumpPlace};
use crate::theme::{Glyph, Role, role_of};
use crate::timeline::Row as EventRow;
use crate::widgets::draw;
use crate::widgets::table::{Cell, Column, Row, Table, TableState, Width};

/// The event table.
#[derive(Debug, Default)]
pub struct Events {
    column: usize,
    highlight: Option<String>,
    /// The details of the selected event are shown below.
    is_open: bool,
    detail: Detail,
}

/// Width of the event text: at least `LEAST_TEXT`; `WANTED_TEXT` before less important columns are added.
const LEAST_TEXT: u16 = 44;
const WANTED_TEXT: u16 = 72;

/// Width of `Δt`, `ID`, `Node` and `Kind` with the spaces around them.
const IMPORTANT: u16 = 42;

const COLUMNS: usize = 10;

/// Columns for a table of `width`; their order is that of [`cell`].
fn columns(core: &Core, width: u16) -> Vec<Column> {
    // The bus column is useful only with several buses.
    let has_buses = core.world().is_some_and(|world| world.buses().len() > 1);
    arranged(has_buses, widest(core), width)
}

/// Columns with these widths of frame number and time.
fn arranged(has_buses: bool, (number, time): (u16, u16), width: u16) -> Vec<Column> {
    let others = number + 1 + time + IMPORTANT;
    let (bus, important, others) = if has_buses { (7, 8, others + 8) } else { (5, 1, others) };
    let what = width.saturating_sub(others).clamp(LEAST_TEXT, WANTED_TEXT);
    vec![
        Column::new("No", Width::Fixed(number)).right().priority(9),
        Column::new("Time", Width::Fixed(time)).right(),
        Column::new("Δt", Width::Fixed(9)).right().priority(3),
        Column::new("Bus", Width::Fixed(bus)).priority(important),
        Column::new("ID", Width::Fixed(8)).priority(4),
        Column::new("Node", Width::Fixed(14)).priority(10),
        Column::new("Kind", Width::Fixed(6)).priority(11),
        Column::new("Object", Width::Fixed(24)).priority(0),
        Column::new("Event", Width::Min(what)),
        Column::new("Data", Width::Fixed(23)).priority(2),
    ]
}

/// Widths of the largest frame number with a mark, and of the latest time.
fn widest(core: &Core) -> (u16, u16) {
    let progress = core.timeline.progress();
    let number = progress.frames().checked_ilog10().map_or(0, |digits| digits + 2);
    let time = progress.times().map_or(0, |(first, last)| seconds(last.since(first)).len());
    (u16::try_from(number).unwrap_or(u16::MAX).max(7), u16::try_from(time).unwrap_or(u16::MAX).max(9))
}

/// Height from which the details fit below the table.
const LEAST_SPLIT: u16 = 12;

/// Index of `Object`; without room for it the object precedes the event text.
const OBJECT: usize = 7;

impl Events {
    /// Areas of the table and of the details below it.
    fn split(&self, area: Rect) -> (Rect, Option<Rect>) {
        if !self.is_open || area.height < LEAST_SPLIT {
            return (area, None);
        }
        let above = area.height * 2 / 5;
        let below = Rect { y: area.y + above, height: area.height - above, ..area };
        (Rect { height: above, ..area }, Some(below))
    }

    /// Visible rows around the cursor, and the selected one.
    fn view(core: &Core, height: usize) -> (std::ops::Range<usize>, usize) {
        let state = TableState { selected: core.selected(), ..TableState::default() };
        // The selection stays in the middle of the known rows, so that both sides are visible.
        let half = height / 2;
        let first = state.selected.saturating_sub(half).min(core.rows().len().saturating_sub(height));
        (first..(first + height).min(core.rows().len()), state.selected)
    }

    /// The next visible column on one side, or the current one.
    fn beside(&self, core: &Core, is_right: bool) -> usize {
        let width = core.width.saturating_sub(1);
        let columns = columns(core, width);
        let has_room = |column: &usize| Table::width_of(&columns, *column, width) > 0;
        let found = if is_right {
            (self.column + 1..COLUMNS).find(has_room)
        } else {
            (0..self.column).rev().find(has_room)
        };
        found.unwrap_or(self.column)
    }

    fn step(core: &Core, delta: isize) -> Vec<Effect> {
        let rows = core.rows();
        let at = core.selected().saturating_add_signed(delta).min(rows.len().saturating_sub(1));
        match rows.get(at) {
            Some(row) if at != core.selected() || core.cursor < row.spot => {
                vec![Effect::Go(JumpPlace::Event(row.spot))]
            }
            // After the last row there may be events that are not read yet.
            _ => Vec::new(),
        }
    }
}

impl Pane for Events {
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer) {
        let (area, below) = self.split(area);
        if let Some(below) = below {
            let line = core.theme.glyph(Glyph::Horizontal).repeat(usize::from(below.width));
            draw::put(buf, below.x, below.y, below.width, &line, core.theme.style(Role::Border));
            let below = Rect { y: below.y + 1, height: below.height - 1, ..below };
            self.detail.render(core, below, buf);
        }
        let inside = Rect { width: area.width.saturating_sub(1), ..area };
        let height = Table::height(inside);
        let (range, selected) = Self::view(core, height);
        let state = TableState {
            selected: selected - range.start.min(selected),
            column: self.column,
            ..TableState::default()
        };
        let shown = core.rows().get(range.clone()).unwrap_or_default();
        let columns = columns(core, inside.width);
        let has_objects = Table::width_of(&columns, OBJECT, inside.width) > 0;
        let before = range.start.checked_sub(1).and_then(|index| core.rows().get(index));
        let row = |index: usize| -> Row<'_> {
            let previous = index.checked_sub(1).map_or(before, |index| shown.get(index));
            shown.get(index).map_or_else(Row::default, |row| self.row(core, row, previous, has_objects))
        };
        let empty = empty(core);
        let table =
            Table::new(&core.theme, &columns).row_count(shown.len()).rows(row).state(&state).empty(empty);
        table.render(inside, buf);
        if area.height > 1 {
            scrollbar(core, area, shown, buf);
        }
    }

    fn refresh(&mut self, core: &Core) {
        self.detail.refresh(core);
    }

    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        let shown = self.split(Rect::new(0, 0, 80, core.height)).0.height;
        let page = isize::try_from(shown.saturating_sub(2)).unwrap_or(1);
        match action {
            Action::Toggle => {
                self.is_open = !self.is_open;
                Vec::new()
            }
            Action::Sort => vec![Effect::Refuse("events are always in time order".into())],
            Action::Down => Self::step(core, 1),
            Action::Up => Self::step(core, -1),
            Action::PageDown => Self::step(core, page),
            Action::PageUp => Self::step(core, -page),
            Action::Top => vec![Effect::Go(JumpPlace::Start)],
            Action::Bottom => vec![Effect::Go(JumpPlace::End)],
            Action::Left | Action::Right => {
                self.column = self.beside(core, action == Action::Right);
                Vec::new()
            }
            Action::Highlight => {
                let wanted = core.row().map(|row| cell(core, row, None, self.column).into_owned());
                self.highlight = if self.highlight == wanted { None } else { wanted };
                Vec::new()
            }
            Action::Clear => {
                self.highlight = None;
                Vec::new()
            }
            Action::Plot => super::signals::plot(core),
            // The Detail pane shows an event that is still being read as soon as it arrives.
            Action::Open => core.row().map_or_else(
                || vec![Effect::ShowDetail],
                |row| {
                    let node = row.event.node.map(|node| Effect::Node((row.event.bus, node)));
                    let go = Some(Effect::Go(JumpPlace::Event(row.spot))).filter(|_| core.cursor < row.spot);
                    node.into_iter().chain(go).chain([Effect::ShowDetail]).collect()
                },
            ),
            _ => Vec::new(),
        }
    }

    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect> {
        let (area, _) = self.split(area);
        if y >= area.bottom() {
            return Vec::new();
        }
        let inside = Rect { width: area.width.saturating_sub(1), ..area };
        if x >= inside.right() {
            return to_share(core, y, area);
        }
        let (range, _) = Self::view(core, Table::height(inside));
        let columns = columns(core, inside.width);
        let table = Table::new(&core.theme, &columns).row_count(range.len());
        if let Some(column) = table.column_at(inside, x) {
            self.column = column;
        }
        let row = table.row_at(inside, y, &TableState::default());
        let row = row.and_then(|row| core.rows().get(range.start + row));
        row.map_or_else(Vec::new, |row| vec![Effect::Go(JumpPlace::Event(row.spot))])
    }

    fn legend(&self) -> &'static Legend {
        &legend::EVENTS
    }

    fn heads(&self) -> Vec<Column> {
        arranged(true, (0, 0), 0)
    }

    fn actions(&self) -> &'static [Action] {
        &[
            Action::Open,
            Action::Toggle,
            Action::Filter,
            Action::FilterCell,
            Action::News,
            Action::Plot,
            Action::Search,
            Action::NextFinding,
            Action::NextError,
            Action::GoTo,
        ]
    }

    fn filter_of_cell(&self, core: &Core) -> Option<String> {
        let event = &core.row()?.event;
        Some(match self.column {
            0 => format!("frames == {}", event.frames.last),
            3 => format!("bus == {:?}", core.row()?.bus),
            5 => match event.node? {
                cobscope_decoder::wire::NodeId::Canopen(id) => format!("node == {id}"),
                cobscope_decoder::wire::NodeId::J1939(address) => {
                    format!("source_address == 0x{address:02X}")
                }
            },
            _ => format!("kind == {:?}", event.kind.name()),
        })
    }

    fn line(&self, core: &Core) -> Option<String> {
        let row = core.row()?;
        Some(format!("{} {}", time_of(core, row), row.text()))
    }
}

impl Events {
    fn row(&self, core: &Core, row: &EventRow, before: Option<&EventRow>, has_objects: bool) -> Row<'static> {
        let tone = core.theme.style(role_of(row.tone));
        let cells = (0..COLUMNS).map(|column| {
            let text = cell(core, row, before, column);
            let is_marked =
                self.highlight.as_deref().is_some_and(|wanted| !wanted.is_empty() && wanted == text);
            let style = match column {
                _ if is_marked => core.theme.style(Role::Highlight(1)),
                6..=8 => tone,
                0 | 2 | 9 if row.tone != Tone::Bad => core.theme.style(Role::Quiet),
                _ => Style::new(),
            };
            let text = match column {
                8 if !has_objects => row.what(),
                _ => text.into_owned(),
            };
            Cell::new(text, style)
        });
        Row::new(cells)
    }
}

/// Message of an empty table.
fn empty(core: &Core) -> &'static str {
    let filter = core.matcher.filter.as_ref();
    let is_of_findings =
        filter.is_some_and(|filter| filter.kinds().names().all(|kind| kind.starts_with("finding-")));
    match (&core.window, core.matcher.takes_all()) {
        (None, _) => "reading …",
        (_, true) => "no events",
        _ if is_of_findings => "this filter selects findings; 8 shows them, c clears the filter",
        _ => "no events match; c clears the filter, v shows all events",
    }
}

/// Text of a cell.
fn cell<'a>(core: &Core, row: &'a EventRow, before: Option<&EventRow>, column: usize) -> Cow<'a, str> {
    match column {
        0 => {
            let number =
                if row.event.frames.last == 0 { String::new() } else { row.event.frames.last.to_string() };
            let survey = core.timeline.survey();
            let at = survey.places.partition_point(|place| place.frame < row.spot.frame);
            let is_found = survey.places.get(at).is_some_and(|place| place.frame == row.spot.frame);
            let mark = if is_found { core.theme.glyph(Glyph::Warning) } else { "" };
            format!("{mark}{number}").into()
        }
        1 => time_of(core, row).into(),
        2 => match (row.event.time, before.and_then(|before| before.event.time)) {
            (Some(time), Some(before)) => seconds(time.since(before)).into(),
            _ => "".into(),
        },
        3 => row.bus.as_str().into(),
        4 => row.id().map_or(Cow::Borrowed(""), |id| id.to_string().into()),
        5 => row.who.as_str().into(),
        6 => row.kind.into(),
        7 => row.object.as_str().into(),
        8 => row.value.as_str().into(),
        _ => row.data().into(),
    }
}

/// Seconds from the first frame, as `decode` prints them.
fn time_of(core: &Core, row: &EventRow) -> String {
    match (row.event.time, core.zero()) {
        (Some(time), Some(zero)) => seconds(time.since(zero)),
        _ => String::new(),
    }
}

/// Nanoseconds as seconds with three decimals, truncated.
fn seconds(nanoseconds: i64) -> String {
    let sign = if nanoseconds < 0 { "-" } else { "" };
    let milliseconds = nanoseconds.unsigned_abs() / 1_000_000;
    format!("{sign}{}.{:03}", milliseconds / 1_000, milliseconds % 1_000)
}

/// Scroll bar of the visible rows within the whole capture, by frames.
fn scrollbar(core: &Core, area: Rect, shown: &[EventRow], buf: &mut Buffer) {
    let frames = core.timeline.progress().frames().max(1);
    let first = shown.first().map_or(0, |row| row.spot.frame);
    let height = u64::from(area.height.saturating_sub(1)).max(1);
    // One row per line of the bar and per frame; large captures are scaled down.
    let scale = (frames / (1 << 20)).max(1);
    let count = usize::try_from((frames / scale).max(height)).unwrap_or(usize::MAX);
    let start = usize::try_from(first / scale).unwrap_or(0);
    let bar = Rect { y: area.y + 1, height: area.height - 1, ..area };
    draw::scrollbar(buf, bar, start, count, &core.theme);
}

/// Moves the cursor to the clicked share of the capture.
fn to_share(core: &Core, y: u16, area: Rect) -> Vec<Effect> {
    let share = u64::from(y.saturating_sub(area.y + 1));
    let frames = core.timeline.progress().frames();
    let frame = frames.saturating_mul(share) / u64::from(area.height.saturating_sub(2)).max(1);
    vec![Effect::Go(JumpPlace::Frame(frame.min(frames)))]
}
