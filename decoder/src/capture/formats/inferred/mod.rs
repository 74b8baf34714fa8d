//! Text without a known format: the layout is inferred from the lines.
//!
//! ```text
//! lines ─token─▶ numbers and words ─proposal, assignment─▶ layouts ─guess─▶ the layout that fits ─row─▶ frames
//! ```
//!
//! No list of programs decides, but agreement over the first lines: bytes whose number equals a length, identifiers,
//! times that rise, words for directions and frame types. This format is tried last. A layout is refused
//! if another one fits as well, since a wrong frame is worse than none.

mod assignment;
mod cells;
mod data_places;
mod facts;
mod guess;
mod layout;
pub(super) mod messages;
mod option;
mod places;
mod proposal;
mod records;
mod row;
mod sample;
#[cfg(test)]
mod tests;
mod time;
mod token;
pub(super) mod words;

use guess::{LayoutGuess, apply_columns, infer_layout};
use layout::Layout;
use records::{RecordLines, clean_line};
use row::RowFault;
use sample::{heading_names, is_heading};
use time::TimeMeaning;
use token::{Tokens, is_ruler};

use super::candump::line::is_around;
use super::excerpt::decisive_lines;
use crate::capture::column_list::{ColumnList, ColumnUnit};
use crate::capture::local_time::{LocalClock, TimeOrigin};
use crate::capture::text::day::TimesOfDay;
use crate::capture::text::line_format::ONLY_BUS;
use crate::capture::text::lines::{LineSplitter, LineStep, is_ellipsis, line_excerpt};
use crate::capture::{
    Batch, BusNames, CaptureError, CaptureFormat, CapturePlace, FormatParser, MAX_BUSES, Notice, ReadOptions,
    TimeUnit,
};
use crate::frame::{BusIndex, Frame, Timestamp};
use crate::words::count_noun;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "columns",
    title: "text with inferred columns",
    is_text: true,
    is_packed: false,
    detect: |head| infer_layout(head).is_some_and(|guess| guess.is_accepted()),
    parser: |options| Box::new(ColumnParser::new(options)),
};

/// Description of the layout that is nearest to a refused text; `None` if no line resembles a frame.
pub(in crate::capture) fn describe_refusal(head: &[u8]) -> Option<String> {
    infer_layout(head).map(|guess| guess.describe_refusal())
}

/// Unit of a column for the unit of `--time-unit`.
fn column_unit(unit: TimeUnit) -> ColumnUnit {
    match unit {
        TimeUnit::Second => ColumnUnit::Seconds,
        TimeUnit::Millisecond => ColumnUnit::Milliseconds,
        TimeUnit::Microsecond => ColumnUnit::Microseconds,
        TimeUnit::Nanosecond => ColumnUnit::Nanoseconds,
    }
}

/// Parser of text whose layout is inferred, or stated by the user.
#[derive(Clone)]
struct ColumnParser {
    stated: Option<ColumnList>,
    /// Unit of times that are numbers, as stated by the user.
    unit: Option<ColumnUnit>,
    is_decided: bool,
    /// `None` if no line can be read.
    layout: Option<Layout>,
    lines: LineSplitter,
    tokens: Tokens,
    buses: BusNames,
    days: TimesOfDay,
    clock: LocalClock,
    records: RecordLines,
    elapsed: i64,
    frames: u64,
    skipped: SkippedText,
}

/// Lines without a frame.
#[derive(Debug, Clone, Default)]
struct SkippedText {
    first: u64,
    count: u64,
}

impl ColumnParser {
    fn new(options: &ReadOptions) -> Self {
        Self {
            stated: options.columns,
            unit: options.time_unit.map(column_unit),
            is_decided: false,
            layout: None,
            lines: LineSplitter::default(),
            tokens: Tokens::default(),
            buses: BusNames::default(),
            days: TimesOfDay::default(),
            clock: LocalClock::new(&options.time_zones),
            records: RecordLines::default(),
            elapsed: 0,
            frames: 0,
            skipped: SkippedText::default(),
        }
    }

    fn decide_layout(&mut self, head: &[u8], batch: &mut Batch) {
        let guess = match &self.stated {
            Some(columns) => apply_columns(head, columns.columns()),
            None => infer_layout(head).filter(LayoutGuess::is_accepted),
        };
        self.is_decided = true;
        let Some(mut guess) = guess else { return };
        if let (Some(unit), Some(form)) = (self.unit, &mut guess.layout.time) {
            form.unit = form.unit.map(|_| unit);
        }
        let text = match &self.stated {
            Some(columns) => format!("columns as stated: {columns}"),
            None => guess.describe(),
        };
        batch.add_notice(Notice::Assumption(text));
        self.records = RecordLines::new(guess.layout.record_start.clone());
        self.layout = Some(guess.layout);
    }

    /// Parses one line, or adds it to the frame that started before it.
    fn parse_line(&mut self, line: &[u8], batch: &mut Batch) {
        let number = self.lines.line_number();
        let text = clean_line(line);
        if text.is_empty() {
            return;
        }
        if !self.records.has_several_lines() {
            return self.parse_row(number, &text, batch);
        }
        if !self.take_mark(number, &text, batch) {
            let mut records = std::mem::take(&mut self.records);
            records.add_line(number, &text, |number, text| self.parse_row(number, text, batch));
            self.records = records;
        }
    }

    /// Counts a line that marks omitted lines, or belongs to the text around a capture; `false` for other lines.
    fn take_mark(&mut self, number: u64, text: &[u8], batch: &mut Batch) -> bool {
        if is_ellipsis(text) {
            let place = CapturePlace::Line(number);
            batch.add_notice(Notice::LostFrames { place, bus: BusIndex::default(), count: None });
            return true;
        }
        let is_mark = is_ruler(text) || is_around(text);
        if is_mark {
            self.skipped.add_line(number);
        }
        is_mark
    }

    fn parse_row(&mut self, number: u64, text: &[u8], batch: &mut Batch) {
        let Some(layout) = self.layout.take() else {
            let reason = format!("no line in the stated columns; found {}", line_excerpt(text));
            return batch.push_unreadable(CapturePlace::Line(number), reason);
        };
        let mut tokens = std::mem::take(&mut self.tokens);
        tokens.split_line(text, layout.dialect);
        match layout.read_row(text, &tokens) {
            Ok(row) => {
                let time = row.time.nanoseconds();
                let time = time.map(|(time, meaning)| (self.convert_time(&layout, time, meaning), meaning));
                self.add_frame(number, time, row.bus.unwrap_or(ONLY_BUS), row.frame, batch);
            }
            Err(_) if self.take_mark(number, text, batch) => {}
            Err(RowFault::Broken(reason)) if !has_names(text, &layout) => {
                let reason = format!("{reason}; found {}", line_excerpt(text));
                batch.push_unreadable(CapturePlace::Line(number), reason);
            }
            Err(RowFault::Broken(_) | RowFault::Text) => self.skipped.add_line(number),
        }
        self.tokens = tokens;
        self.layout = Some(layout);
    }

    fn convert_time(&mut self, layout: &Layout, time: i64, meaning: TimeMeaning) -> i64 {
        if meaning == TimeMeaning::OfDay {
            return self.days.elapsed_since_midnight(time);
        }
        if layout.time.is_some_and(|form| form.is_delta) {
            self.elapsed = self.elapsed.saturating_add(time);
            return self.elapsed;
        }
        time
    }

    fn add_frame(
        &mut self,
        number: u64,
        time: Option<(i64, TimeMeaning)>,
        bus: &[u8],
        frame: Frame,
        batch: &mut Batch,
    ) {
        let Some(bus) = self.buses.index_of(bus) else {
            let reason = format!("more than {MAX_BUSES} buses");
            return batch.push_unreadable(CapturePlace::Line(number), reason);
        };
        self.frames += 1;
        let time = time.map(|(time, meaning)| match meaning {
            TimeMeaning::LocalDate => {
                self.clock.convert_time(time, TimeOrigin::LocalDates, self.buses.name_of(bus), batch)
            }
            TimeMeaning::Universal | TimeMeaning::OfDay => time,
        });
        batch.push(Frame { number: self.frames, time: time.map(Timestamp), bus, ..frame });
    }

    /// Passes a frame on several lines that the capture ends with, and reports the lines of text.
    fn finish(&mut self, batch: &mut Batch) {
        let mut records = std::mem::take(&mut self.records);
        records.finish(|number, text| self.parse_row(number, text, batch));
        self.records = records;
        self.skipped.report_lines(batch);
    }
}

/// Whether a line contains names of columns.
fn has_names(text: &[u8], layout: &Layout) -> bool {
    is_heading(&heading_names(text, layout.dialect))
}

impl SkippedText {
    fn add_line(&mut self, line: u64) {
        if self.count == 0 {
            self.first = line;
        }
        self.count += 1;
    }

    fn report_lines(&mut self, batch: &mut Batch) {
        let Self { first, count } = std::mem::take(self);
        if count > 0 {
            let text = format!("{} without a frame skipped (first: line {first})", count_noun(count, "line"));
            batch.add_notice(Notice::Assumption(text));
        }
    }
}

impl FormatParser for ColumnParser {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        if !self.is_decided {
            let Some(head) = decisive_lines(input, at_end) else { return Ok(0) };
            self.decide_layout(head, batch);
        }
        let mut taken = 0;
        while !batch.is_full() {
            match self.lines.next(input.get(taken..).unwrap_or_default(), at_end) {
                LineStep::Line(line, length) => {
                    self.parse_line(line, batch);
                    taken += length;
                }
                LineStep::Skip(length) => taken += length,
                LineStep::More => break,
            }
        }
        if at_end && taken == input.len() && !batch.is_full() {
            self.finish(batch);
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        &self.buses
    }

    fn line_number(&self) -> Option<u64> {
        Some(self.lines.line_number())
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}
