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
use cobscope_decoder::sink::text::Tone;
use cobscope_decoder::statistics::{BusStatistics, Distribution};
use cobscope_decoder::words::plural;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::{Line, Span};

use super::common::{
    act_on_column, bus_name, bus_short, bus_title, bus_width, chosen, divider, move_in, time, time_title,
    time_width,
};
use super::legend::{self, Legend};
use super::{Effect, Pane, Sorting};
use crate::action::Action;
use crate::figures::millis;
use crate::state::{Core, JumpPlace};
use crate::theme::{Role, role_of};
use crate::timeline::{MOST_TRANSFERS, SurveyResults, TransferRow};
use crate::widgets::draw;
use crate::widgets::fit::fit;
use crate::widgets::table::{Cell, Column, Row, Table, TableState, Width};
use crate::widgets::text_lines::TextLines;

/// The table of transfers.
#[derive(Debug, Default)]
pub struct Transfers {
    table: TableState,
    /// Indices of the transfers in row order, if the table is sorted.
    order: Vec<usize>,
    /// Number of transfers and sort order that `order` was made for.
    made: (usize, Option<(usize, bool)>),
    counts: Counts,
}

/// Number of transfers per outcome.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    seen: usize,
    aborted: usize,
    timed_out: usize,
    other: usize,
    /// One of the others is an error.
    is_other_bad: bool,
}

impl Counts {
    fn add(&mut self, exchanges: &[TransferRow]) {
        for exchange in exchanges.get(self.seen..).unwrap_or_default() {
            match exchange.outcome.group() {
                OutcomeGroup::Complete => {}
                OutcomeGroup::Refused => self.aborted += 1,
                OutcomeGroup::TimedOut => self.timed_out += 1,
                OutcomeGroup::Other => {
                    self.other += 1;
                    self.is_other_bad |= exchange.tone == Tone::Bad;
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
fn columns(core: &Core, width: u16) -> Vec<Column> {
    let columns = arranged(time_title(core), time_width(core), bus_width(core, width), width);
    chosen(core, "transfers", arranged("Time", 9, 4, 0), columns)
}

/// Columns with these widths of time and bus.
fn arranged(title: &'static str, time: u16, bus: u16, width: u16) -> Vec<Column> {
    let others = IMPORTANT.saturating_add(bus).saturating_add(time);
    let what = width.saturating_sub(others).clamp(LEAST_TEXT, WANTED_TEXT);
    vec![
        Column::new("No", Width::Fixed(7)).right().priority(5),
        Column::new(title, Width::Fixed(time)).right(),
        Column::new("ms", Width::Fixed(8)).right().priority(9),
        Column::new(bus_title(bus), Width::Fixed(bus)).priority(11),
        Column::new("Nodes", Width::Fixed(12)).priority(10),
        Column::new("Kind", Width::Fixed(6)).priority(7),
        Column::new("Content", Width::Min(what)),
        Column::new("Size", Width::Fixed(7)).right().priority(3),
        Column::new("Outcome", Width::Fixed(11)).priority(6),
    ]
}

/// Lines of the details, and height from which they are shown.
const DETAIL: u16 = 4;
const LOW: u16 = 14;

/// Screen areas of this pane.
struct Parts {
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
fn compare(one: &TransferRow, other: &TransferRow, column: usize) -> Ordering {
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

impl Transfers {
    /// Indices in row order; None in time order.
    fn order(&self, survey: &SurveyResults) -> Option<Cow<'_, [usize]>> {
        let sort = self.table.sort?;
        let exchanges = &survey.overview.transfers;
        if self.made == (exchanges.len(), Some(sort)) {
            return Some(Cow::Borrowed(&self.order));
        }
        let mut order: Vec<usize> = (0..exchanges.len()).collect();
        order.sort_by(|one, other| match (exchanges.get(*one), exchanges.get(*other)) {
            (Some(one), Some(other)) if sort.1 => compare(other, one, sort.0),
            (Some(one), Some(other)) => compare(one, other, sort.0),
            _ => Ordering::Equal,
        });
        Some(Cow::Owned(order))
    }

    /// The transfer of a row.
    fn exchange<'a>(
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
    fn selected(core: &Core, survey: &SurveyResults, order: Option<&[usize]>) -> Option<usize> {
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

    fn current<'a>(&self, core: &Core, survey: &'a SurveyResults) -> Option<&'a TransferRow> {
        let order = self.order(survey);
        let row = Self::selected(core, survey, order.as_deref())?;
        Self::exchange(order.as_deref(), survey, row)
    }

    /// Lines above the table.
    fn summary(&self, core: &Core, survey: &SurveyResults) -> Vec<Line<'static>> {
        let theme = &core.theme;
        let mut counts = self.counts;
        counts.add(&survey.overview.transfers);
        let counted = |count: usize, what: &str, role| {
            let role = if count > 0 { role } else { Role::Quiet };
            Span::styled(format!(", {count} {what}"), theme.style(role))
        };
        let so_far = if survey.is_complete { "" } else { " so far" };
        let mut spans = vec![
            Span::raw(format!("{}{so_far}", plural(counts.seen, "transfer"))),
            counted(counts.aborted, "refused or aborted", Role::Bad),
            counted(counts.timed_out, "without response", Role::Bad),
        ];
        if counts.other > 0 {
            let role = if counts.is_other_bad { Role::Bad } else { Role::Caution };
            spans.push(counted(counts.other, "incomplete", role));
        }
        if survey.overview.transfers.more > 0 {
            let text = format!("; {} more after the first {MOST_TRANSFERS}", survey.overview.transfers.more);
            spans.push(Span::styled(text, theme.style(Role::Caution)));
        }
        let mut lines = vec![Line::from(spans)];
        if matches!(self.table.sort, Some((DURATION, _))) {
            lines.extend(latencies(survey).map(|text| Line::styled(text, theme.style(Role::Note))));
        }
        lines
    }

    fn parts(&self, core: &Core, survey: &SurveyResults, area: Rect) -> Parts {
        let above = draw::cells(self.summary(core, survey).len()).min(area.height / 2);
        let below = if area.height < LOW { 0 } else { DETAIL };
        Parts {
            summary: Rect { height: above, ..area },
            table: Rect { y: area.y + above, height: area.height - above - below, ..area },
            detail: Rect { y: area.bottom() - below, height: below, ..area },
        }
    }

    /// Indices of the visible columns.
    fn shown(&self, core: &Core, survey: &SurveyResults) -> Vec<usize> {
        let area = self.parts(core, survey, Rect::new(0, 0, core.width, core.height)).table;
        let columns = columns(core, area.width);
        Table::new(&core.theme, &columns).row_count(survey.overview.transfers.len()).shown(area)
    }

    /// The details of the selected transfer.
    fn draw_detail(core: &Core, exchange: &TransferRow, area: Rect, buf: &mut Buffer) {
        let theme = &core.theme;
        let frames = match (exchange.frames.first, exchange.frames.last) {
            (_, 0) => String::new(),
            (first, last) if first == last => format!("frame {last}"),
            (first, last) => format!("frames {first}-{last}"),
        };
        divider(theme, Rect { height: 1, ..area }, &format!("{} {}", exchange.outcome.name(), frames), buf);
        let lines = [Line::from(vec![
            Span::raw(format!("{}  {}  ", exchange.who, exchange.kind)),
            Span::styled(exchange.what.to_string(), theme.style(role_of(exchange.tone))),
        ])];
        let below = Rect { y: area.y + 1, height: area.height - 1, ..area };
        TextLines::new(theme, &lines).render(below, buf);
    }

    /// Moves the cursor to the end of another transfer.
    fn go(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        let survey = core.timeline.survey();
        let area = Rect::new(0, 0, 80, core.height);
        let height = Table::height(self.parts(core, &survey, area).table);
        let len = survey.overview.transfers.len();
        let order = self.order(&survey).map(Cow::into_owned);
        let selected = Self::selected(core, &survey, order.as_deref());
        self.table.selected = selected.unwrap_or(0);
        match (action, selected) {
            (Action::Top | Action::Bottom, _) => move_in(&mut self.table, action, height, len),
            // Before the first transfer only the first one can be selected.
            (Action::Down | Action::PageDown, None) => {}
            (_, None) => return Vec::new(),
            _ => move_in(&mut self.table, action, height, len),
        }
        let exchange = Self::exchange(order.as_deref(), &survey, self.table.selected);
        exchange.map(|exchange| Effect::Go(JumpPlace::Event(exchange.spot))).into_iter().collect()
    }
}

/// Median and maximum duration of the SDO transfers of each node, over the whole capture.
fn latencies(survey: &SurveyResults) -> Option<String> {
    let nodes = survey.overview.statistics.buses.iter().flat_map(BusStatistics::nodes);
    let part = |of: &Distribution, percent| of.percentile(percent).map_or(String::new(), millis);
    let told: Vec<String> = nodes
        .filter(|(_, node)| node.sdo_duration.count() > 0)
        .map(|(id, node)| {
            let times = &node.sdo_duration;
            format!("{} {} / {}", id.label(), part(times, 50), part(times, 100))
        })
        .collect();
    (!told.is_empty()).then(|| format!("SDO duration in ms, median / max:  {}", told.join("   ")))
}

impl Pane for Transfers {
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer) {
        let survey = core.timeline.survey();
        let lines = self.summary(core, &survey);
        let parts = self.parts(core, &survey, area);
        for (y, line) in (parts.summary.top()..parts.summary.bottom()).zip(&lines) {
            draw::line(buf, Rect { y, height: 1, ..area }, line, draw::Align::Left, &core.theme);
        }
        let order = self.order(&survey);
        let order = order.as_deref();
        let selected = Self::selected(core, &survey, order);
        // Without a selection the column heads still show the sort mark.
        let state = TableState { selected: selected.unwrap_or(0), ..self.table.clone() };
        let columns = columns(core, parts.table.width);
        let width = |column| Table::width_of(&columns, column, parts.table.width.saturating_sub(1));
        let widths = (width(BUS), width(CONTENT));
        let row = |index: usize| -> Row<'_> {
            Self::exchange(order, &survey, index)
                .map_or_else(Row::default, |exchange| row(core, exchange, widths))
        };
        let empty =
            if survey.is_complete { "no SDO, J1939 transport or UDS transfers" } else { "no transfers yet" };
        let table = Table::new(&core.theme, &columns).row_count(survey.overview.transfers.len()).rows(row);
        table.state(&state).focused(selected.is_some()).empty(empty).render(parts.table, buf);
        let exchange = selected.and_then(|row| Self::exchange(order, &survey, row));
        if let Some(exchange) = exchange.filter(|_| parts.detail.height > 1) {
            Self::draw_detail(core, exchange, parts.detail, buf);
        }
    }

    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        match action {
            Action::Down | Action::Up | Action::PageDown | Action::PageUp | Action::Top | Action::Bottom => {
                return self.go(action, core);
            }
            Action::Left | Action::Right | Action::Sort => {
                let shown = self.shown(core, &core.timeline.survey());
                act_on_column(&mut self.table, action, &shown);
            }
            Action::Open => {
                let survey = core.timeline.survey();
                let current = self.current(core, &survey);
                let place = current.map(|exchange| (exchange.spot, exchange.bus, exchange.node));
                drop(survey);
                let Some((spot, bus, node)) = place else { return Vec::new() };
                let node = node.map(|node| Effect::Node((bus, node)));
                let rest = [Effect::Go(JumpPlace::Event(spot)), Effect::ShowDetail];
                return node.into_iter().chain(rest).collect();
            }
            _ => {}
        }
        self.refresh(core);
        Vec::new()
    }

    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect> {
        let survey = core.timeline.survey();
        let below = self.parts(core, &survey, area).table;
        let columns = columns(core, below.width);
        let table = Table::new(&core.theme, &columns).row_count(survey.overview.transfers.len());
        if let Some(column) = table.column_at(below, x) {
            self.table.column = column;
        }
        if Table::is_title_at(below, y) {
            self.table.cycle_sort(&table.shown(below));
            return Vec::new();
        }
        let order = self.order(&survey);
        let selected = Self::selected(core, &survey, order.as_deref()).unwrap_or(0);
        let state = TableState { selected, ..self.table.clone() };
        let row = table.row_at(below, y, &state);
        let exchange = row.and_then(|row| Self::exchange(order.as_deref(), &survey, row));
        exchange.map(|exchange| Effect::Go(JumpPlace::Event(exchange.spot))).into_iter().collect()
    }

    fn refresh(&mut self, core: &Core) {
        let survey = core.timeline.survey();
        self.counts.add(&survey.overview.transfers);
        let wanted = (survey.overview.transfers.len(), self.table.sort);
        if self.made != wanted {
            self.order = self.order(&survey).map(Cow::into_owned).unwrap_or_default();
            self.made = wanted;
        }
    }

    fn sorting(&self) -> Sorting {
        self.table.sort
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.table.sort = sorting;
    }

    fn legend(&self) -> &'static Legend {
        &legend::TRANSFERS
    }

    fn heads(&self) -> Vec<Column> {
        arranged("Time", 9, 4, 0)
    }

    fn performs(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Sort]
    }

    fn actions(&self) -> &'static [Action] {
        &[
            Action::Open,
            Action::Sort,
            Action::FilterCell,
            Action::NextError,
            Action::NextFinding,
            Action::GoTo,
        ]
    }

    fn filter_of_cell(&self, core: &Core) -> Option<String> {
        let survey = core.timeline.survey();
        let exchange = self.current(core, &survey)?;
        let column = self.table.column_in(&self.shown(core, &survey));
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

    fn line(&self, core: &Core) -> Option<String> {
        let survey = core.timeline.survey();
        let exchange = self.current(core, &survey)?;
        let (time, bus) = (time(core, exchange.time), bus_name(core, exchange.bus));
        Some(format!("{time} {bus} {} {} {}", exchange.who, exchange.kind, exchange.what))
    }
}

/// The row of a transfer with the widths of bus and content.
fn row(core: &Core, exchange: &TransferRow, widths: (u16, u16)) -> Row<'static> {
    let theme = &core.theme;
    let (quiet, tone) = (theme.style(Role::Quiet), theme.style(role_of(exchange.tone)));
    let number = if exchange.frames.last == 0 { String::new() } else { exchange.frames.last.to_string() };
    Row::new([
        Cell::new(number, quiet),
        Cell::from(time(core, exchange.time)),
        Cell::from(exchange.duration.map(millis).unwrap_or_default()),
        Cell::new(bus_short(core, &bus_name(core, exchange.bus), widths.0), quiet),
        Cell::from(exchange.who.to_string()),
        Cell::new(exchange.kind, tone),
        Cell::new(fit(&exchange.news, widths.1, theme), tone),
        Cell::new(size(exchange), quiet),
        Cell::new(exchange.outcome.name(), tone),
    ])
}

/// Bytes transferred; empty for UDS, whose content contains them.
fn size(exchange: &TransferRow) -> String {
    if exchange.event_kind == Kind::UdsExchange { String::new() } else { exchange.size.to_string() }
}
