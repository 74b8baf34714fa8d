//! The time column.

use jiff::tz::TimeZone;

use crate::ascii::{push_blanks, push_decimal, push_digits};
use crate::frame::Timestamp;
use crate::sink::options::TimeColumn;

/// The column of an event without a time, or before the first frame.
const UNKNOWN: &str = "        –";

/// Nanoseconds per second.
const SECOND: i64 = 1_000_000_000;

/// Text of the whole second of the last line, with its decimal point.
#[derive(Debug, Clone)]
struct SecondText {
    /// Start of the second in ns, not negative.
    start: i64,
    text: Vec<u8>,
}

/// Formats timestamps for the time column.
#[derive(Debug, Clone)]
pub(super) struct TimeFormatter {
    style: TimeColumn,
    first: Option<Timestamp>,
    last: Option<Timestamp>,
    whole: Option<SecondText>,
    /// Second of the cached `date`.
    second: i64,
    date: String,
}

impl TimeFormatter {
    pub(super) fn new(style: TimeColumn) -> Self {
        Self { style, first: None, last: None, whole: None, second: 0, date: String::new() }
    }

    /// Sets the zero of the column at the first timestamp of a frame.
    #[inline]
    pub(super) fn note_time(&mut self, time: Option<Timestamp>) {
        if self.first.is_none() {
            self.first = time;
        }
    }

    /// Appends the column with constant width.
    pub(super) fn append_column(&mut self, time: Option<Timestamp>, out: &mut Vec<u8>) {
        let Some(time) = time else { return out.extend_from_slice(UNKNOWN.as_bytes()) };
        let before = self.last.replace(time);
        match self.style {
            TimeColumn::Zero => match self.first {
                Some(first) => append_seconds::<3>(time.since(first), 9, &mut self.whole, out),
                None => out.extend_from_slice(UNKNOWN.as_bytes()),
            },
            TimeColumn::Delta => {
                append_seconds::<6>(time.since(before.unwrap_or(time)), 11, &mut self.whole, out);
            }
            TimeColumn::Absolute => append_seconds::<6>(time.0, 17, &mut self.whole, out),
            TimeColumn::Date => self.append_date(time, out),
        }
    }

    fn append_date(&mut self, time: Timestamp, out: &mut Vec<u8>) {
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

/// Appends nanoseconds as seconds with `DIGITS` decimal places (at most 8), truncated, right-aligned. `whole` is
/// the text of the last call with the same width.
#[inline]
fn append_seconds<const DIGITS: u32>(
    nanoseconds: i64,
    width: usize,
    whole: &mut Option<SecondText>,
    out: &mut Vec<u8>,
) {
    let known = whole.as_ref().map(|whole| (nanoseconds.saturating_sub(whole.start), whole));
    let fraction = match known {
        Some((fraction @ 0..SECOND, whole)) => {
            out.extend_from_slice(&whole.text);
            fraction.unsigned_abs()
        }
        _ => push_whole(nanoseconds, width.saturating_sub(DIGITS as usize), whole, out),
    };
    push_digits(out, fraction / const { 10_u64.pow(9 - DIGITS) }, DIGITS as usize);
}

/// Appends the whole second with its decimal point, right-aligned, and returns the rest in ns.
#[cold]
fn push_whole(nanoseconds: i64, width: usize, whole: &mut Option<SecondText>, out: &mut Vec<u8>) -> u64 {
    let second = SECOND.unsigned_abs();
    let (seconds, rest) = (nanoseconds.unsigned_abs() / second, nanoseconds.unsigned_abs() % second);
    let mut text = Vec::new();
    if nanoseconds < 0 {
        text.push(b'-');
    }
    push_decimal(&mut text, seconds);
    text.push(b'.');
    let digits = text.len();
    push_blanks(&mut text, width, digits);
    text.rotate_left(digits);
    out.extend_from_slice(&text);
    if nanoseconds >= 0 {
        *whole = Some(SecondText { start: nanoseconds.saturating_sub_unsigned(rest), text });
    }
    rest
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: Timestamp = Timestamp(1_436_516_252_249_713_000);

    fn append_column(clock: &mut TimeFormatter, time: Timestamp) -> String {
        let mut out = Vec::new();
        clock.append_column(Some(time), &mut out);
        String::from_utf8(out).unwrap()
    }

    fn columns(style: TimeColumn) -> Vec<String> {
        let mut clock = TimeFormatter::new(style);
        clock.note_time(Some(START));
        [START, START.plus(1_234_567_000)].map(|time| append_column(&mut clock, time)).to_vec()
    }

    #[test]
    fn the_four_styles() {
        assert_eq!(columns(TimeColumn::Zero), ["    0.000", "    1.234"]);
        assert_eq!(columns(TimeColumn::Delta), ["   0.000000", "   1.234567"]);
        assert_eq!(columns(TimeColumn::Absolute), ["1436516252.249713", "1436516253.484280"]);
        assert_eq!(columns(TimeColumn::Date), ["2015-07-10 08:17:32.249713", "2015-07-10 08:17:33.484280"]);
    }

    #[test]
    fn the_text_of_a_second_is_used_within_it_only() {
        let mut clock = TimeFormatter::new(TimeColumn::Zero);
        clock.note_time(Some(START));
        let times = [0, 999_999_999, 1_000_000_000, 12_345_678_901, 11_999_999_999, 12_000_000_000];
        let shown = times.map(|after| append_column(&mut clock, START.plus(after)));
        assert_eq!(shown, ["    0.000", "    0.999", "    1.000", "   12.345", "   11.999", "   12.000"]);
        assert_eq!(append_column(&mut clock, START.plus(-1)), "   -0.000");
        assert_eq!(append_column(&mut clock, START.plus(12_000_000_001)), "   12.000");
        assert_eq!(append_column(&mut clock, START.plus(123_456_000_000_000)), "123456.000");
    }

    /// The state of a link is known before the first frame.
    #[test]
    fn without_a_frame_there_is_no_zero() {
        let mut clock = TimeFormatter::new(TimeColumn::Zero);
        assert_eq!(append_column(&mut clock, START), UNKNOWN);
        clock.note_time(Some(START.plus(1_000_000_000)));
        assert_eq!(append_column(&mut clock, START.plus(3_000_000_000)), "    2.000");
    }

    #[test]
    fn a_time_before_the_first_is_negative() {
        let mut clock = TimeFormatter::new(TimeColumn::Zero);
        clock.note_time(Some(START));
        assert_eq!(append_column(&mut clock, START.plus(-1_500_000_000)), "   -1.500");
        let mut clock = TimeFormatter::new(TimeColumn::Date);
        assert_eq!(append_column(&mut clock, Timestamp(-1_500_000_000)), "1969-12-31 23:59:58.500000");
    }
}
