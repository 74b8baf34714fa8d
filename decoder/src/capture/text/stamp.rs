//! Times before the content of a line.

use super::columns::{parse_time, time_of_day};
use super::day::TimesOfDay;

/// One second in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// A time as written in a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::capture) enum WrittenTime {
    /// Nanoseconds.
    Seconds(i64),
    /// Nanoseconds since midnight, without a date.
    OfDay(i64),
}

impl WrittenTime {
    /// Parses `(12.5)`, `[12.5]`, `12.5`, or `13:22:10.8857` as a time of day. Whole numbers are not times: their unit is
    /// unknown.
    pub(in crate::capture) fn parse(word: &[u8]) -> Option<Self> {
        let strip = |open: u8, close: u8| match word {
            [first, inner @ .., last] if *first == open && *last == close => Some(inner),
            _ => None,
        };
        let word = strip(b'(', b')').or_else(|| strip(b'[', b']')).unwrap_or(word);
        if word.contains(&b':') {
            return time_of_day(word).map(Self::OfDay);
        }
        word.iter().any(|byte| matches!(byte, b'.' | b',')).then_some(())?;
        parse_time(word, SECOND).map(Self::Seconds)
    }

    /// Nanoseconds, with times of day continued after midnight.
    pub(in crate::capture) fn elapsed(self, days: &mut TimesOfDay) -> i64 {
        match self {
            Self::Seconds(time) => time,
            Self::OfDay(time) => days.elapsed_since_midnight(time),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_a_fraction_or_colons() {
        use WrittenTime::{OfDay, Seconds};
        for (word, expected) in [
            ("(12.5)", Some(Seconds(12_500_000_000))),
            ("[0,25]", Some(Seconds(250_000_000))),
            ("12.5", Some(Seconds(12_500_000_000))),
            ("13:22:10.8857", Some(OfDay(48_130_885_700_000))),
            ("12", None),
            ("(12.5", None),
            ("t123", None),
            ("", None),
        ] {
            assert_eq!(WrittenTime::parse(word.as_bytes()), expected, "{word}");
        }
    }
}
