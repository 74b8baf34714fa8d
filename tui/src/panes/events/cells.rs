//! Cells of an event: its columns as text, the severity at its left, and what changed first.

use std::borrow::Cow;

use cobscope_decoder::event::EventKind;
use cobscope_decoder::profile::device::Severity;
use cobscope_decoder::sink::text::LineTone;
use ratatui::style::Style;
use ratatui::text::{Line, Span};

use super::columns::{BUS, COUNT, DATA, DELTA, EVENT, ID, KIND, NODE, NUMBER, OBJECT, SEVERITY, TIME};
use crate::panes::common;
use crate::state::UiState;
use crate::theme::{TextRole, role_of};
use crate::timeline::ReplayRow as EventRow;
use crate::widgets::draw;
use crate::widgets::fit::fit_text;
use crate::widgets::table::{TableCell, TableRow};
use cobscope_decoder::figures::format_seconds;

/// Widths that the cells of a row depend on.
#[derive(Debug, Clone, Copy)]
pub(super) struct CellWidths {
    /// Width of the event.
    pub(super) event: u16,
    /// Width of the object; 0 if the event contains it.
    pub(super) object: u16,
    /// Width of the bus.
    pub(super) bus: u16,
    /// Width of the node.
    pub(super) node: u16,
}

/// The row of an event. `before` is the row above, `marked` a highlighted text.
pub(super) fn event_row(
    core: &UiState,
    row: &EventRow,
    before: Option<&EventRow>,
    widths: CellWidths,
    marked: Option<&str>,
) -> TableRow<'static> {
    let severity = severity_mark(core, row);
    let tone = severity.map_or_else(|| role_of(row.tone), |(_, role)| role);
    let (tone, quiet) = (core.theme.role_style(tone), core.theme.role_style(TextRole::Quiet));
    let cells = (0..COUNT).map(|column| {
        let text = cell_text(core, row, before, column);
        let is_marked = marked.is_some_and(|wanted| !wanted.is_empty() && wanted == text);
        let style = match column {
            _ if is_marked => core.theme.role_style(TextRole::Highlight(1)),
            SEVERITY | KIND | OBJECT | EVENT => tone,
            NUMBER | DELTA | DATA => quiet,
            _ => Style::new(),
        };
        match column {
            EVENT => TableCell::new(event_line(core, row, widths), style),
            SEVERITY => TableCell::new(severity.map_or("", |(letter, _)| letter), style),
            BUS => TableCell::new(common::bus_short(core, &row.bus, widths.bus), style),
            NODE => TableCell::new(node_text(&row.who, widths.node), style),
            _ => TableCell::new(text.into_owned(), style),
        }
    });
    TableRow::new(cells)
}

/// The event: changes first, then the unchanged signals, dimmed.
fn event_line(core: &UiState, row: &EventRow, widths: CellWidths) -> Line<'static> {
    let news = if widths.object > 0 { &row.value } else { &row.news };
    let news = fit_text(news, widths.event, &core.theme);
    let left = widths.event.saturating_sub(draw::text_width(&news));
    let mut spans = vec![Span::raw(news)];
    if !row.unchanged.is_empty() {
        let blank = match (row.value.is_empty(), widths.object) {
            (false, _) => " | ",
            (true, 0) => " ",
            (true, _) => "",
        };
        let rest = fit_text(&format!("{blank}{}", row.unchanged), left, &core.theme);
        spans.push(Span::styled(rest, core.theme.role_style(TextRole::Quiet)));
    }
    Line::from(spans)
}

/// A node; of a pair without room the receiver.
fn node_text(who: &str, width: u16) -> String {
    let receiver = who.find('→').and_then(|at| who.get(at..)).filter(|_| draw::text_width(who) > width);
    receiver.unwrap_or(who).to_owned()
}

/// Text of a cell.
pub(super) fn cell_text<'a>(
    core: &UiState,
    row: &'a EventRow,
    before: Option<&EventRow>,
    column: usize,
) -> Cow<'a, str> {
    match column {
        SEVERITY => severity_mark(core, row).map_or("", |(letter, _)| letter).into(),
        NUMBER if row.event.frames.last == 0 => "".into(),
        NUMBER => row.event.frames.last.to_string().into(),
        TIME => common::display_time(core, row.event.time).into(),
        DELTA => match (row.event.time, before.and_then(|before| before.event.time)) {
            (Some(time), Some(before)) => format_seconds(time.since(before)).into(),
            _ => "".into(),
        },
        BUS => row.bus.as_str().into(),
        ID => row.id().map_or(Cow::Borrowed(""), |id| id.to_string().into()),
        NODE => row.who.as_str().into(),
        KIND => row.kind.into(),
        OBJECT => row.object.as_str().into(),
        DATA => row.data_text().into(),
        _ => row.value.as_str().into(),
    }
}

/// Letter and role of the worst finding about an event, else of its tone.
pub(super) fn severity_mark(core: &UiState, row: &EventRow) -> Option<(&'static str, TextRole)> {
    if matches!(row.event.kind, EventKind::CanError(error) if !error.is_only_counters()) {
        return Some(("x", TextRole::Bad));
    }
    if let Some(severity) = of_findings(core, row) {
        return Some((severity_letter(severity), common::severity_role(severity)));
    }
    match row.tone {
        LineTone::Bad => Some((severity_letter(Severity::Error), TextRole::Bad)),
        LineTone::Caution => Some((severity_letter(Severity::Warning), TextRole::Caution)),
        LineTone::Plain | LineTone::Quiet | LineTone::Good => None,
    }
}

const fn severity_letter(severity: Severity) -> &'static str {
    match severity {
        Severity::Error => "E",
        Severity::Warning => "w",
        Severity::Note => "n",
    }
}

/// Severity of the worst finding with evidence in the frame of an event. A finding about another kind of
/// event of this frame is not about this one.
fn of_findings(core: &UiState, row: &EventRow) -> Option<Severity> {
    let frame = row.spot.frame;
    let survey = core.timeline.survey();
    let from = survey.places.partition_point(|place| place.frame < frame);
    let places = survey.places.iter().skip(from).take_while(|place| place.frame == frame);
    let rows = core.shown_rows();
    let from = rows.partition_point(|row| row.spot.frame < frame);
    let kinds = || rows.iter().skip(from).take_while(|row| row.spot.frame == frame).map(|row| row.kind);
    let is_about = |id: u64| {
        let news = survey.overview.opened.iter().find(|opened| opened.news.id == id);
        let word = news.map_or("", |opened| opened.news.word);
        word == row.kind || kinds().all(|kind| kind != word)
    };
    places.filter(|place| is_about(place.id)).map(|place| place.severity).max()
}
