//! Events around the cursor, one line each; the selected line is the cursor.
//!
//! ```text
//!     No     Time       Δt  Bus   ID  Node        Kind   Object   Event             Data
//!    604    4.010    0.012  can0  220 32/20 boom  SETPT           0.0 → +37.5 %     0F 00 …
//! E 1842  371.204  367.194  can0  0A0 32/20 boom  EMCY   8305     spool position …  05 83 21 …
//! ```

mod cells;
mod columns;

use cobscope_decoder::event::KindSet;
use cobscope_decoder::query::{kind_filter, subject_filter};
use cobscope_decoder::replay::node_filter;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use self::cells::CellWidths;
use self::columns::event_columns;
use super::common::display_time;
use super::detail::DetailPane;
use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest};
use crate::action::Action;
use crate::state::{JumpPlace, UiState};
use crate::theme::{Glyph, TextRole};
use crate::timeline::ReplayRow as EventRow;
use crate::widgets::draw;
use crate::widgets::table::{TableColumn, TableRow, TableState, TableWidget};

/// The event table.
#[derive(Debug, Default)]
pub struct EventsPane {
    /// The column chosen by the user.
    column: Option<usize>,
    highlight: Option<String>,
    /// The details of the selected event are shown below.
    is_open: bool,
    detail: DetailPane,
}

/// Height from which the details fit below the table.
const LEAST_SPLIT: u16 = 12;

impl EventsPane {
    /// Areas of the table and of the details below it.
    fn split_area(&self, area: Rect) -> (Rect, Option<Rect>) {
        if !self.is_open || area.height < LEAST_SPLIT {
            return (area, None);
        }
        let above = area.height * 2 / 5;
        let below = Rect { y: area.y + above, height: area.height - above, ..area };
        (Rect { height: above, ..area }, Some(below))
    }

    /// Visible rows around the cursor, and the selected one.
    fn visible_rows(core: &UiState, height: usize) -> (std::ops::Range<usize>, usize) {
        let state = TableState { selected: core.selected_index(), ..TableState::default() };
        // The selection stays in the middle of the known rows, so that both sides are visible.
        let half = height / 2;
        let first = state.selected.saturating_sub(half).min(core.shown_rows().len().saturating_sub(height));
        (first..(first + height).min(core.shown_rows().len()), state.selected)
    }

    /// Indices of the visible columns that can be chosen: all but the severity.
    fn visible_columns(core: &UiState) -> Vec<usize> {
        let width = core.width.saturating_sub(1);
        let columns = event_columns(core, width);
        // The scroll bar has a column of its own.
        let shown =
            TableWidget::new(&core.theme, &columns).visible_columns(Rect::new(0, 0, width, core.height));
        shown.into_iter().filter(|column| *column != columns::SEVERITY).collect()
    }

    /// The chosen column; if it is no longer visible, the next one.
    fn chosen_column(&self, core: &UiState) -> Option<usize> {
        let column = self.column?;
        Some(TableState { column, ..TableState::default() }.column_in(&Self::visible_columns(core)))
    }

    /// The next visible column on one side, or the current one; the first one without a choice.
    fn column_beside(&self, core: &UiState, is_right: bool) -> usize {
        let shown = Self::visible_columns(core);
        let mut state = TableState { column: self.column.unwrap_or_default(), ..TableState::default() };
        match self.column {
            None => state.column = state.column_in(&shown),
            Some(_) => state.move_column(if is_right { 1 } else { -1 }, &shown),
        }
        state.column
    }

    fn step_cursor(core: &UiState, delta: isize) -> Vec<PaneRequest> {
        let rows = core.shown_rows();
        let at = core.selected_index().saturating_add_signed(delta).min(rows.len().saturating_sub(1));
        match rows.get(at) {
            Some(row) if at != core.selected_index() || core.cursor < row.spot => {
                vec![PaneRequest::Go(JumpPlace::Event(row.spot))]
            }
            // After the last row there may be events that are not read yet.
            _ => Vec::new(),
        }
    }
}

impl Pane for EventsPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        let (area, below) = self.split_area(area);
        if let Some(below) = below {
            let line = core.theme.glyph(Glyph::Horizontal).repeat(usize::from(below.width));
            draw::put_text(
                buf,
                below.x,
                below.y,
                below.width,
                &line,
                core.theme.role_style(TextRole::Border),
            );
            let below = Rect { y: below.y + 1, height: below.height - 1, ..below };
            self.detail.render_pane(core, below, buf);
        }
        let inside = Rect { width: area.width.saturating_sub(1), ..area };
        let height = TableWidget::visible_height(inside);
        let (range, selected) = Self::visible_rows(core, height);
        let state = TableState {
            selected: selected - range.start.min(selected),
            column: self.column.unwrap_or(usize::MAX),
            ..TableState::default()
        };
        let shown = core.shown_rows().get(range.clone()).unwrap_or_default();
        let columns = event_columns(core, inside.width);
        let width = |column| TableWidget::width_of(&columns, column, inside.width);
        let widths = CellWidths {
            event: width(columns::EVENT),
            object: width(columns::OBJECT),
            bus: width(columns::BUS),
            node: width(columns::NODE),
        };
        let before = range.start.checked_sub(1).and_then(|index| core.shown_rows().get(index));
        let row = |index: usize| -> TableRow<'_> {
            let previous = index.checked_sub(1).map_or(before, |index| shown.get(index));
            let marked = self.highlight.as_deref();
            shown
                .get(index)
                .map_or_else(TableRow::default, |row| cells::event_row(core, row, previous, widths, marked))
        };
        let empty = empty_text(core);
        let table = TableWidget::new(&core.theme, &columns)
            .row_count(shown.len())
            .with_rows(row)
            .with_state(&state)
            .with_empty_text(empty);
        table.render(inside, buf);
        if area.height > 1 {
            draw_scrollbar(core, area, shown, buf);
        }
    }

    fn refresh_state(&mut self, core: &UiState) {
        self.detail.refresh_state(core);
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        let shown = self.split_area(Rect::new(0, 0, 80, core.height)).0.height;
        let page = isize::try_from(shown.saturating_sub(2)).unwrap_or(1);
        match action {
            Action::Toggle => {
                self.is_open = !self.is_open;
                Vec::new()
            }
            Action::Sort => vec![PaneRequest::Refuse("events are always in time order".into())],
            Action::Down => Self::step_cursor(core, 1),
            Action::Up => Self::step_cursor(core, -1),
            Action::PageDown => Self::step_cursor(core, page),
            Action::PageUp => Self::step_cursor(core, -page),
            Action::Top => vec![PaneRequest::Go(JumpPlace::Start)],
            Action::Bottom => vec![PaneRequest::Go(JumpPlace::End)],
            Action::Left | Action::Right => {
                self.column = Some(self.column_beside(core, action == Action::Right));
                Vec::new()
            }
            Action::Highlight => {
                let column = self.chosen_column(core).unwrap_or(columns::NODE);
                let wanted =
                    core.cursor_row().map(|row| cells::cell_text(core, row, None, column).into_owned());
                self.highlight = if self.highlight == wanted { None } else { wanted };
                Vec::new()
            }
            Action::Clear => {
                self.highlight = None;
                Vec::new()
            }
            Action::Plot => super::signals::plot_requests(core),
            // The Detail pane shows an event that is still being read as soon as it arrives.
            Action::Open => core.cursor_row().map_or_else(
                || vec![PaneRequest::ShowDetail],
                |row| {
                    let node = row.event.node.map(|node| PaneRequest::Node((row.event.bus, node)));
                    let go =
                        Some(PaneRequest::Go(JumpPlace::Event(row.spot))).filter(|_| core.cursor < row.spot);
                    node.into_iter().chain(go).chain([PaneRequest::ShowDetail]).collect()
                },
            ),
            _ => Vec::new(),
        }
    }

    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        let (area, _) = self.split_area(area);
        if y >= area.bottom() {
            return Vec::new();
        }
        let inside = Rect { width: area.width.saturating_sub(1), ..area };
        if x >= inside.right() {
            return to_share(core, y, area);
        }
        let (range, _) = Self::visible_rows(core, TableWidget::visible_height(inside));
        let columns = event_columns(core, inside.width);
        let table = TableWidget::new(&core.theme, &columns).row_count(range.len());
        if let Some(column) = table.column_at(inside, x) {
            self.column = Some(column);
        }
        let row = table.row_at(inside, y, &TableState::default());
        let row = row.and_then(|row| core.shown_rows().get(range.start + row));
        row.map_or_else(Vec::new, |row| vec![PaneRequest::Go(JumpPlace::Event(row.spot))])
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::EVENTS
    }

    fn table_heads(&self) -> Vec<TableColumn> {
        columns::all_columns()
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Toggle, Action::Highlight, Action::Plot]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
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

    fn filter_of_cell(&self, core: &UiState) -> Option<String> {
        let row = core.cursor_row()?;
        let event = &row.event;
        let bus = core.bus_state().and_then(|world| world.buses().get(usize::from(event.bus.0)));
        let of_cell = match self.chosen_column(core).unwrap_or(columns::EVENT) {
            columns::NUMBER if event.frames.last > 0 => Some(format!("frames == {}", event.frames.last)),
            columns::BUS => Some(format!("bus == {:?}", row.bus)),
            columns::ID => bus.zip(row.id()).map(|(bus, id)| bus.filter_of_id(id)),
            columns::NODE => event.node.map(node_filter),
            columns::KIND => Some(kind_filter(event)),
            columns::OBJECT if !row.object.is_empty() => bus.and_then(|bus| subject_filter(event, bus)),
            _ => None,
        };
        // Times, values and data have no field that other events share.
        Some(of_cell.unwrap_or_else(|| row.filter_expression()))
    }

    fn selected_line(&self, core: &UiState) -> Option<String> {
        let row = core.cursor_row()?;
        Some(format!("{} {}", display_time(core, row.event.time), row.row_text()))
    }
}

/// Message of an empty table.
fn empty_text(core: &UiState) -> &'static str {
    let filter = core.matcher.filter.as_ref();
    let is_of_findings =
        filter.is_some_and(|filter| filter.kinds().and(KindSet::FINDINGS.complement()) == KindSet::NONE);
    match (&core.window, core.matcher.takes_all()) {
        (None, _) => "reading …",
        (_, true) => "no events",
        _ if is_of_findings => "this filter selects findings; 8 shows them, c clears the filter",
        _ => "no events match; c clears the filter, v shows all events",
    }
}

/// Scroll bar of the visible rows within the whole capture, by frames.
fn draw_scrollbar(core: &UiState, area: Rect, shown: &[EventRow], buf: &mut Buffer) {
    let frames = core.timeline.progress().frames().max(1);
    let first = shown.first().map_or(0, |row| row.spot.frame);
    let height = u64::from(area.height.saturating_sub(1)).max(1);
    // One row per line of the bar and per frame; large captures are scaled down.
    let scale = (frames / (1 << 20)).max(1);
    let count = usize::try_from((frames / scale).max(height)).unwrap_or(usize::MAX);
    let start = usize::try_from(first / scale).unwrap_or(0);
    let bar = Rect { y: area.y + 1, height: area.height - 1, ..area };
    draw::draw_scrollbar(buf, bar, start, count, &core.theme);
}

/// Moves the cursor to the clicked share of the capture.
fn to_share(core: &UiState, y: u16, area: Rect) -> Vec<PaneRequest> {
    let share = u64::from(y.saturating_sub(area.y + 1));
    let frames = core.timeline.progress().frames();
    let frame = frames.saturating_mul(share) / u64::from(area.height.saturating_sub(2)).max(1);
    vec![PaneRequest::Go(JumpPlace::Frame(frame.min(frames)))]
}
