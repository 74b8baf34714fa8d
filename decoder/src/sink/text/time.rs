//! The time column.

use jiff::tz::TimeZone;

use crate::frame::Timestamp;

/// What the time column shows, as candump's `-t`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeColumn {
    /// `z`: seconds since the first frame.
    #[default]
    Zero,
    /// `a`: seconds as recorded.
    Absolute,
    /// `d`: seconds since the line before.
    Delta,
    /// `A`: date and time, UTC.
    Date,
}

/// Turns times into the column.
#[derive(Debug, Clone)]
pub(super) struct Clock {
    style: TimeColumn,
    first: Option<Timestamp>,
    last: Option<Timestamp>,
}

impl Clock {
    pub(super) fn new(style: TimeColumn) -> Self {
        Self { style, first: None, last: None }
    }

    /// The first time seen is the zero of the column.
    pub(super) fn see(&mut self, time: Option<Timestamp>) {
        if self.first.is_none() {
            self.first = time;
        }
    }

    /// The column of a line that is printed; equally wide from line to line.
    pub(super) fn column(&mut self, time: Option<Timestamp>) -> String {
        let Some(time) = time else { return "        –".into() };
        let before = self.last.replace(time);
        match self.style {
            TimeColumn::Zero => seconds(time.since(self.first.unwrap_or(time)), 3, 9),
            TimeColumn::Delta => seconds(time.since(before.unwrap_or(time)), 6, 11),
            TimeColumn::Absolute => seconds(time.0, 6, 17),
            TimeColumn::Date => date(time),
        }
    }
}

fn seconds(nanoseconds: i64, digits: u32, width: usize) -> String {
    let sign = if nanoseconds < 0 { "-" } else { "" };
    let unit = 10_u64.pow(9 - digits.min(9));
    let rounded = nanoseconds.unsigned_abs() / unit;
    let per_second = 10_u64.pow(digits.min(9));
    let digits = digits as usize;
    format!("{:>width$}", format!("{sign}{}.{:0digits$}", rounded / per_second, rounded % per_second))
}

fn date(time: Timestamp) -> String {
    let zoned = jiff::Timestamp::from_nanosecond(i128::from(time.0)).map(|time| time.to_zoned(TimeZone::UTC));
    zoned.map_or_else(|_| time.to_string(), |zoned| zoned.strftime("%Y-%m-%d %H:%M:%S%.6f").to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Timestamp = Timestamp(1_436_516_252_249_713_000);

    fn columns(style: TimeColumn) -> Vec<String> {
        let mut clock = Clock::new(style);
        clock.see(Some(START));
        [START, START.plus(1_234_567_000)].map(|time| clock.column(Some(time))).to_vec()
    }

    #[test]
    fn the_four_styles() {
        assert_eq!(columns(TimeColumn::Zero), ["    0.000", "    1.234"]);
        assert_eq!(columns(TimeColumn::Delta), ["   0.000000", "   1.234567"]);
        assert_eq!(columns(TimeColumn::Absolute), ["1436516252.249713", "1436516253.484280"]);
        assert_eq!(columns(TimeColumn::Date)[0], "2015-07-10 08:17:32.249713");
    }

    #[test]
    fn a_time_before_the_first_is_negative() {
        let mut clock = Clock::new(TimeColumn::Zero);
        clock.see(Some(START));
        assert_eq!(clock.column(Some(START.plus(-1_500_000_000))), "   -1.500");
    }
}
