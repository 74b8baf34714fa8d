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

use cobscope_decoder::finding::RuleOutcome;
use cobscope_decoder::replay::node_filter;
use cobscope_decoder::words::count_noun;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;

pub use self::chosen::filtered_places;
use self::chosen::{ChosenFindings, FilterKey};
use self::rows::{FindingRow, FindingRowContent, finding_rows, group_of, row_content};
use super::common::{
    act_on_column, bus_name, bus_short, bus_title, bus_width, chosen_columns, display_time, draw_divider,
    move_in, relative_time, severity_role, time_width,
};
use super::legend::{self, PaneLegend};
use super::{Pane, PaneRequest, Sorting};
use crate::action::Action;
use crate::state::{DIFFERS, JumpPlace, UiState};
use crate::theme::TextRole;
use crate::timeline::SurveyResults;
use crate::widgets::draw;
use crate::widgets::table::{ColumnWidth, TableCell, TableColumn, TableRow, TableState, TableWidget};

/// The table of findings.
#[derive(Debug, Default)]
pub struct FindingsPane {
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
    rows: Vec<FindingRow>,
    /// Result of the current filter.
    chosen: Option<ChosenFindings>,
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
fn finding_columns(core: &UiState, width: u16) -> Vec<TableColumn> {
    let columns = arrange_columns(time_width(core).max(5), bus_width(core, width), width);
    chosen_columns(core, "findings", arrange_columns(9, 4, 0), columns)
}

/// Columns with these widths of time and bus.
fn arrange_columns(time: u16, bus: u16, width: u16) -> Vec<TableColumn> {
    let others = IMPORTANT.saturating_add(bus).saturating_add(time);
    let least = LEAST_TEXT.saturating_sub(bus);
    let text = width.saturating_sub(others).clamp(least, WANTED_TEXT);
    vec![
        TableColumn::new("Severity", ColumnWidth::Fixed(8)).with_priority(12),
        TableColumn::new(bus_title(bus), ColumnWidth::Fixed(bus)).with_priority(11),
        TableColumn::new("Node", ColumnWidth::Fixed(12)).with_priority(10),
        TableColumn::new("×", ColumnWidth::Fixed(5)).align_right().with_priority(8),
        TableColumn::new("First", ColumnWidth::Fixed(time)).align_right().with_priority(9),
        TableColumn::new("Last", ColumnWidth::Fixed(time)).align_right().with_priority(3),
        TableColumn::new("Cursor", ColumnWidth::Fixed(9)).align_right().with_priority(7),
        TableColumn::new("Rule", ColumnWidth::Fixed(24)).with_priority(2),
        TableColumn::new("Subject", ColumnWidth::Fixed(10)).with_priority(1),
        TableColumn::new("Finding", ColumnWidth::Min(text)),
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
struct FindingAreas {
    quality: Rect,
    table: Rect,
    detail: Rect,
}

/// The details take the space left by notes and rows, and at least a minimum share.
fn pane_areas(area: Rect, notes: usize, rows: usize) -> FindingAreas {
    let least = match area.height {
        TALL.. => area.height * 2 / 5,
        LOW.. => 5,
        _ => 0,
    };
    let quality = draw::to_cells(notes).min((area.height - least) / 3);
    let room = area.height - quality;
    let spare = room.saturating_sub(draw::to_cells(rows.max(1)).saturating_add(2));
    let detail = if least == 0 { 0 } else { least.max(spare.min(area.height * 3 / 4)) };
    FindingAreas {
        quality: Rect { height: quality, ..area },
        table: Rect { y: area.y + quality, height: room - detail, ..area },
        detail: Rect { y: area.bottom() - detail, height: detail, ..area },
    }
}

impl FindingsPane {
    fn row_inputs(&self, core: &UiState, survey: &SurveyResults) -> RowInputs {
        RowInputs {
            openings: survey.overview.opened.len(),
            is_complete: survey.findings.is_some(),
            folded: self.folded.len(),
            sort: self.table.sort,
            filter: FilterKey::new(core),
        }
    }

    /// The rows, rebuilt only if an input changed.
    fn listed_rows(&self, core: &UiState, survey: &SurveyResults) -> Cow<'_, FindingList> {
        let made = self.row_inputs(core, survey);
        if self.listed.made.as_ref() == Some(&made) {
            return Cow::Borrowed(&self.listed);
        }
        let chosen = ChosenFindings::new(core, survey);
        let rows = finding_rows(survey, chosen.as_ref(), &self.folded, self.table.sort);
        Cow::Owned(FindingList { rows, chosen, made: Some(made) })
    }

    /// Row of the selected finding.
    fn selected_index(&self, items: &[FindingRow]) -> usize {
        let at = self.selected.and_then(|id| items.iter().position(|item| item.id == id));
        at.unwrap_or(self.table.selected).min(items.len().saturating_sub(1))
    }

    fn table_state(&self, items: &[FindingRow]) -> TableState {
        TableState { selected: self.selected_index(items), ..self.table.clone() }
    }

    fn selected_row(&self, core: &UiState, survey: &SurveyResults) -> Option<FindingRow> {
        let listed = self.listed_rows(core, survey);
        listed.rows.get(self.selected_index(&listed.rows)).copied()
    }

    /// Number of visible table rows.
    fn visible_height(&self, core: &UiState, survey: &SurveyResults) -> usize {
        let notes = detail::note_lines(core, survey, self.listed.chosen.as_ref()).len();
        TableWidget::visible_height(
            pane_areas(Rect::new(0, 0, 80, core.height), notes, self.listed.rows.len()).table,
        )
    }

    fn move_selection(&mut self, action: Action, core: &UiState, survey: &SurveyResults) {
        let (len, height) = (self.listed.rows.len(), self.visible_height(core, survey));
        self.table.selected = self.selected_index(&self.listed.rows);
        move_in(&mut self.table, action, height, len);
        self.selected = self.listed.rows.get(self.table.selected).map(|item| item.id);
    }

    /// Indices of the visible columns.
    fn visible_columns(&self, core: &UiState, survey: &SurveyResults) -> Vec<usize> {
        let (notes, count) =
            (detail::note_lines(core, survey, self.listed.chosen.as_ref()).len(), self.listed.rows.len());
        let area = pane_areas(Rect::new(0, 0, core.width, core.height), notes, count).table;
        let columns = finding_columns(core, area.width);
        TableWidget::new(&core.theme, &columns).row_count(count).visible_columns(area)
    }

    /// The filter for a cell; None for a column without a field.
    fn filter_of(&self, core: &UiState, survey: &SurveyResults) -> Option<String> {
        let item = self.selected_row(core, survey)?;
        let facts = row_content(survey, &item)?;
        let of_node = || match facts.node {
            Some(node) => node_filter(node),
            None => format!("bus == {:?}", bus_name(core, facts.bus)),
        };
        Some(match self.table.column_in(&self.visible_columns(core, survey)) {
            SEVERITY => format!("severity == {:?}", facts.severity.name()),
            BUS => format!("bus == {:?}", bus_name(core, facts.bus)),
            RULE => format!("rule == {:?}", facts.rule),
            SUBJECT => facts.subject.clone().unwrap_or_else(of_node),
            _ => of_node(),
        })
    }

    /// Goes to the first evidence.
    fn open_evidence(&self, core: &UiState) -> Vec<PaneRequest> {
        let survey = core.timeline.survey();
        let reported =
            self.selected_row(core, &survey).and_then(|item| Some((item, row_content(&survey, &item)?)));
        drop(survey);
        let Some((item, facts)) = reported else { return Vec::new() };
        let node = facts.node.map(|node| PaneRequest::Node((facts.bus, node)));
        let rest = [
            PaneRequest::Go(JumpPlace::Frame(facts.frame)),
            PaneRequest::Say(core.finding_text(item.id)),
            PaneRequest::ShowDetail,
        ];
        node.into_iter().chain(rest).collect()
    }

    fn draw_detail(&self, core: &UiState, survey: &SurveyResults, area: Rect, buf: &mut Buffer) {
        let Some(item) = self.selected_row(core, survey) else { return };
        let (title, lines) = match (&survey.findings, group_of(survey, &item)) {
            (Some(findings), Some(group)) => {
                let title = format!("{} {}", group.severity.name(), group.rule);
                (title, detail::finding_lines(core, findings, group))
            }
            _ => match row_content(survey, &item) {
                Some(facts) => {
                    (format!("{} {}", facts.severity.name(), facts.rule), detail::opening_lines(core, &facts))
                }
                None => return,
            },
        };
        draw_divider(&core.theme, Rect { height: 1, ..area }, &title, buf);
        let below = Rect { y: area.y + 1, height: area.height - 1, ..area };
        lines.render(&core.theme, 0, below, buf);
    }
}

impl Pane for FindingsPane {
    fn render_pane(&self, core: &UiState, area: Rect, buf: &mut Buffer) {
        let survey = core.timeline.survey();
        let listed = self.listed_rows(core, &survey);
        let (items, chosen) = (&listed.rows, listed.chosen.as_ref());
        let notes = detail::note_lines(core, &survey, chosen);
        let parts = pane_areas(area, notes.len(), items.len());
        let left_out = notes.len().saturating_sub(usize::from(parts.quality.height));
        for (y, note) in (parts.quality.top()..parts.quality.bottom()).zip(&notes) {
            let place = Rect { y, height: 1, ..parts.quality };
            draw::draw_line(buf, place, note, draw::TextAlignment::Left, &core.theme);
            if left_out > 0 && y + 1 == parts.quality.bottom() {
                let more = ratatui::text::Line::raw(format!("  and {left_out} more"));
                draw::draw_line(buf, place, &more, draw::TextAlignment::Right, &core.theme);
            }
        }
        let (state, bus) = (self.table_state(items), bus_width(core, parts.table.width));
        let (columns, empty) = (finding_columns(core, parts.table.width), empty_text(&survey, chosen));
        let row = |index: usize| -> TableRow<'_> {
            let item = items.get(index);
            let reported = item.and_then(|item| Some((item, row_content(&survey, item)?)));
            reported.map_or_else(TableRow::default, |(item, facts)| finding_row(core, item, &facts, bus))
        };
        let table = TableWidget::new(&core.theme, &columns).row_count(items.len()).with_rows(row);
        table.with_state(&state).tree_column(TEXT).with_empty_text(&empty).render(parts.table, buf);
        if parts.detail.height > 1 {
            self.draw_detail(core, &survey, parts.detail, buf);
        }
    }

    fn on_action(&mut self, action: Action, core: &UiState) -> Vec<PaneRequest> {
        self.refresh_state(core);
        match action {
            Action::Down | Action::Up | Action::PageDown | Action::PageUp | Action::Top | Action::Bottom => {
                let survey = core.timeline.survey();
                self.move_selection(action, core, &survey);
            }
            Action::Left | Action::Right | Action::Sort => {
                let shown = self.visible_columns(core, &core.timeline.survey());
                act_on_column(&mut self.table, action, &shown);
            }
            Action::Toggle => {
                let item = self
                    .listed
                    .rows
                    .get(self.selected_index(&self.listed.rows))
                    .filter(|item| item.open.is_some());
                let Some(id) = item.map(|item| item.id) else {
                    return vec![PaneRequest::Refuse("this finding has no effects to show or hide".into())];
                };
                if !self.folded.remove(&id) {
                    self.folded.insert(id);
                }
            }
            Action::Open => return self.open_evidence(core),
            _ => {}
        }
        self.refresh_state(core);
        Vec::new()
    }

    fn on_click(&mut self, x: u16, y: u16, area: Rect, core: &UiState) -> Vec<PaneRequest> {
        self.refresh_state(core);
        let survey = core.timeline.survey();
        let rows = &self.listed.rows;
        let notes = detail::note_lines(core, &survey, self.listed.chosen.as_ref()).len();
        let table_area = pane_areas(area, notes, rows.len()).table;
        let columns = finding_columns(core, table_area.width);
        let table = TableWidget::new(&core.theme, &columns).row_count(rows.len());
        if let Some(column) = table.column_at(table_area, x) {
            self.table.column = column;
        }
        if TableWidget::is_title_at(table_area, y) {
            self.table.cycle_sort(&table.visible_columns(table_area));
        } else if let Some(row) = table.row_at(table_area, y, &self.table_state(rows)) {
            self.selected = rows.get(row).map(|item| item.id);
        }
        Vec::new()
    }

    fn refresh_state(&mut self, core: &UiState) {
        let survey = core.timeline.survey();
        if let Cow::Owned(listed) = self.listed_rows(core, &survey) {
            self.listed = listed;
            self.table.selected = self.selected_index(&self.listed.rows);
        }
    }

    fn table_sorting(&self) -> Sorting {
        self.table.sort
    }

    fn set_sorting(&mut self, sorting: Sorting) {
        self.table.sort = sorting;
    }

    fn pane_legend(&self) -> &'static PaneLegend {
        &legend::FINDINGS
    }

    fn table_heads(&self) -> Vec<TableColumn> {
        arrange_columns(9, 4, 0)
    }

    fn performed_actions(&self) -> &'static [Action] {
        &[Action::Left, Action::Right, Action::Toggle, Action::Sort]
    }

    fn key_bar_actions(&self) -> &'static [Action] {
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

    fn filter_of_cell(&self, core: &UiState) -> Option<String> {
        self.filter_of(core, &core.timeline.survey())
    }

    fn selected_finding(&self, core: &UiState) -> Option<u64> {
        let survey = core.timeline.survey();
        self.selected_row(core, &survey).map(|item| item.id)
    }

    fn selected_line(&self, core: &UiState) -> Option<String> {
        let survey = core.timeline.survey();
        let facts = row_content(&survey, &self.selected_row(core, &survey)?)?;
        drop(survey);
        let (severity, bus) = (facts.severity.name(), bus_name(core, facts.bus));
        let (time, frame) = (display_time(core, facts.began), facts.frame);
        Some(format!(
            "{severity} {bus} {} {} [{}] at {time} s {{{frame}}}",
            facts.who, facts.text, facts.rule
        ))
    }
}

/// Message of an empty table.
fn empty_text(survey: &SurveyResults, chosen: Option<&ChosenFindings>) -> String {
    if chosen.is_some_and(|chosen| !chosen.is_of_none()) {
        return "no findings match; c clears the filter".into();
    }
    let Some(findings) = &survey.findings else { return "no findings yet".into() };
    let used = findings.rules.iter().zip(&findings.tallies).filter(|(rule, _)| rule.is_on);
    let (none, judged): (Vec<_>, Vec<_>) =
        used.map(|(_, tally)| tally.verdict()).partition(|verdict| *verdict == RuleOutcome::NotExercised);
    format!("no findings: {} exercised, {} not exercised", count_noun(judged.len(), "rule"), none.len())
}

/// The text of a finding, with a mark if the other capture lacks it.
fn marked_text(core: &UiState, item: &FindingRow, text: &str) -> String {
    if core.against.is_new_finding(item.id) { format!("{DIFFERS} {text}") } else { text.to_owned() }
}

fn finding_row(core: &UiState, item: &FindingRow, facts: &FindingRowContent, bus: u16) -> TableRow<'static> {
    let theme = &core.theme;
    let (quiet, judged) =
        (theme.role_style(TextRole::Quiet), theme.role_style(severity_role(facts.severity)));
    let ahead = relative_time(core, facts.began);
    let ended = if facts.count > 1 { display_time(core, facts.ended) } else { String::new() };
    let severity = if facts.is_suppressed { "suppr." } else { facts.severity.name() };
    let mut cells = vec![
        TableCell::new(severity, judged),
        TableCell::new(bus_short(core, &bus_name(core, facts.bus), bus), quiet),
        TableCell::from(facts.who.clone()),
        TableCell::new(facts.count.to_string(), Style::new()),
        TableCell::from(display_time(core, facts.began)),
        TableCell::from(ended),
        TableCell::new(ahead, quiet),
        TableCell::new(facts.rule.clone(), quiet),
        TableCell::from(facts.about.clone()),
        TableCell::new(marked_text(core, item, &facts.text), judged),
    ];
    if facts.is_suppressed {
        for cell in &mut cells {
            cell.style = quiet;
        }
    }
    TableRow::new(cells).with_group(item.depth, item.open)
}
