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

use pattern::{PATTERNS, Pattern};
use row::Row;

use crate::capture::formats::candump::line::{is_around, without_colors, without_quotes};
use crate::capture::text::day::TimesOfDay;
use crate::capture::text::line_format::{
    Assumptions, Fault, LineFormat, LineParser, ONLY_BUS, ParsedLine, complete_lines,
};
use crate::capture::text::lines::SkippedLines;
use crate::capture::{Batch, BusNames, CaptureError, Format, LARGEST_RECORD, Parser};

pub(super) const FORMAT: Format = Format {
    name: "excerpt",
    title: Rows::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| PATTERNS.iter().any(|pattern| fits(pattern, head)),
    parser: |_| Box::new(Excerpt { rows: LineParser::new(Rows::default()) }),
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
pub(super) fn window(head: &[u8], is_whole: bool) -> Option<&[u8]> {
    match head.get(..LARGEST_RECORD) {
        Some(start) => Some(complete_lines(start)),
        None => is_whole.then_some(head),
    }
}

/// Content of a line.
enum Line<'a> {
    Blank,
    Around,
    Names,
    Text(std::borrow::Cow<'a, [u8]>),
}

fn line(text: &[u8]) -> Line<'_> {
    let quoted = without_quotes(text).trim_ascii();
    if quoted.is_empty() {
        return Line::Blank;
    }
    // A quoted row has the form of a prompt.
    if is_around(quoted) {
        return Line::Around;
    }
    let mut words = quoted.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let is_name = |word: &[u8]| COLUMN_NAMES.iter().any(|name| word.eq_ignore_ascii_case(name.as_bytes()));
    if words.all(is_name) { Line::Names } else { Line::Text(without_colors(quoted)) }
}

fn rows(head: &[u8]) -> impl Iterator<Item = std::borrow::Cow<'_, [u8]>> {
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(head);
    head.split(|byte| matches!(byte, b'\n' | b'\r')).filter_map(|text| match line(text) {
        Line::Text(text) => Some(text),
        Line::Blank | Line::Around | Line::Names => None,
    })
}

/// Whether there are rows, and all fit the pattern.
fn fits(pattern: &Pattern, head: &[u8]) -> bool {
    let mut rows = rows(head).peekable();
    rows.peek().is_some() && rows.all(|row| (pattern.read)(&row).is_some())
}

/// The pattern that most rows fit.
fn best(head: &[u8]) -> Option<&'static Pattern> {
    let count = |pattern: &Pattern| rows(head).filter(|row| (pattern.read)(row).is_some()).count();
    let counted = PATTERNS.iter().rev().map(|pattern| (count(pattern), pattern));
    counted.max_by_key(|(count, _)| *count).filter(|(count, _)| *count > 0).map(|(_, pattern)| pattern)
}

/// Parser of an excerpt.
#[derive(Clone)]
struct Excerpt {
    rows: LineParser<Rows>,
}

/// State that affects later lines.
#[derive(Clone, Default)]
struct Rows {
    /// Set when the first lines are known.
    is_decided: bool,
    pattern: Option<&'static Pattern>,
    times: TimesOfDay,
    around: SkippedLines,
    number: u64,
    bus: Vec<u8>,
}

impl LineFormat for Rows {
    const TITLE: &'static str = "pasted excerpt";

    fn line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut Assumptions,
    ) -> Result<Option<ParsedLine<'a>>, Fault> {
        let row = match line(text) {
            Line::Blank | Line::Names => return Ok(None),
            Line::Around => {
                self.around.add(self.number);
                return Ok(None);
            }
            Line::Text(row) => row,
        };
        let pattern = self.pattern.ok_or("rows of a known pattern expected")?;
        assumptions.report(pattern.note);
        let Row { time, is_time_of_day, bus, frame } =
            (pattern.read)(&row).ok_or("row: expected the pattern of the first lines")?;
        let time = if is_time_of_day { time.map(|time| self.times.elapsed(time)) } else { time };
        self.bus.clear();
        self.bus.extend_from_slice(bus.unwrap_or(ONLY_BUS));
        Ok(Some(ParsedLine::new(time, &self.bus, frame)))
    }

    fn at_line(&mut self, number: u64) {
        self.number = number;
    }
}

impl Parser for Excerpt {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        if !self.rows.format().is_decided {
            let Some(head) = window(input, at_end) else { return Ok(0) };
            let rows = self.rows.format();
            (rows.is_decided, rows.pattern) = (true, best(head));
        }
        let taken = self.rows.parse(input, at_end, batch)?;
        if at_end && taken == input.len() && !batch.is_full() {
            self.rows.format().around.report(batch);
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        self.rows.buses()
    }

    fn line(&self) -> Option<u64> {
        Parser::line(&self.rows)
    }

    fn clone_box(&self) -> Box<dyn Parser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
