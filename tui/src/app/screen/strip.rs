//! The strip of time: load and marks over the whole capture, on every pane.
//!
//! ```text
//! load ▁▂█ ▂▂▂▂▂▂▂▂▂▂▂▃▂▂▂▂▂▂▄▂▂▂▂▂▂▂▃▂  0 to
//! find ······N············Ewwwwww·······  13.8 s
//! ```

use cobscope_decoder::finding::{CaptureFindings, FindingGroup, Severity};
use cobscope_decoder::frame::Timestamp;
use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use crate::state::UiState;
use crate::theme::{Glyph, TextRole};
use crate::timeline::{LoadOverTime, LoadStep, NmtMoment, SurveyResults};
use crate::widgets::bars::Bars;
use crate::widgets::draw;

/// Width of `load ` and `find `.
const LABEL: u16 = 5;

/// Width of the length of the capture.
const LENGTH: u16 = 10;

/// What a column shows, the most important last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum StripMark {
    Nothing,
    Note,
    /// A command or a state of NMT.
    Nmt,
    ErrorFrame,
    Warning,
    Error,
}

impl StripMark {
    const fn mark_look(self) -> (&'static str, TextRole) {
        match self {
            Self::Nothing => ("", TextRole::Quiet),
            Self::Note => ("n", TextRole::Note),
            Self::Nmt => ("N", TextRole::Note),
            Self::ErrorFrame => ("x", TextRole::Bad),
            Self::Warning => ("w", TextRole::Caution),
            Self::Error => ("E", TextRole::Bad),
        }
    }

    const fn for_severity(severity: Severity) -> Self {
        match severity {
            Severity::Error => Self::Error,
            Severity::Warning => Self::Warning,
            Severity::Note => Self::Note,
        }
    }
}

/// Columns of the capture: start, length and number.
struct StripAxis {
    first: Timestamp,
    length: i64,
    columns: Rect,
}

impl StripAxis {
    fn new(core: &UiState, area: Rect) -> Option<Self> {
        let (first, last) = core.timeline.progress().time_range()?;
        let width = area.width.checked_sub(LABEL + LENGTH).filter(|width| *width > 0)?;
        let columns = Rect { x: area.x + LABEL, width, ..area };
        Some(Self { first, length: last.since(first).max(1), columns })
    }

    /// Column of a time.
    fn column(&self, time: Timestamp) -> u16 {
        let since = i128::from(time.since(self.first).clamp(0, self.length));
        let column = since * i128::from(self.columns.width) / i128::from(self.length);
        u16::try_from(column).unwrap_or(0).min(self.columns.width.saturating_sub(1))
    }

    /// Start of a column.
    fn time(&self, column: u16) -> Timestamp {
        let since = i128::from(self.length) * i128::from(column) / i128::from(self.columns.width.max(1));
        self.first.plus(i64::try_from(since).unwrap_or(self.length))
    }
}

/// Time of a screen column of the strip.
pub(in crate::app) fn time_at(core: &UiState, area: Rect, x: u16) -> Option<Timestamp> {
    let axis = StripAxis::new(core, area)?;
    Some(axis.time(x.saturating_sub(axis.columns.x).min(axis.columns.width.saturating_sub(1))))
}

/// Draws the strip: load and marks, or only the marks if the area has one line.
pub(in crate::app) fn draw_strip(core: &UiState, area: Rect, buf: &mut Buffer) {
    if area.is_empty() {
        return;
    }
    let quiet = core.theme.role_style(TextRole::Quiet);
    let Some(axis) = StripAxis::new(core, area) else {
        let text = if core.timeline.progress().is_complete() { "no timestamps" } else { "reading …" };
        draw::put_text(buf, area.x, area.y, area.width, text, quiet);
        return;
    };
    let survey = core.timeline.survey();
    let marks = area.bottom().saturating_sub(1);
    let length = [format!("{} s", cobscope_decoder::figures::short_seconds(axis.length)), "0 to".to_owned()];
    for (y, text) in (area.y..area.bottom()).rev().zip(length) {
        draw::put_text(buf, axis.columns.right() + 1, y, LENGTH - 1, &text, quiet);
    }
    if area.height > 1 {
        draw::put_text(buf, area.x, area.y, LABEL, "load", quiet);
        let loads = column_loads(&survey, &axis);
        Bars::new(&core.theme, &loads).scale_relative().render(Rect { height: 1, ..axis.columns }, buf);
    }
    draw::put_text(buf, area.x, marks, LABEL, "find", quiet);
    for (column, mark) in (0..).zip(column_marks(&survey, &axis)) {
        let (letter, role) = mark.mark_look();
        let letter = if letter.is_empty() { core.theme.glyph(Glyph::Dot) } else { letter };
        draw::put_text(buf, axis.columns.x + column, marks, 1, letter, core.theme.role_style(role));
    }
    if let Some(time) = core.cursor_time() {
        let x = axis.columns.x + axis.column(time);
        buf.set_style(Rect { x, width: 1, ..area }, core.theme.role_style(TextRole::Cursor));
    }
}

/// The highest load in each column, in bits per second of all buses.
#[expect(clippy::cast_precision_loss, reason = "the height of a bar")]
fn column_loads(survey: &SurveyResults, axis: &StripAxis) -> Vec<f64> {
    let mut loads = vec![0.0; usize::from(axis.columns.width)];
    for bus in &survey.overview.load {
        for (step, begin) in load_steps(bus) {
            // A step may be longer than a column.
            let (from, to) = (axis.column(begin), axis.column(begin.plus(bus.step().saturating_sub(1))));
            let share = step.bits as f64 / bus.step() as f64;
            let columns = loads.get_mut(usize::from(from)..=usize::from(to)).unwrap_or_default();
            for load in columns {
                *load = share.max(*load);
            }
        }
    }
    loads
}

/// The most important mark of each column.
fn column_marks(survey: &SurveyResults, axis: &StripAxis) -> Vec<StripMark> {
    let mut marks = vec![StripMark::Nothing; usize::from(axis.columns.width)];
    let mut put = |time: Timestamp, mark: StripMark| {
        if let Some(place) = marks.get_mut(usize::from(axis.column(time))) {
            *place = mark.max(*place);
        }
    };
    for place in &survey.places {
        if let Some(time) = place.time {
            put(time, StripMark::for_severity(place.severity));
        }
    }
    for NmtMoment { time, .. } in survey.overview.nmt.iter() {
        put(*time, StripMark::Nmt);
    }
    for bus in &survey.overview.load {
        for (_, begin) in load_steps(bus).filter(|(step, _)| step.errors > 0) {
            put(begin, StripMark::ErrorFrame);
        }
    }
    let groups = survey.findings.iter().flat_map(CaptureFindings::reported_groups);
    for group in groups.filter(|group| group.count > kept_occurrences(group)) {
        // Occurrences between the first and the last ones are not kept.
        let between =
            group.first.last().and_then(|at| at.time).zip(group.last.front().and_then(|at| at.time));
        let (from, to) = between.map_or((0, 0), |(from, to)| (axis.column(from), axis.column(to)));
        let columns = marks.get_mut(usize::from(from)..usize::from(to)).unwrap_or_default();
        for mark in columns {
            *mark = StripMark::for_severity(group.severity).max(*mark);
        }
    }
    marks
}

/// Number of kept occurrences.
fn kept_occurrences(group: &FindingGroup) -> u64 {
    u64::try_from(group.first.len() + group.last.len()).unwrap_or(u64::MAX)
}

/// The steps of the load with their start.
fn load_steps(load: &LoadOverTime) -> impl Iterator<Item = (&LoadStep, Timestamp)> {
    let begin = |number: i64| {
        let start = load.start().unwrap_or_default();
        Timestamp(start.saturating_add(number.saturating_mul(load.step())))
    };
    load.steps().iter().zip(0_i64..).map(move |(step, number)| (step, begin(number)))
}
