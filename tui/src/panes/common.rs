//! Texts and drawing shared by several panes.
//!
//! ```text
//!   7.204   -0.502   node == 5   can0
//! ```

use std::sync::Arc;

use cobscope_decoder::finding::Severity;
use cobscope_decoder::frame::{BusIndex, Timestamp};
use cobscope_decoder::replay::ReplayState;
use cobscope_decoder::sink::escape;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use crate::action::Action;
use crate::state::UiState;
use crate::theme::{Glyph, TextRole, Theme};
use crate::widgets::draw;
use crate::widgets::table::{ColumnWidth, TableColumn, TableState};
use crate::widgets::text_lines::TextLines;
use cobscope_decoder::figures::format_seconds;

/// Minimum width of a text whose column the user chose together with others.
const LEAST_CHOSEN: u16 = 20;

/// The columns that the user chose for the pane with this name; all without a choice. `heads` are all columns in
/// the same order.
pub(super) fn chosen_columns(
    core: &UiState,
    pane: &str,
    heads: impl IntoIterator<Item = TableColumn>,
    mut columns: Vec<TableColumn>,
) -> Vec<TableColumn> {
    let Some(titles) = core.columns.get(pane) else { return columns };
    for (column, head) in columns.iter_mut().zip(heads) {
        let is_chosen = head.title.is_empty() || titles.iter().any(|title| *title == head.title);
        column.width = match column.width {
            _ if !is_chosen => ColumnWidth::Fixed(0),
            ColumnWidth::Min(least) => ColumnWidth::Min(least.min(LEAST_CHOSEN)),
            width => width,
        };
    }
    columns
}

/// A time in the chosen display: seconds from the first frame, or wall-clock time.
pub(super) fn display_time(core: &UiState, time: Option<Timestamp>) -> String {
    core.time_text(time, 3).unwrap_or_default()
}

/// Width of the latest time, at least that of the column head.
pub(super) fn time_width(core: &UiState) -> u16 {
    let latest = core.timeline.progress().time_range().map(|(_, last)| last);
    draw::text_width(&display_time(core, latest)).max(draw::text_width(time_title(core)))
}

/// Head of a column of times.
pub(super) fn time_title(core: &UiState) -> &'static str {
    core.clock.column_title()
}

/// Seconds relative to the cursor: `-0.502` is before it, `+1.200` after it.
pub(super) fn relative_time(core: &UiState, time: Option<Timestamp>) -> String {
    let Some((time, cursor)) = time.zip(core.cursor_time().or(core.first_time())) else {
        return String::new();
    };
    let ahead = time.since(cursor);
    let sign = if ahead > 0 { "+" } else { "" };
    format!("{sign}{}", format_seconds(ahead))
}

/// The state at the end of the capture if it is read, else at the cursor: it has the most buses.
pub(crate) fn last_world(core: &UiState) -> Option<Arc<ReplayState>> {
    core.timeline.end_state().or_else(|| core.window.as_ref().map(|window| Arc::clone(&window.world)))
}

/// Escaped name of a bus.
pub(super) fn bus_name(core: &UiState, bus: BusIndex) -> String {
    let world = last_world(core);
    let bus = world.as_ref().and_then(|world| world.buses().get(usize::from(bus.0)));
    bus.map_or(String::new(), |bus| escape(bus.name()).into_owned())
}

/// Whether the captures or live interfaces have several buses, including those without frames so far.
pub(super) fn has_buses(core: &UiState) -> bool {
    last_world(core).is_some_and(|world| world.buses().len() > 1)
        || core.timeline.progress().buses() > 1
        || core.timeline.live().is_some_and(|live| live.get().buses.len() > 1)
}

/// Limits of the width of a bus column.
const BUS_WIDTH: std::ops::RangeInclusive<u16> = 3..=8;

/// Width of a pane below which a bus is shown by the end of its name.
const NARROW: u16 = 48;

/// Width of the bus column: 0 with one bus. In a narrow pane it has room for the part in which the names
/// differ.
pub(super) fn bus_width(core: &UiState, width: u16) -> u16 {
    if !has_buses(core) {
        return 0;
    }
    let world = last_world(core);
    let names = world.iter().flat_map(|world| world.buses()).map(|bus| escape(bus.name()).into_owned());
    if width < NARROW {
        let common = common_start(core);
        let ends = names.filter_map(|name| name.get(common..).map(draw::text_width));
        return ends.max().unwrap_or(1).clamp(1, *BUS_WIDTH.start());
    }
    names.map(|name| draw::text_width(&name)).max().unwrap_or(0).clamp(*BUS_WIDTH.start(), *BUS_WIDTH.end())
}

/// Head of a bus column of this width.
pub(super) const fn bus_title(width: u16) -> &'static str {
    if width < *BUS_WIDTH.start() { "B" } else { "Bus" }
}

/// Escaped name of a bus for a column of this width: its end if the whole has no room.
pub(super) fn bus_short(core: &UiState, name: &str, width: u16) -> String {
    let is_long = draw::text_width(name) > width;
    let end = if is_long && width > 0 { name.get(common_start(core)..) } else { None };
    end.filter(|end| draw::text_width(end) <= width).unwrap_or(name).to_owned()
}

/// Number of bytes with which the names of all buses start; each name is longer.
fn common_start(core: &UiState) -> usize {
    let world = last_world(core);
    let names: Vec<String> =
        world.iter().flat_map(|world| world.buses()).map(|bus| escape(bus.name()).into_owned()).collect();
    let Some((first, others)) = names.split_first() else { return 0 };
    let is_shared = |end: &usize| {
        let start = first.get(..*end);
        others.iter().all(|other| other.len() > *end && start.is_some_and(|start| other.starts_with(start)))
    };
    (1..first.len()).filter(|end| first.is_char_boundary(*end)).take_while(is_shared).last().unwrap_or(0)
}

/// Role that draws a severity.
pub(super) const fn severity_role(severity: Severity) -> TextRole {
    match severity {
        Severity::Error => TextRole::Bad,
        Severity::Warning => TextRole::Caution,
        Severity::Note => TextRole::Note,
    }
}

/// Lines with a label each. Wrapped text continues below the text, not below its label.
pub(super) struct LabelledLines {
    /// Width of the widest label with its blanks.
    pub(super) room: u16,
    /// Label and text; a line without a label starts at the left edge.
    pub(super) lines: Vec<(&'static str, Line<'static>)>,
}

impl LabelledLines {
    /// The lines indented by the width of the labels.
    fn indent_lines(&self) -> Vec<Line<'static>> {
        let blank = " ".repeat(usize::from(self.room));
        let indent = |(label, line): &(&str, Line<'static>)| {
            let mut line = line.clone();
            if !label.is_empty() {
                line.spans.insert(0, Span::raw(blank.clone()));
            }
            line
        };
        self.lines.iter().map(indent).collect()
    }

    /// Scroll position that shows the end.
    pub(super) fn last_scroll(&self, theme: &Theme, area: Rect) -> usize {
        TextLines::new(theme, &self.indent_lines()).last_scroll(area)
    }

    /// Draws the visible lines; consecutive equal labels are drawn once.
    pub(super) fn render(&self, theme: &Theme, scroll: usize, area: Rect, buf: &mut Buffer) {
        let lines = self.indent_lines();
        let text = TextLines::new(theme, &lines).with_scroll(scroll);
        let last = text.last_scroll(area);
        let scroll = scroll.min(last);
        text.render(area, buf);
        let width = if last > 0 { area.width.saturating_sub(1) } else { area.width };
        let (mut row, mut last) = (0_usize, "");
        for ((label, _), line) in self.lines.iter().zip(&lines) {
            let y = row.checked_sub(scroll).map(|row| area.y.saturating_add(draw::to_cells(row)));
            if y.is_some_and(|y| y >= area.bottom()) {
                break;
            }
            if let Some(y) = y.filter(|_| last != *label) {
                let room = self.room.min(area.width);
                draw::put_text(buf, area.x, y, room, label, theme.role_style(TextRole::Quiet));
            }
            last = label;
            row += TextLines::new(theme, std::slice::from_ref(line)).line_count(width);
        }
    }
}

/// Moves the selection in a table of `len` rows, `height` of them visible.
pub(super) fn move_in(table: &mut TableState, action: Action, height: usize, len: usize) {
    match action {
        Action::Down => table.move_by(1, len),
        Action::Up => table.move_by(-1, len),
        Action::PageDown => table.page_selection(1, height, len),
        Action::PageUp => table.page_selection(-1, height, len),
        Action::Top => table.select_first(),
        Action::Bottom => table.select_last(len),
        _ => {}
    }
    table.settle_offset(height, len);
}

/// A horizontal line with a title in it.
pub(super) fn draw_divider(theme: &Theme, area: Rect, title: &str, buf: &mut Buffer) {
    let (line, style) = (theme.glyph(Glyph::Horizontal), theme.role_style(TextRole::Border));
    let all = line.repeat(usize::from(area.width));
    draw::put_text(buf, area.x, area.y, area.width, &all, style);
    if !title.is_empty() {
        let title = format!(" {title} ");
        let room = area.width.saturating_sub(2);
        draw::put_text(
            buf,
            area.x.saturating_add(2),
            area.y,
            room,
            &title,
            theme.role_style(TextRole::Title),
        );
    }
}

/// Selects another one of the visible columns in `shown`, or sorts by the present one.
pub fn act_on_column(table: &mut TableState, action: Action, shown: &[usize]) {
    match action {
        Action::Left => table.move_column(-1, shown),
        Action::Right => table.move_column(1, shown),
        Action::Sort => table.cycle_sort(shown),
        _ => {}
    }
}
