//! Times of rows: the clock of a capture, and the unit that fits a bus.

use super::dialect::CsvTimeFormat;
use super::number::{is_zlg_time, parse_timestamp};
use crate::capture::TimeUnit;
use crate::capture::text::day::TimesOfDay;
use crate::capture::text::line_format::{CaptureAssumptions, ParsedLine};
use crate::frame::{FrameRate, Timestamp};

const OF_DAY: &str = "times of day without a date: times count from the midnight before the first frame";
const ADAPTER: &str = "times of the adapter used: units of 0.1 ms, seconds or time of day";
const NEGATIVE: &str = "dates before 1970 (an overflow of the writer): times count from the first frame";

/// Times below this, before 1967, are not dates: 64 bits of microseconds overflowed in the program.
const NEGATIVE_DATES: i64 = -100_000_000 * 1_000_000_000;

/// Clock of a capture whose rows may have times of the computer and of the adapter: one of them for all rows.
#[derive(Debug, Clone, Default)]
pub(super) struct CsvClock {
    uses: Option<CsvTimeFormat>,
    days: TimesOfDay,
    /// Time in ns that all times count from; `None` before the first one.
    origin: Option<i64>,
}

impl CsvClock {
    /// Whether times of this form are used. The first row decides between the times of ZLG's programs.
    pub(super) fn uses_style(&mut self, style: CsvTimeFormat, text: &[u8]) -> bool {
        match style {
            CsvTimeFormat::ZlgSystem | CsvTimeFormat::ZlgAdapter => {
                is_zlg_time(text) && *self.uses.get_or_insert(style) == style
            }
            _ => !text.is_empty(),
        }
    }

    /// Parses a time into nanoseconds.
    pub(super) fn parse_time(
        &mut self,
        text: &[u8],
        style: CsvTimeFormat,
        assumptions: &mut CaptureAssumptions,
    ) -> Option<i64> {
        let time = parse_timestamp(text, style)?;
        if style == CsvTimeFormat::ZlgAdapter {
            assumptions.add_assumption(ADAPTER);
        }
        let is_of_day = text.contains(&b':');
        if is_of_day && style != CsvTimeFormat::Clock {
            assumptions.add_assumption(OF_DAY);
        }
        if is_of_day {
            return Some(self.days.elapsed_since_midnight(time));
        }
        let origin = *self.origin.get_or_insert(if time < NEGATIVE_DATES { time } else { 0 });
        if origin != 0 {
            assumptions.add_assumption(NEGATIVE);
        }
        Some(time.saturating_sub(origin))
    }
}

/// Units that programs with the form of SavvyCAN write, its own first, and the assumption about another one.
const UNITS: &[(TimeUnit, &str)] = &[
    (TimeUnit::Microsecond, ""),
    (
        TimeUnit::Millisecond,
        "times read as milliseconds: as microseconds, no bus could carry the frames; --time-unit us reads microseconds",
    ),
];

/// Frames of the first rows of each bus, with times in microseconds.
#[derive(Debug, Default)]
pub(super) struct UnitEvidence {
    rates: Vec<(Vec<u8>, FrameRate)>,
}

impl UnitEvidence {
    /// Adds the frame of a row.
    pub(super) fn add_row(&mut self, row: &ParsedLine<'_>) {
        let Some(time) = row.time.map(Timestamp) else { return };
        match self.rates.iter_mut().find(|(bus, _)| bus == row.bus) {
            Some((_, rate)) => rate.add_frame(time, &row.frame),
            None => self.rates.push((row.bus.to_vec(), FrameRate::new(time))),
        }
    }

    /// The shortest unit with which a bus can carry the frames, if it is not a microsecond, and the assumption.
    pub(super) fn other_unit(&self) -> Option<(TimeUnit, &'static str)> {
        let microsecond = TimeUnit::Microsecond.nanoseconds();
        let scale = |unit: TimeUnit| unit.nanoseconds().checked_div(microsecond).unwrap_or(1);
        let fits =
            |(unit, _): &&(TimeUnit, &str)| self.rates.iter().all(|(_, rate)| rate.is_possible(scale(*unit)));
        UNITS.iter().find(fits).filter(|(unit, _)| *unit != TimeUnit::Microsecond).copied()
    }
}
