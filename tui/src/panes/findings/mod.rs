//! Findings by cause, worst first, with the details of the selected one below the table.
//!
//! ```text
//! filter   2 of 4 findings match severity >= warning; c shows all
//! quality  27 error frames
//! Severity Node     ×    First   Cursor  Finding
//! warning  can0     1    4.030   -1.200  ▾ 17 error frames/s (limit 10/s)
//! error    5/05     1    4.210   -1.020      no heartbeat after {129} (last state operational)
//! ── error node-lost ────────────────────────────────────────────────
//! can0 5/05  no heartbeat after {129} (last state operational)
//!   at 4.210 s {129}
//! ```

mod chosen;
mod detail;
mod rows;

use std::borrow::Cow;
use std::collections::BTreeSet;

use cobscope_decoder::finding::Verdict;
use cobscope_decoder::replay::node_filter;
use cobscope_decoder::words::plural;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;

pub use self::chosen::filtered_places;
use self::chosen::{FilterKey, FilterResult};
use self::rows::{Facts, Item, facts, group, items};
use super::common::{
    act_on_column, ahead, bus_name, bus_short, bus_title, bus_width, chosen as chosen_columns, divider,
    move_in, severity_role, time, time_width,
};
use super::legend::{self, Legend};
use super::{Effect, Pane, Sorting};
use crate::action::Action;
use crate::state::{Core, DIFFERS, JumpPlace};
use crate::theme::Role;
use crate::timeline::SurveyResults;
use crate::widgets::draw;
use crate::widgets::table::{Cell, Column, Row, Table, TableState, Width};

/// The table of findings.
#[derive(Debug, Default)]
pub struct Findings {
    table: TableState,
    /// Id of the selected finding; its row may move.
    selected: Option<u64>,
    /// Findings whose effects are hidden.
    folded: BTreeSet<u64>,
    listed: FindingList,
}

/// The rows with the inputs they were made from.
#[derive(Debug, Clone, Default)]
struct FindingList {
    rows: Vec<Item>,
    /// Result of the current filter.
    chosen: Option<FilterResult>,
    /// Inputs of the rows.
    made: Option<RowInputs>,
}

/// Inputs of the rows; they are rebuilt if one of them changes.
#[derive(Debug, Clone, PartialEq, Eq)]
struct RowInputs {
    openings: usize,
    is_complete: bool,
    folded: usize,
    sort: Option<(usize, bool)>,
    filter: Option<FilterKey>,
}

/// Width of the finding text: at least `LEAST_TEXT`; `WANTED_TEXT` before less important columns are added.
const LEAST_TEXT: u16 = 34;
const WANTED_TEXT: u16 = 72;

/// Width of the columns up to `Cursor` without bus and first time, with spaces and scroll bar.
const IMPORTANT: u16 = 50;

/// Columns for a table of `width`.
fn columns(core: &Core, width: u16) -> Vec<Column> {
    let columns = arranged(time_width(core).max(5), bus_width(core, width), width);
    chosen_columns(core, "findings", arranged(9, 4, 0), columns)
}

/// Columns with these widths of time and bus.
fn arranged(time: u16, bus: u16, width: u16) -> Vec<Column> {
    let others = IMPORTANT.saturating_add(bus).saturating_add(time);
    let least = LEAST_TEXT.saturating_sub(bus);
    let text = width.saturating_sub(others).clamp(least, WANTED_TEXT);
    vec![
        Column::new("Severity", Width::Fixed(8)).priority(12),
        Column::new(bus_title(bus), Width::Fixed(bus)).priority(11),
        Column::new("Node", Width::Fixed(12)).priority(10),
        Column::new("×", Width::Fixed(5)).right().priority(8),
        Column::new("First", Width::Fixed(time)).right().priority(9),
        Column::new("Last", Width::Fixed(time)).right().priority(3),
        Column::new("Cursor", Width::Fixed(9)).right().priority(7),
        Column::new("Rule", Width::Fixed(24)).priority(2),
        Column::new("Subject", Width::Fixed(10)).priority(1),
        Column::new("Finding", Width::Min(text)),
    ]
}

/// Indices of columns that can be filtered.
const SEVERITY: usize = 0;
const BUS: usize = 1;
const RULE: usize = 7;
const SUBJECT: usize = 8;

/// Index of the column with the tree.
const TEXT: usize = 9;

/// Height from which the details take two fifths of the pane.
const TALL: u16 = 26;

/// Height from which the most important details are shown.
const LOW: u16 = 15;

/// Screen areas of this pane.
struct Parts {
    quality: Rect,
    table: Rect,
    detail: Rect,
}

/// The details take the space left by notes and rows, and at least a minimum share.
fn parts(area: Rect, notes: usize, rows: usize) -> Parts {
    let least = match area.height {
        TALL.. => area.height * 2 / 5,
        LOW.. => 5,
        _ => 0,
    };
    let quality = draw::cells(notes).min((area.height - least) / 3);
    let room = area.height - quality;
    let spare = room.saturating_sub(draw::cells(rows.max(1)).saturating_add(2));
    let detail = if least == 0 { 0 } else { least.max(spare.min(area.height * 3 / 4)) };
    Parts {
        quality: Rect { height: quality, ..area },
        table: Rect { y: area.y + quality, height: room - detail, ..area },
        detail: Rect { y: area.bottom() - detail, height: detail, ..area },
    }
}

impl Findings {
    fn made(&self, core: &Core, survey: &SurveyResults) -> RowInputs {
        RowInputs {
            openings: survey.overview.opened.len(),
            is_complete: survey.findings.is_some(),
            folded: self.folded.len(),
            sort: self.table.sort,
            filter: FilterKey::new(core),
        }
    }

    /// The rows, rebuilt only if an input changed.
    fn listed(&self, core: &Core, survey: &SurveyResults) -> Cow<'_, FindingList> {
        let made = self.made(core, survey);
        if self.listed.made.as_ref() == Some(&made) {
            return Cow::Borrowed(&self.listed);
        }
        let chosen = FilterResult::new(core, survey);
        let rows = items(survey, chosen.as_ref(), &self.folded, self.table.sort);
        Cow::Owned(FindingList { rows, chosen, made: Some(made) })
    }

    /// Row of the selected finding.
    fn at(&self, items: &[Item]) -> usize {
        let at = self.selected.and_then(|id| items.iter().position(|item| item.id == id));
        at.unwrap_or(self.table.selected).min(items.len().saturating_sub(1))
    }

    fn state(&self, items: &[Item]) -> TableState {
        TableState { selected: self.at(items), ..self.table.clone() }
    }

    fn item(&self, core: &Core, survey: &SurveyResults) -> Option<Item> {
        let listed = self.listed(core, survey);
        listed.rows.get(self.at(&listed.rows)).copied()
    }

    /// Number of visible table rows.
    fn height(&self, core: &Core, survey: &SurveyResults) -> usize {
        let notes = detail::notes(core, survey, self.listed.chosen.as_ref()).len();
        Table::height(parts(Rect::new(0, 0, 80, core.height), notes, self.listed.rows.len()).table)
    }

    fn moves(&mut self, action: Action, core: &Core, survey: &SurveyResults) {
        let (len, height) = (self.listed.rows.len(), self.height(core, survey));
        self.table.selected = self.at(&self.listed.rows);
        move_in(&mut self.table, action, height, len);
        self.selected = self.listed.rows.get(self.table.selected).map(|item| item.id);
    }

    /// Indices of the visible columns.
    fn shown(&self, core: &Core, survey: &SurveyResults) -> Vec<usize> {
        let (notes, count) =
            (detail::notes(core, survey, self.listed.chosen.as_ref()).len(), self.listed.rows.len());
        let area = parts(Rect::new(0, 0, core.width, core.height), notes, count).table;
        let columns = columns(core, area.width);
        Table::new(&core.theme, &columns).row_count(count).shown(area)
    }

    /// The filter for a cell; None for a column without a field.
    fn filter_of(&self, core: &Core, survey: &SurveyResults) -> Option<String> {
        let item = self.item(core, survey)?;
        let facts = facts(survey, &item)?;
        let of_node = || match facts.node {
            Some(node) => node_filter(node),
            None => format!("bus == {:?}", bus_name(core, facts.bus)),
        };
        Some(match self.table.column_in(&self.shown(core, survey)) {
            SEVERITY => format!("severity == {:?}", facts.severity.name()),
            BUS => format!("bus == {:?}", bus_name(core, facts.bus)),
            RULE => format!("rule == {:?}", facts.rule),
            SUBJECT => facts.subject.clone().unwrap_or_else(of_node),
            _ => of_node(),
        })
    }

    /// Goes to the first evidence.
    fn open(&self, core: &Core) -> Vec<Effect> {
        let survey = core.timeline.survey();
        let told = self.item(core, &survey).and_then(|item| Some((item, facts(&survey, &item)?)));
        drop(survey);
        let Some((item, facts)) = told else { return Vec::new() };
        let node = facts.node.map(|node| Effect::Node((facts.bus, node)));
        let rest = [
            Effect::Go(JumpPlace::Frame(facts.frame)),
            Effect::Say(core.finding_text(item.id)),
            Effect::ShowDetail,
        ];
        node.into_iter().chain(rest).collect()
    }

    fn draw_detail(&self, core: &Core, survey: &SurveyResults, area: Rect, buf: &mut Buffer) {
        let Some(item) = self.item(core, survey) else { return };
        let (title, lines) = match (&survey.findings, group(survey, &item)) {
            (Some(findings), Some(group)) => {
                let title = format!("{} {}", group.severity.name(), group.rule);
                (title, detail::lines(core, findings, group))
            }
            _ => match facts(survey, &item) {
                Some(facts) => {
                    (format!("{} {}", facts.severity.name(), facts.rule), detail::opening(core, &facts))
                }
                None => return,
            },
        };
        divider(&core.theme, Rect { height: 1, ..area }, &title, buf);
        let below = Rect { y: area.y + 1, height: area.height - 1, ..area };
        lines.render(&core.theme, 0, below, buf);
    }
}

impl Pane for Findings {
    fn render(&self, core: &Core, area: Rect, buf: &mut Buffer) {
        let survey = core.timeline.survey();
        let listed = self.listed(core, &survey);
        let (items, chosen) = (&listed.rows, listed.chosen.as_ref());
        let notes = detail::notes(core, &survey, chosen);
        let parts = parts(area, notes.len(), items.len());
        let left_out = notes.len().saturating_sub(usize::from(parts.quality.height));
        for (y, note) in (parts.quality.top()..parts.quality.bottom()).zip(&notes) {
            let place = Rect { y, height: 1, ..parts.quality };
            draw::line(buf, place, note, draw::Align::Left, &core.theme);
            if left_out > 0 && y + 1 == parts.quality.bottom() {
                let more = ratatui::text::Line::raw(format!("  and {left_out} more"));
                draw::line(buf, place, &more, draw::Align::Right, &core.theme);
            }
        }
        let (state, bus) = (self.state(items), bus_width(core, parts.table.width));
        let (columns, empty) = (columns(core, parts.table.width), empty(&survey, chosen));
        let row = |index: usize| -> Row<'_> {
            let item = items.get(index);
            let told = item.and_then(|item| Some((item, facts(&survey, item)?)));
            told.map_or_else(Row::default, |(item, facts)| row(core, item, &facts, bus))
        };
        let table = Table::new(&core.theme, &columns).row_count(items.len()).rows(row);
        table.state(&state).tree_column(TEXT).empty(&empty).render(parts.table, buf);
        if parts.detail.height > 1 {
            self.draw_detail(core, &survey, parts.detail, buf);
        }
    }

    fn act(&mut self, action: Action, core: &Core) -> Vec<Effect> {
        self.refresh(core);
        match action {
            Action::Down | Action::Up | Action::PageDown | Action::PageUp | Action::Top | Action::Bottom => {
                let survey = core.timeline.survey();
                self.moves(action, core, &survey);
            }
            Action::Left | Action::Right | Action::Sort => {
                let shown = self.shown(core, &core.timeline.survey());
                act_on_column(&mut self.table, action, &shown);
            }
            Action::Toggle => {
                let item =
                    self.listed.rows.get(self.at(&self.listed.rows)).filter(|item| item.open.is_some());
                let Some(id) = item.map(|item| item.id) else {
                    return vec![Effect::Refuse("this finding has no effects to show or hide".into())];
                };
                if !self.folded.remove(&id) {
                    self.folded.insert(id);
                }
            }
            Action::Open => return self.open(core),
            _ => {}
        }
        self.refresh(core);
        Vec::new()
    }

    fn click(&mut self, x: u16, y: u16, area: Rect, core: &Core) -> Vec<Effect> {
        self.refresh(core);
        let survey = core.timeline.survey();
        let rows = &self.listed.rows;
        let notes = detail::notes(core, &survey, self.listed.chosen.as_ref()).len();
        let table_area = parts(area, notes, rows.len()).table;
        let columns = columns(core, table_area.width);
        let table = Table::new(&core.theme, &columns).row_count(rows.len());
        if let Some(column) = table.column_at(table_area, x) {
            self.table.column = column;
        }
        if Table::is_title_at(table_area, y) {
            self.table.cycle_sort(&table.shown(table_area));
        } else if let Some(row) = table.row_at(table_area, y, &self.state(rows)) {
            self.selected = rows.get(row).map(|item| item.id);
        }
        Vec::new()
    }

    fn refresh(&mut self, core: &Core) {
        let survey = core.timeline.survey();
        if let Cow::Owned(listed) = self.listed(core, &survey) {
            self.listed = listed;
            self.table.selected = self.at(&self.listed.rows);
        }
    }

    fn sorting(&self) -> Sorting {
        self.table.sort
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.table.sort = sorting;
    }

    fn legend(&self) -> &'static Legend {
        &legend::FINDINGS
    }

    fn heads(&self) -> Vec<Column> {
        arranged(9, 4, 0)
    }

    fn performs(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Toggle, Action::Sort]
    }

    fn actions(&self) -> &'static [Action] {
        &[
            Action::Open,
            Action::Toggle,
            Action::Sort,
            Action::Filter,
            Action::FilterCell,
            Action::NextFinding,
            Action::PreviousFinding,
            Action::Report,
            Action::Copy,
        ]
    }

    fn filter_of_cell(&self, core: &Core) -> Option<String> {
        self.filter_of(core, &core.timeline.survey())
    }

    fn finding(&self, core: &Core) -> Option<u64> {
        let survey = core.timeline.survey();
        self.item(core, &survey).map(|item| item.id)
    }

    fn line(&self, core: &Core) -> Option<String> {
        let survey = core.timeline.survey();
        let facts = facts(&survey, &self.item(core, &survey)?)?;
        drop(survey);
        let (severity, bus) = (facts.severity.name(), bus_name(core, facts.bus));
        let (time, frame) = (time(core, facts.began), facts.frame);
        Some(format!(
            "{severity} {bus} {} {} [{}] at {time} s {{{frame}}}",
            facts.who, facts.text, facts.rule
        ))
    }
}

/// Message of an empty table.
fn empty(survey: &SurveyResults, chosen: Option<&FilterResult>) -> String {
    if chosen.is_some_and(|chosen| !chosen.is_of_none()) {
        return "no findings match; c clears the filter".into();
    }
    let Some(findings) = &survey.findings else { return "no findings yet".into() };
    let used = findings.rules.iter().zip(&findings.tallies).filter(|(rule, _)| rule.is_on);
    let (none, judged): (Vec<_>, Vec<_>) =
        used.map(|(_, tally)| tally.verdict()).partition(|verdict| *verdict == Verdict::NotExercised);
    format!("no findings: {} exercised, {} not exercised", plural(judged.len(), "rule"), none.len())
}

/// The text of a finding, with a mark if the other capture lacks it.
fn marked(core: &Core, item: &Item, text: &str) -> String {
    if core.is_new_finding(item.id) { format!("{DIFFERS} {text}") } else { text.to_owned() }
}

fn row(core: &Core, item: &Item, facts: &Facts, bus: u16) -> Row<'static> {
    let theme = &core.theme;
    let (quiet, judged) = (theme.style(Role::Quiet), theme.style(severity_role(facts.severity)));
    let ahead = ahead(core, facts.began);
    let ended = if facts.count > 1 { time(core, facts.ended) } else { String::new() };
    let severity = if facts.is_suppressed { "suppr." } else { facts.severity.name() };
    let mut cells = vec![
        Cell::new(severity, judged),
        Cell::new(bus_short(core, &bus_name(core, facts.bus), bus), quiet),
        Cell::from(facts.who.clone()),
        Cell::new(facts.count.to_string(), Style::new()),
        Cell::from(time(core, facts.began)),
        Cell::from(ended),
        Cell::new(ahead, quiet),
        Cell::new(facts.rule.clone(), quiet),
        Cell::from(facts.about.clone()),
        Cell::new(marked(core, item, &facts.text), judged),
    ];
    if facts.is_suppressed {
        for cell in &mut cells {
            cell.style = quiet;
        }
    }
    Row::new(cells).group(item.depth, item.open)
}
