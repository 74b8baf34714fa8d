//! Excerpts of captures as pasted into issues and mails: rows without the header of their format.
//!
//! ```text
//!       1)      1298.9  Tx         0601  2  40 18          rows of a PEAK TRC capture
//! 67F Tx SD 8 23 14 10 00 00 00 00 00                      identifier, direction, type, length, data
//! 12.250 601: 40 18 10 01                                  time, identifier, data
//! (1700000000.123456) 601#4018100100000000                 candump without interface
//! ```
//!
//! An excerpt is accepted only if every line fits the same pattern; [`pattern`] lists them. Blank lines, Markdown
//! fences, shell prompts, quote marks and one line of column names are allowed around the rows.

mod pattern;
mod row;

use pattern::{ExcerptPattern, PATTERNS};
use row::ExcerptRow;

use crate::capture::formats::candump::line::{is_around, without_colors, without_quotes};
use crate::capture::text::day::TimesOfDay;
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine, complete_lines,
};
use crate::capture::text::lines::{AROUND, SkippedLines, is_ellipsis};
use crate::capture::{Batch, BusNames, CaptureError, CaptureFormat, FormatParser, LARGEST_RECORD};

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "excerpt",
    title: ExcerptRowState::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| PATTERNS.iter().any(|pattern| fits_pattern(pattern, head)),
    parser: |_| Box::new(ExcerptParser { rows: LineParser::new(ExcerptRowState::default()) }),
};

/// Names of columns, in lower case.
const COLUMN_NAMES: &[&str] = &[
    "time",
    "timestamp",
    "offset",
    "id",
    "can-id",
    "can",
    "cob-id",
    "(hex)",
    "(ms)",
    "(s)",
    "[ms]",
    "[s]",
    "[hex]",
    "rx/tx",
    "rx",
    "tx",
    "dir",
    "direction",
    "type",
    "length",
    "len",
    "dlc",
    "data",
    "cycle",
    "count",
    "channel",
    "chn",
    "bus",
    "no",
    "no.",
    "number",
    "message",
    "bytes",
];

/// The lines that decide about the pattern; `None` if more input may follow them.
pub(super) fn decisive_lines(head: &[u8], is_whole: bool) -> Option<&[u8]> {
    match head.get(..LARGEST_RECORD) {
        Some(start) => Some(complete_lines(start)),
        None => is_whole.then_some(head),
    }
}

/// Content of a line.
enum ExcerptLine<'a> {
    Blank,
    Around,
    Names,
    /// A mark of rows that were left out: `...`.
    Ellipsis,
    Text(std::borrow::Cow<'a, [u8]>),
}

fn parse_line(text: &[u8]) -> ExcerptLine<'_> {
    let quoted = without_quotes(text).trim_ascii();
    if quoted.is_empty() {
        return ExcerptLine::Blank;
    }
    if is_ellipsis(quoted) {
        return ExcerptLine::Ellipsis;
    }
    // A quoted row has the form of a prompt.
    if is_around(quoted) {
        return ExcerptLine::Around;
    }
    let mut words = quoted.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let is_name = |word: &[u8]| COLUMN_NAMES.iter().any(|name| word.eq_ignore_ascii_case(name.as_bytes()));
    if words.all(is_name) { ExcerptLine::Names } else { ExcerptLine::Text(without_colors(quoted)) }
}

fn split_rows(head: &[u8]) -> impl Iterator<Item = std::borrow::Cow<'_, [u8]>> {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    head.split(|byte| matches!(byte, b'\n' | b'\r')).filter_map(|text| match parse_line(text) {
        ExcerptLine::Text(text) => Some(text),
        ExcerptLine::Blank | ExcerptLine::Around | ExcerptLine::Names | ExcerptLine::Ellipsis => None,
    })
}

/// Whether there are rows, and all fit the pattern.
fn fits_pattern(pattern: &ExcerptPattern, head: &[u8]) -> bool {
    let mut rows = split_rows(head).peekable();
    rows.peek().is_some() && rows.all(|row| (pattern.read)(&row).is_some())
}

/// The pattern that most rows fit.
fn best_pattern(head: &[u8]) -> Option<&'static ExcerptPattern> {
    let count =
        |pattern: &ExcerptPattern| split_rows(head).filter(|row| (pattern.read)(row).is_some()).count();
    let counted = PATTERNS.iter().rev().map(|pattern| (count(pattern), pattern));
    counted.max_by_key(|(count, _)| *count).filter(|(count, _)| *count > 0).map(|(_, pattern)| pattern)
}

/// Parser of an excerpt.
#[derive(Clone)]
struct ExcerptParser {
    rows: LineParser<ExcerptRowState>,
}

/// State that affects later lines.
#[derive(Clone, Default)]
struct ExcerptRowState {
    /// Set when the first lines are known.
    is_decided: bool,
    pattern: Option<&'static ExcerptPattern>,
    times: TimesOfDay,
    around: SkippedLines,
    number: u64,
    /// Whether rows were left out since the last frame.
    is_gap: bool,
    bus: Vec<u8>,
}

impl LineFormat for ExcerptRowState {
    const TITLE: &'static str = "pasted excerpt";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let row = match parse_line(text) {
            ExcerptLine::Blank | ExcerptLine::Names => return Ok(None),
            ExcerptLine::Ellipsis => {
                self.is_gap = true;
                return Ok(None);
            }
            ExcerptLine::Around => {
                self.around.add_line(AROUND, self.number);
                return Ok(None);
            }
            ExcerptLine::Text(row) => row,
        };
        let pattern = self.pattern.ok_or("rows of a known pattern expected")?;
        assumptions.add_assumption(pattern.note);
        let ExcerptRow { time, is_time_of_day, bus, frame } =
            (pattern.read)(&row).ok_or("row: expected the pattern of the first lines")?;
        let time =
            if is_time_of_day { time.map(|time| self.times.elapsed_since_midnight(time)) } else { time };
        self.bus.clear();
        self.bus.extend_from_slice(bus.unwrap_or(ONLY_BUS));
        let lost = std::mem::take(&mut self.is_gap);
        Ok(Some(ParsedLine { lost, ..ParsedLine::new(time, &self.bus, frame) }))
    }

    fn at_line(&mut self, number: u64) {
        self.number = number;
    }

    fn report_skipped(&mut self, batch: &mut Batch) {
        self.around.report_lines(batch);
    }
}

impl FormatParser for ExcerptParser {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        if !self.rows.format_state().is_decided {
            let Some(head) = decisive_lines(input, at_end) else { return Ok(0) };
            let rows = self.rows.format_state();
            (rows.is_decided, rows.pattern) = (true, best_pattern(head));
        }
        self.rows.parse(input, at_end, batch)
    }

    fn buses(&self) -> &BusNames {
        self.rows.buses()
    }

    fn line_number(&self) -> Option<u64> {
        FormatParser::line_number(&self.rows)
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
