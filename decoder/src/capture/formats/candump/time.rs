//! Meaning of candump's timestamps.

use crate::capture::TimeStyle;
use crate::frame::Timestamp;

/// Timestamps below this (1973 as Unix time) are relative to the start of the capture, not to 1970.
const RELATIVE_BELOW: i64 = 100_000_000 * 1_000_000_000;

/// Converts timestamps to times.
#[derive(Debug, Clone, Default)]
pub(super) struct CandumpClock {
    style: Option<TimeStyle>,
    elapsed: i64,
    /// Whether the style was inferred from the timestamps.
    is_guess: bool,
}

impl CandumpClock {
    /// Creates a clock with a known style, or with `None` a clock that determines its style.
    pub(super) fn new(style: Option<TimeStyle>) -> Self {
        Self { style, elapsed: 0, is_guess: false }
    }

    /// Whether the style must be determined before `stamp` can be converted.
    pub(super) fn must_decide(&self, stamp: i64) -> bool {
        self.style.is_none() && (0..RELATIVE_BELOW).contains(&stamp)
    }

    /// Treats timestamps as absolute from now on, unless another style is known.
    pub(super) fn settle_absolute(&mut self) {
        self.style.get_or_insert(TimeStyle::Absolute);
    }

    /// Determines the style from the first timestamps: a backward step means that they are differences.
    pub(super) fn decide_style(&mut self, mut stamps: impl Iterator<Item = i64>) {
        let mut last = i64::MIN;
        let falls = stamps.any(|stamp| {
            let falls = stamp < last;
            last = stamp;
            falls
        });
        self.is_guess = falls;
        self.style = Some(if falls { TimeStyle::Delta } else { TimeStyle::Absolute });
    }

    /// Whether timestamps were inferred to be differences since the last call.
    pub(super) fn take_guess(&mut self) -> bool {
        std::mem::take(&mut self.is_guess)
    }

    /// Whether timestamps are absolute, so that no call per timestamp is needed.
    #[inline]
    pub(super) fn is_absolute(&self) -> bool {
        self.style != Some(TimeStyle::Delta)
    }

    /// Converts a timestamp to a time.
    #[inline]
    pub(super) fn convert_stamp(&mut self, stamp: i64) -> Timestamp {
        if self.is_absolute() {
            return Timestamp(stamp);
        }
        self.elapsed = self.elapsed.saturating_add(stamp);
        Timestamp(self.elapsed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn falling_stamps_are_differences() {
        let mut clock = CandumpClock::new(None);
        assert!(clock.must_decide(5));
        clock.decide_style([0, 10, 5].into_iter());
        assert_eq!([0, 10, 5].map(|stamp| clock.convert_stamp(stamp).0), [0, 10, 15]);
    }

    #[test]
    fn rising_stamps_stand_for_themselves() {
        let mut clock = CandumpClock::new(None);
        clock.decide_style([0, 10, 10, 12].into_iter());
        assert_eq!([0, 10, 12].map(|stamp| clock.convert_stamp(stamp).0), [0, 10, 12]);
    }

    #[test]
    fn unix_times_need_no_decision() {
        assert!(!CandumpClock::new(None).must_decide(1_700_000_000_000_000_000));
    }
}
