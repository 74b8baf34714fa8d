//! The time column.

use jiff::tz::TimeZone;

use crate::ascii::{push_blanks, push_decimal, push_digits, push_padded};
use crate::frame::Timestamp;
use crate::sink::options::TimeColumn;

/// The column of an event without a time, or before the first frame.
const UNKNOWN: &str = "        –";

/// Formats timestamps for the time column.
#[derive(Debug, Clone)]
pub(super) struct Clock {
    style: TimeColumn,
    first: Option<Timestamp>,
    last: Option<Timestamp>,
    /// Second of the cached `date`.
    second: i64,
    date: String,
}

impl Clock {
    pub(super) fn new(style: TimeColumn) -> Self {
        Self { style, first: None, last: None, second: 0, date: String::new() }
    }

    /// Sets the zero of the column at the first timestamp of a frame.
    #[inline]
    pub(super) fn see(&mut self, time: Option<Timestamp>) {
        if self.first.is_none() {
            self.first = time;
        }
    }

    /// Appends the column with constant width.
    pub(super) fn column(&mut self, time: Option<Timestamp>, out: &mut Vec<u8>) {
        let Some(time) = time else { return out.extend_from_slice(UNKNOWN.as_bytes()) };
        let before = self.last.replace(time);
        match self.style {
            TimeColumn::Zero => match self.first {
                Some(first) => seconds::<3>(time.since(first), 9, out),
                None => out.extend_from_slice(UNKNOWN.as_bytes()),
            },
            TimeColumn::Delta => seconds::<6>(time.since(before.unwrap_or(time)), 11, out),
            TimeColumn::Absolute => seconds::<6>(time.0, 17, out),
            TimeColumn::Date => self.date(time, out),
        }
    }

    fn date(&mut self, time: Timestamp, out: &mut Vec<u8>) {
        let second = time.0.div_euclid(1_000_000_000);
        if second != self.second || self.date.is_empty() {
            self.second = second;
            self.date = jiff::Timestamp::from_second(second).map_or_else(
                |_| second.to_string(),
                |time| time.to_zoned(TimeZone::UTC).strftime("%Y-%m-%d %H:%M:%S").to_string(),
            );
        }
        out.extend_from_slice(self.date.as_bytes());
        out.push(b'.');
        push_digits(out, time.0.rem_euclid(1_000_000_000).unsigned_abs() / 1_000, 6);
    }
}

/// Appends nanoseconds as seconds with `DIGITS` decimal places (at most 9), truncated, right-aligned.
fn seconds<const DIGITS: u32>(nanoseconds: i64, width: usize, out: &mut Vec<u8>) {
    let per_second = const { 10_u64.pow(DIGITS) };
    let cut = nanoseconds.unsigned_abs() / const { 10_u64.pow(9 - DIGITS) };
    let (whole, fraction) = (cut / per_second, cut % per_second);
    let width = width.saturating_sub(1 + DIGITS as usize);
    if nanoseconds < 0 {
        let digits = whole.checked_ilog10().map_or(1, |log| log as usize + 1);
        push_blanks(out, width, digits + 1);
        out.push(b'-');
        push_decimal(out, whole);
    } else {
        push_padded(out, whole, width);
    }
    out.push(b'.');
    push_digits(out, fraction, DIGITS as usize);
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Timestamp = Timestamp(1_436_516_252_249_713_000);

    fn column(clock: &mut Clock, time: Timestamp) -> String {
        let mut out = Vec::new();
        clock.column(Some(time), &mut out);
        String::from_utf8(out).unwrap()
    }

    fn columns(style: TimeColumn) -> Vec<String> {
        let mut clock = Clock::new(style);
        clock.see(Some(START));
        [START, START.plus(1_234_567_000)].map(|time| column(&mut clock, time)).to_vec()
    }

    #[test]
    fn the_four_styles() {
        assert_eq!(columns(TimeColumn::Zero), ["    0.000", "    1.234"]);
        assert_eq!(columns(TimeColumn::Delta), ["   0.000000", "   1.234567"]);
        assert_eq!(columns(TimeColumn::Absolute), ["1436516252.249713", "1436516253.484280"]);
        assert_eq!(columns(TimeColumn::Date), ["2015-07-10 08:17:32.249713", "2015-07-10 08:17:33.484280"]);
    }

    /// The state of a link is known before the first frame.
    #[test]
    fn without_a_frame_there_is_no_zero() {
        let mut clock = Clock::new(TimeColumn::Zero);
        assert_eq!(column(&mut clock, START), UNKNOWN);
        clock.see(Some(START.plus(1_000_000_000)));
        assert_eq!(column(&mut clock, START.plus(3_000_000_000)), "    2.000");
    }

    #[test]
    fn a_time_before_the_first_is_negative() {
        let mut clock = Clock::new(TimeColumn::Zero);
        clock.see(Some(START));
        assert_eq!(column(&mut clock, START.plus(-1_500_000_000)), "   -1.500");
        let mut clock = Clock::new(TimeColumn::Date);
        assert_eq!(column(&mut clock, Timestamp(-1_500_000_000)), "1969-12-31 23:59:58.500000");
    }
}
