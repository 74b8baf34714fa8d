//! Transfers: one line per SDO, J1939 or UDS transfer with duration and outcome. The last transfer before the
//! cursor is selected.
//!
//! ```text
//! 5 transfers, 1 aborted, 1 timed out
//! No     Time       ms Nodes      Kind   Content                     Size Outcome
//!  6    0.212    2.022 client→6   SDO w  1017:00 … = 200 ms ok          2 complete
//! 31    1.300  300.000 client→5   SDO r  1018:01 ABORTED 06020000       0 aborted
//! ```

use std::borrow::Cow;
use std::cmp::Ordering;

use cobscope_decoder::event::{Kind, OutcomeGroup};
use cobscope_decoder::replay::node_filter;
use cobscope_decoder::sink::text::LineTone;
use cobscope_decoder::statistics::{BusStatistics, DurationDistribution};
use cobscope_decoder::words::count_noun;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use super::common::{
    act_on_column, bus_name, bus_short, bus_title, bus_width, chosen_columns, display_time, draw_divider,
    move_in, time_title, time_width,
};
use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest, Sorting};
use crate::action::Action;
use crate::state::{JumpPlace, UiState};
use crate::theme::{TextRole, role_of};
use crate::timeline::{MOST_TRANSFERS, SurveyResults, TransferRow};
use crate::widgets::draw;
use crate::widgets::fit::fit_text;
use crate::widgets::table::{ColumnWidth, TableCell, TableColumn, TableRow, TableState, TableWidget};
use crate::widgets::text_lines::TextLines;
use cobscope_decoder::figures::format_millis;

/// The table of transfers.
#[derive(Debug, Default)]
pub struct TransfersPane {
    table: TableState,
    /// Indices of the transfers in row order, if the table is sorted.
    order: Vec<usize>,
    /// Number of transfers and sort order that `order` was made for.
    made: (usize, Option<(usize, bool)>),
    counts: OutcomeCounts,
}

/// Number of transfers per outcome.
#[derive(Debug, Clone, Copy, Default)]
struct OutcomeCounts {
    seen: usize,
    aborted: usize,
    timed_out: usize,
    other: usize,
    /// One of the others is an error.
    is_other_bad: bool,
}

impl OutcomeCounts {
    fn count_exchanges(&mut self, exchanges: &[TransferRow]) {
        for exchange in exchanges.get(self.seen..).unwrap_or_default() {
            match exchange.outcome.group() {
                OutcomeGroup::Complete => {}
                OutcomeGroup::Refused => self.aborted += 1,
                OutcomeGroup::TimedOut => self.timed_out += 1,
                OutcomeGroup::Other => {
                    self.other += 1;
                    self.is_other_bad |= exchange.tone == LineTone::Bad;
                }
            }
        }
        self.seen = exchanges.len();
    }
}

/// Width of the content: at least `LEAST_TEXT`; `WANTED_TEXT` before the column of a single bus is added.
const LEAST_TEXT: u16 = 28;
const WANTED_TEXT: u16 = 72;

/// Width of the other columns without time and bus, with spaces and scroll bar.
const IMPORTANT: u16 = 59;

/// Columns for a table of `width`.
fn transfer_columns(core: &UiState, width: u16) -> Vec<TableColumn> {
    let columns = arrange_columns(time_title(core), time_width(core), bus_width(core, width), width);
    chosen_columns(core, "transfers", arrange_columns("Time", 9, 4, 0), columns)
}

/// Columns with these widths of time and bus.
fn arrange_columns(title: &'static str, time: u16, bus: u16, width: u16) -> Vec<TableColumn> {
    let others = IMPORTANT.saturating_add(bus).saturating_add(time);
    let what = width.saturating_sub(others).clamp(LEAST_TEXT, WANTED_TEXT);
    vec![
        TableColumn::new("No", ColumnWidth::Fixed(7)).align_right().with_priority(5),
        TableColumn::new(title, ColumnWidth::Fixed(time)).align_right(),
        TableColumn::new("ms", ColumnWidth::Fixed(8)).align_right().with_priority(9),
        TableColumn::new(bus_title(bus), ColumnWidth::Fixed(bus)).with_priority(11),
        TableColumn::new("Nodes", ColumnWidth::Fixed(12)).with_priority(10),
        TableColumn::new("Kind", ColumnWidth::Fixed(6)).with_priority(7),
        TableColumn::new("Content", ColumnWidth::Min(what)),
        TableColumn::new("Size", ColumnWidth::Fixed(7)).align_right().with_priority(3),
        TableColumn::new("Outcome", ColumnWidth::Fixed(11)).with_priority(6),
    ]
}

/// Lines of the details, and height from which they are shown.
const DETAIL: u16 = 4;
const LOW: u16 = 14;

/// Screen areas of this pane.
struct TransferAreas {
    summary: Rect,
    table: Rect,
    detail: Rect,
}

const NUMBER: usize = 0;
const DURATION: usize = 2;
const BUS: usize = 3;
const NODES: usize = 4;
const CONTENT: usize = 6;
const OUTCOME: usize = 8;

/// Compares two transfers by a column.
fn compare_transfers(one: &TransferRow, other: &TransferRow, column: usize) -> Ordering {
    match column {
        0 | 1 => one.spot.cmp(&other.spot),
        DURATION => one.duration.cmp(&other.duration),
        BUS => one.bus.cmp(&other.bus),
        NODES => one.who.cmp(&other.who),
        5 => one.kind.cmp(other.kind),
        CONTENT => one.what.cmp(&other.what),
        7 => one.size.cmp(&other.size),
        _ => one.outcome.name().cmp(other.outcome.name()),
    }
}

impl TransfersPane {
    /// Indices in row order; None in time order.
    fn row_order(&self, survey: &SurveyResults) -> Option<Cow<'_, [usize]>> {
        let sort = self.table.sort?;
        let exchanges = &survey.overview.transfers;
        if self.made == (exchanges.len(), Some(sort)) {
            return Some(Cow::Borrowed(&self.order));
        }
        let mut order: Vec<usize> = (0..exchanges.len()).collect();
        order.sort_by(|one, other| match (exchanges.get(*one), exchanges.get(*other)) {
            (Some(one), Some(other)) if sort.1 => compare_transfers(other, one, sort.0),
            (Some(one), Some(other)) => compare_transfers(one, other, sort.0),
            _ => Ordering::Equal,
        });
        Some(Cow::Owned(order))
    }

    /// The transfer of a row.
    fn exchange_at<'a>(
        order: Option<&[usize]>,
        survey: &'a SurveyResults,
        row: usize,
    ) -> Option<&'a TransferRow> {
        let place = match order {
            Some(order) => *order.get(row)?,
            None => row,
        };
        survey.overview.transfers.get(place)
    }

    /// Row of the last transfer that ended before the cursor.
    fn selected_index(core: &UiState, survey: &SurveyResults, order: Option<&[usize]>) -> Option<usize> {
        let place = survey
            .overview
            .transfers
            .partition_point(|exchange| exchange.spot <= core.cursor)
            .checked_sub(1)?;
        match order {
            Some(order) => order.iter().position(|other| *other == place),
            None => Some(place),
        }
    }

    fn current_exchange<'a>(&self, core: &UiState, survey: &'a SurveyResults) -> Option<&'a TransferRow> {
        let order = self.row_order(survey);
        let row = Self::selected_index(core, survey, order.as_deref())?;
        Self::exchange_at(order.as_deref(), survey, row)
    }

    /// Lines above the table.
    fn summary_lines(&self, core: &UiState, survey: &SurveyResults) -> Vec<Line<'static>> {
        let theme = &core.theme;
        let mut counts = self.counts;
        counts.count_exchanges(&survey.overview.transfers);
        let counted = |count: usize, what: &str, role| {
            let role = if count > 0 { role } else { TextRole::Quiet };
            Span::styled(format!(", {count} {what}"), theme.role_style(role))
        };
        let so_far = if survey.is_complete { "" } else { " so far" };
        let mut spans = vec![
            Span::raw(format!("{}{so_far}", count_noun(counts.seen, "transfer"))),
            counted(counts.aborted, "refused or aborted", TextRole::Bad),
            counted(counts.timed_out, "without response", TextRole::Bad),
        ];
        if counts.other > 0 {
            let role = if counts.is_other_bad { TextRole::Bad } else { TextRole::Caution };
            spans.push(counted(counts.other, "incomplete", role));
        }
        if survey.overview.transfers.more > 0 {
            let text = format!("; {} more after the first {MOST_TRANSFERS}", survey.overview.transfers.more);
            spans.push(Span::styled(text, theme.role_style(TextRole::Caution)));
        }
        let mut lines = vec![Line::from(spans)];
        if matches!(self.table.sort, Some((DURATION, _))) {
            lines.extend(
                latency_text(survey).map(|text| Line::styled(text, theme.role_style(TextRole::Note))),
            );
        }
        lines
    }

    fn pane_areas(&self, core: &UiState, survey: &SurveyResults, area: Rect) -> TransferAreas {
        let above = draw::to_cells(self.summary_lines(core, survey).len()).min(area.height / 2);
        let below = if area.height < LOW { 0 } else { DETAIL };
        TransferAreas {
            summary: Rect { height: above, ..area },
            table: Rect { y: area.y + above, height: area.height - above - below, ..area },
            detail: Rect { y: area.bottom() - below, height: below, ..area },
        }
    }

    /// Indices of the visible columns.
    fn visible_columns(&self, core: &UiState, survey: &SurveyResults) -> Vec<usize> {
        let area = self.pane_areas(core, survey, Rect::new(0, 0, core.width, core.height)).table;
        let columns = transfer_columns(core, area.width);
        TableWidget::new(&core.theme, &columns)
            .row_count(survey.overview.transfers.len())
            .visible_columns(area)
    }

    /// The details of the selected transfer.
    fn draw_detail(core: &UiState, exchange: &TransferRow, area: Rect, buf: &mut Buffer) {
        let theme = &core.theme;
        let frames = match (exchange.frames.first, exchange.frames.last) {
            (_, 0) => String::new(),
            (first, last) if first == last => format!("frame {last}"),
            (first, last) => format!("frames {first}-{last}"),
        };
        draw_divider(
            theme,
            Rect { height: 1, ..area },
            &format!("{} {}", exchange.outcome.name(), frames),
            buf,
        );
        let lines = [Line::from(vec![
            Span::raw(format!("{}  {}  ", exchange.who, exchange.kind)),
            Span::styled(exchange.what.to_string(), theme.role_style(role_of(exchange.tone))),
        ])];
        let below = Rect { y: area.y + 1, height: area.height - 1, ..area };
        TextLines::new(theme, &lines).render(below, buf);
    }

    /// Moves the cursor to the end of another transfer.
    fn go_to_transfer(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        let survey = core.timeline.survey();
        let area = Rect::new(0, 0, 80, core.height);
        let height = TableWidget::visible_height(self.pane_areas(core, &survey, area).table);
        let len = survey.overview.transfers.len();
        let order = self.row_order(&survey).map(Cow::into_owned);
        let selected = Self::selected_index(core, &survey, order.as_deref());
        self.table.selected = selected.unwrap_or(0);
        match (action, selected) {
            (Action::Top | Action::Bottom, _) => move_in(&mut self.table, action, height, len),
            // Before the first transfer only the first one can be selected.
            (Action::Down | Action::PageDown, None) => {}
            (_, None) => return Vec::new(),
            _ => move_in(&mut self.table, action, height, len),
        }
        let exchange = Self::exchange_at(order.as_deref(), &survey, self.table.selected);
        exchange.map(|exchange| PaneRequest::Go(JumpPlace::Event(exchange.spot))).into_iter().collect()
    }
}

/// Median and maximum duration of the SDO transfers of each node, over the whole capture.
fn latency_text(survey: &SurveyResults) -> Option<String> {
    let nodes = survey.overview.statistics.buses.iter().flat_map(BusStatistics::nodes);
    let part =
        |of: &DurationDistribution, percent| of.percentile(percent).map_or(String::new(), format_millis);
    let reported: Vec<String> = nodes
        .filter(|(_, node)| node.sdo_duration.duration_count() > 0)
        .map(|(id, node)| {
            let times = &node.sdo_duration;
            format!("{} {} / {}", id.label(), part(times, 50), part(times, 100))
        })
        .collect();
    (!reported.is_empty()).then(|| format!("SDO duration in ms, median / max:  {}", reported.join("   ")))
}

impl Pane for TransfersPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        let survey = core.timeline.survey();
        let lines = self.summary_lines(core, &survey);
        let parts = self.pane_areas(core, &survey, area);
        for (y, line) in (parts.summary.top()..parts.summary.bottom()).zip(&lines) {
            draw::draw_line(buf, Rect { y, height: 1, ..area }, line, draw::TextAlignment::Left, &core.theme);
        }
        let order = self.row_order(&survey);
        let order = order.as_deref();
        let selected = Self::selected_index(core, &survey, order);
        // Without a selection the column heads still show the sort mark.
        let state = TableState { selected: selected.unwrap_or(0), ..self.table.clone() };
        let columns = transfer_columns(core, parts.table.width);
        let width = |column| TableWidget::width_of(&columns, column, parts.table.width.saturating_sub(1));
        let widths = (width(BUS), width(CONTENT));
        let row = |index: usize| -> TableRow<'_> {
            Self::exchange_at(order, &survey, index)
                .map_or_else(TableRow::default, |exchange| transfer_row(core, exchange, widths))
        };
        let empty =
            if survey.is_complete { "no SDO, J1939 transport or UDS transfers" } else { "no transfers yet" };
        let table =
            TableWidget::new(&core.theme, &columns).row_count(survey.overview.transfers.len()).with_rows(row);
        table
            .with_state(&state)
            .with_focus(selected.is_some())
            .with_empty_text(empty)
            .render(parts.table, buf);
        let exchange = selected.and_then(|row| Self::exchange_at(order, &survey, row));
        if let Some(exchange) = exchange.filter(|_| parts.detail.height > 1) {
            Self::draw_detail(core, exchange, parts.detail, buf);
        }
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        match action {
            Action::Down | Action::Up | Action::PageDown | Action::PageUp | Action::Top | Action::Bottom => {
                return self.go_to_transfer(action, core);
            }
            Action::Left | Action::Right | Action::Sort => {
                let shown = self.visible_columns(core, &core.timeline.survey());
                act_on_column(&mut self.table, action, &shown);
            }
            Action::Open => {
                let survey = core.timeline.survey();
                let current = self.current_exchange(core, &survey);
                let place = current.map(|exchange| (exchange.spot, exchange.bus, exchange.node));
                drop(survey);
                let Some((spot, bus, node)) = place else { return Vec::new() };
                let node = node.map(|node| PaneRequest::Node((bus, node)));
                let rest = [PaneRequest::Go(JumpPlace::Event(spot)), PaneRequest::ShowDetail];
                return node.into_iter().chain(rest).collect();
            }
            _ => {}
        }
        self.refresh_state(core);
        Vec::new()
    }

    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        let survey = core.timeline.survey();
        let below = self.pane_areas(core, &survey, area).table;
        let columns = transfer_columns(core, below.width);
        let table = TableWidget::new(&core.theme, &columns).row_count(survey.overview.transfers.len());
        if let Some(column) = table.column_at(below, x) {
            self.table.column = column;
        }
        if TableWidget::is_title_at(below, y) {
            self.table.cycle_sort(&table.visible_columns(below));
            return Vec::new();
        }
        let order = self.row_order(&survey);
        let selected = Self::selected_index(core, &survey, order.as_deref()).unwrap_or(0);
        let state = TableState { selected, ..self.table.clone() };
        let row = table.row_at(below, y, &state);
        let exchange = row.and_then(|row| Self::exchange_at(order.as_deref(), &survey, row));
        exchange.map(|exchange| PaneRequest::Go(JumpPlace::Event(exchange.spot))).into_iter().collect()
    }

    fn refresh_state(&mut self, core: &UiState) {
        let survey = core.timeline.survey();
        self.counts.count_exchanges(&survey.overview.transfers);
        let wanted = (survey.overview.transfers.len(), self.table.sort);
        if self.made != wanted {
            self.order = self.row_order(&survey).map(Cow::into_owned).unwrap_or_default();
            self.made = wanted;
        }
    }

    fn table_sorting(&self) -> Sorting {
        self.table.sort
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.table.sort = sorting;
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::TRANSFERS
    }

    fn table_heads(&self) -> Vec<TableColumn> {
        arrange_columns("Time", 9, 4, 0)
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Sort]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
        &[
            Action::Open,
            Action::Sort,
            Action::FilterCell,
            Action::NextError,
            Action::NextFinding,
            Action::GoTo,
        ]
    }

    fn filter_of_cell(&self, core: &UiState) -> Option<String> {
        let survey = core.timeline.survey();
        let exchange = self.current_exchange(core, &survey)?;
        let column = self.table.column_in(&self.visible_columns(core, &survey));
        Some(match (column, exchange.node, &exchange.subject) {
            (NUMBER, ..) if exchange.frames.last > 0 => format!("frames == {}", exchange.frames.last),
            (BUS, ..) => format!("bus == {:?}", bus_name(core, exchange.bus)),
            (NODES, Some(node), _) => node_filter(node),
            (CONTENT, _, Some(subject)) => subject.to_string(),
            (OUTCOME, ..) => {
                let (kind, outcome) = (exchange.event_kind.name(), exchange.outcome.name());
                format!("kind == {kind:?} && outcome == {outcome:?}")
            }
            _ => exchange.kind_filter.to_string(),
        })
    }

    fn selected_line(&self, core: &UiState) -> Option<String> {
        let survey = core.timeline.survey();
        let exchange = self.current_exchange(core, &survey)?;
        let (time, bus) = (display_time(core, exchange.time), bus_name(core, exchange.bus));
        Some(format!("{time} {bus} {} {} {}", exchange.who, exchange.kind, exchange.what))
    }
}

/// The row of a transfer with the widths of bus and content.
fn transfer_row(core: &UiState, exchange: &TransferRow, widths: (u16, u16)) -> TableRow<'static> {
    let theme = &core.theme;
    let (quiet, tone) = (theme.role_style(TextRole::Quiet), theme.role_style(role_of(exchange.tone)));
    let number = if exchange.frames.last == 0 { String::new() } else { exchange.frames.last.to_string() };
    TableRow::new([
        TableCell::new(number, quiet),
        TableCell::from(display_time(core, exchange.time)),
        TableCell::from(exchange.duration.map(format_millis).unwrap_or_default()),
        TableCell::new(bus_short(core, &bus_name(core, exchange.bus), widths.0), quiet),
        TableCell::from(exchange.who.to_string()),
        TableCell::new(exchange.kind, tone),
        TableCell::new(fit_text(&exchange.news, widths.1, theme), tone),
        TableCell::new(size_text(exchange), quiet),
        TableCell::new(exchange.outcome.name(), tone),
    ])
}

/// Bytes transferred; empty for UDS, whose content contains them.
fn size_text(exchange: &TransferRow) -> String {
    if exchange.event_kind == Kind::UdsExchange { String::new() } else { exchange.size.to_string() }
}
