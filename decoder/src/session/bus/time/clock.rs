//! Monotonic time of one bus, derived from the timestamps, and silences of the bus.

use crate::event::FrameRange;
use crate::frame::Timestamp;

/// Max backward step treated as jitter: time stops until the timestamps catch up. After a larger step, the
/// clock was set, and time continues from its present value.
const JITTER: i64 = 1_000_000_000;

/// Equal intervals after which timestamps are treated as synthetic. Rules on whole captures require more.
const MADE_UP: u32 = 256;

/// Frames after which older gaps are forgotten.
const WINDOW: u32 = 1_024;

/// Multiple of the longest recent gap between two frames above which a gap may be a silence of the whole bus.
const UNUSUAL: i64 = 10;

/// Min gap that may be a silence, in ns: capturing interfaces deliver frames in bursts.
const SHORTEST_SILENCE: i64 = 10_000_000;

/// Monotonic time, and gaps of the traffic.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct BusClock {
    last_stamp: Option<i64>,
    offset: i64,
    now: i64,
    /// Time of the last frame; `now` can be later.
    received: i64,
    /// `now` and `received` are the last timestamp with its offset, and intervals between timestamps have varied.
    is_regular: bool,
    gaps: TrafficGaps,
    steps: IntervalSteps,
}

/// First intervals between timestamps. If all are equal, the recorder made them up: no time limits apply.
#[derive(Debug, Clone, Default)]
struct IntervalSteps {
    interval: i64,
    count: u32,
    have_varied: bool,
}

/// Longest gaps between frames, in ns.
#[derive(Debug, Clone, Default)]
struct TrafficGaps {
    longest: i64,
    /// Of the window before.
    before: i64,
    count: u32,
}

/// A gap in the traffic of a bus that may be a hole in the capture, or the absence of the few nodes it has.
#[derive(Debug, Clone, Copy)]
pub(crate) struct AmbiguousGap {
    /// Frame before the gap, and the frame that ends it.
    pub(crate) frames: FrameRange,
    /// Monotonic time of both frames.
    pub(crate) times: (i64, i64),
    /// Duration in ns that made it unusual.
    pub(crate) limit: i64,
}

/// Result of a new timestamp.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct ClockAdvance {
    /// Monotonic time in ns.
    pub(in crate::session) now: i64,
    /// Difference to the previous timestamp in ns, if negative.
    pub(in crate::session) step: Option<i64>,
    /// Time without any frame, in ns, if it is unusually long; `None` otherwise.
    pub(in crate::session) gap: Option<i64>,
}

impl BusClock {
    /// Monotonic time of the next frame, if its timestamp follows the last one within the longest recent gap; `None`
    /// otherwise.
    #[inline]
    pub(in crate::session) fn regular_time(&self, stamp: Timestamp) -> Option<i64> {
        let last = self.last_stamp.filter(|_| self.is_regular)?;
        // A negative gap is a large unsigned number.
        let gap = stamp.0.checked_sub(last)?.cast_unsigned();
        let is_short = gap <= self.gaps.longest.cast_unsigned();
        // Times that saturate are not regular.
        stamp.0.checked_add(self.offset).filter(|_| is_short)
    }

    /// Applies a timestamp for which [`Self::regular_time`] returned `now`.
    #[inline]
    pub(in crate::session) fn advance_regularly(&mut self, stamp: Timestamp, now: i64) {
        self.last_stamp = Some(stamp.0);
        (self.now, self.received) = (now, now);
        self.gaps.count_usual();
    }

    /// Applies the timestamp of the next frame.
    pub(in crate::session) fn advance_to(&mut self, stamp: Timestamp) -> ClockAdvance {
        let advance = self.advance_by(stamp);
        let is_in_step = Some(self.now) == stamp.0.checked_add(self.offset) && self.received == self.now;
        self.is_regular = is_in_step && self.steps.have_varied;
        advance
    }

    #[inline]
    fn advance_by(&mut self, stamp: Timestamp) -> ClockAdvance {
        let Some(last_stamp) = self.last_stamp.replace(stamp.0) else {
            (self.now, self.received) = (stamp.0, stamp.0);
            return ClockAdvance { now: self.now, step: None, gap: None };
        };
        if !self.steps.have_varied {
            self.steps.add_interval(stamp.0.saturating_sub(last_stamp));
        }
        let mut step = None;
        if stamp.0 < last_stamp {
            let difference = stamp.0.saturating_sub(last_stamp);
            if difference < -JITTER {
                self.offset = self.received.saturating_sub(stamp.0);
            }
            step = Some(difference);
        }
        let before = self.received;
        self.received = before.max(stamp.0.saturating_add(self.offset));
        self.now = self.now.max(self.received);
        let gap = self.received.saturating_sub(before);
        ClockAdvance { now: self.now, step, gap: Some(gap).filter(|gap| self.gaps.is_unusual(*gap)) }
    }

    /// Continues from the present time with timestamps that are later by `step` ns.
    pub(in crate::session) fn set_forward(&mut self, step: i64) {
        self.is_regular = false;
        self.offset = self.offset.saturating_sub(step);
    }

    /// Monotonic time of the last frame.
    pub(in crate::session) fn last_frame_time(&self) -> i64 {
        self.received
    }

    /// Gap above which the bus may be silent, in ns.
    pub(in crate::session) fn usual_gap(&self) -> i64 {
        self.gaps.gap_limit()
    }

    /// Makes an unusual gap that was not a silence part of the pattern.
    pub(in crate::session) fn accept_gap(&mut self, gap: i64) {
        self.gaps.accept_gap(gap);
    }

    /// Advances to `stamp` without a frame, at most to `last`: only the next frame shows whether the bus was silent.
    pub(in crate::session) fn advance_without_frame(&mut self, stamp: Timestamp, last: i64) -> i64 {
        self.now = self.now.max(stamp.0.saturating_add(self.offset).min(last));
        self.is_regular = false;
        self.now
    }

    /// Monotonic time in ns.
    pub(in crate::session) fn now(&self) -> i64 {
        self.now
    }

    /// Converts monotonic time to a timestamp of the capture.
    pub(in crate::session) fn stamp_of(&self, time: i64) -> Option<Timestamp> {
        self.last_stamp.map(|_| Timestamp(time.saturating_sub(self.offset)))
    }

    /// Converts a timestamp to monotonic time, at most the present time.
    pub(in crate::session) fn monotonic(&self, stamp: Timestamp) -> i64 {
        stamp.0.saturating_add(self.offset).min(self.now)
    }

    /// Whether frames have timestamps.
    pub(in crate::session) fn has_timestamps(&self) -> bool {
        self.last_stamp.is_some()
    }

    /// Whether all timestamps so far have equal intervals: they are synthetic and not a measurement.
    pub(in crate::session) fn is_made_up(&self) -> bool {
        !self.steps.have_varied && self.steps.count >= MADE_UP
    }
}

impl TrafficGaps {
    fn gap_limit(&self) -> i64 {
        self.longest.max(self.before).saturating_mul(UNUSUAL).max(SHORTEST_SILENCE)
    }

    /// Registers a gap; an unusual one is not part of the pattern.
    #[inline]
    fn is_unusual(&mut self, gap: i64) -> bool {
        let is_unusual = gap > self.longest && gap > self.gap_limit();
        if !is_unusual {
            self.longest = self.longest.max(gap);
        }
        self.count = self.count.wrapping_add(1);
        if self.count.is_multiple_of(WINDOW) && !is_unusual {
            (self.before, self.longest) = (self.longest, 0);
        }
        is_unusual
    }

    /// Registers a gap that is not longer than the longest one.
    #[inline]
    fn count_usual(&mut self) {
        self.count = self.count.wrapping_add(1);
        if self.count.is_multiple_of(WINDOW) {
            (self.before, self.longest) = (self.longest, 0);
        }
    }

    /// Makes an unusual gap part of the pattern.
    fn accept_gap(&mut self, gap: i64) {
        self.longest = self.longest.max(gap);
    }
}

impl IntervalSteps {
    #[cold]
    fn add_interval(&mut self, interval: i64) {
        // Equal timestamps occur in a burst, or without timestamping.
        self.have_varied = interval <= 0 || self.count > 0 && interval != self.interval;
        self.interval = interval;
        self.count = self.count.saturating_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn at(clock: &mut BusClock, milliseconds: i64) -> ClockAdvance {
        clock.advance_to(Timestamp(milliseconds * MS))
    }

    #[test]
    fn small_backward_steps_stop_time_and_large_ones_shift_it() {
        let mut clock = BusClock::default();
        at(&mut clock, 5_000);
        let back = at(&mut clock, 4_990);
        assert_eq!((back.now, back.step), (5_000 * MS, Some(-10 * MS)));
        assert_eq!(at(&mut clock, 5_010).now, 5_010 * MS);
        let set = at(&mut clock, 1_000);
        assert_eq!((set.now, set.step), (5_010 * MS, Some(-4_010 * MS)));
        assert_eq!(at(&mut clock, 1_020).now, 5_030 * MS);
        assert_eq!(clock.stamp_of(5_030 * MS), Some(Timestamp(1_020 * MS)));
    }

    #[test]
    fn a_step_back_of_1_s_is_jitter_and_a_longer_one_is_not() {
        for (stamp, then, now) in [(4_000, 4_500, 5_000), (3_999, 4_499, 5_500)] {
            let mut clock = BusClock::default();
            at(&mut clock, 5_000);
            assert_eq!(at(&mut clock, stamp).now, 5_000 * MS);
            assert_eq!(at(&mut clock, then).now, now * MS);
        }
    }

    #[test]
    fn a_gap_of_more_than_ten_times_the_longest_is_unusual() {
        let mut clock = BusClock::default();
        for index in 0..300 {
            assert_eq!(at(&mut clock, index * 10).gap, None);
        }
        assert_eq!(at(&mut clock, 2_990 + 100).gap, None);
        clock.accept_gap(100 * MS);
        assert_eq!(at(&mut clock, 3_090 + 1_000).gap, None);
        assert_eq!(at(&mut clock, 4_090 + 10_001).gap, Some(10_001 * MS));
    }

    /// A regular timestamp leads to the same state as any other.
    #[test]
    fn regular_frames_give_the_same_clock() {
        let stamps = [0, 5, 12, 13, 13, 20, 19, 21, 27, 2_000, 2_001, 900, 901, 907, 915, 916].into_iter();
        let stamps = stamps.chain((0..2_500).map(|n| 920 + n * 3 + n % 2));
        let (mut clock, mut other) = (BusClock::default(), BusClock::default());
        let mut regular = 0;
        for (number, stamp) in stamps.enumerate() {
            let stamp = Timestamp(stamp * MS);
            if number == 1_000 {
                clock.advance_without_frame(stamp, i64::MAX);
                other.advance_without_frame(stamp, i64::MAX);
            }
            if let Some(now) = clock.regular_time(stamp) {
                clock.advance_regularly(stamp, now);
                regular += 1;
            } else {
                clock.advance_to(stamp);
            }
            other.advance_to(stamp);
            assert_eq!((clock.now, clock.received, clock.offset), (other.now, other.received, other.offset));
            assert_eq!(clock.usual_gap(), other.usual_gap(), "{number}");
        }
        assert!(regular > 2_000, "{regular}");
    }

    #[test]
    fn a_time_that_saturates_is_not_regular() {
        let mut clock =
            BusClock { last_stamp: Some(0), offset: i64::MAX, now: i64::MAX, ..BusClock::default() };
        (clock.received, clock.is_regular, clock.gaps.longest) = (i64::MAX, true, i64::MAX);
        assert_eq!(clock.regular_time(Timestamp(0)), Some(i64::MAX));
        assert_eq!(clock.regular_time(Timestamp(1)), None);
        assert_eq!(clock.advance_to(Timestamp(1)).now, i64::MAX);
    }

    #[test]
    fn old_gaps_are_forgotten() {
        let mut clock = BusClock::default();
        at(&mut clock, 0);
        at(&mut clock, 5);
        at(&mut clock, 50);
        for index in 1..=2_100 {
            at(&mut clock, 50 + index);
        }
        assert_eq!(clock.usual_gap(), 10 * MS);
    }

    #[test]
    fn time_that_passes_without_frames_is_limited() {
        let mut clock = BusClock::default();
        at(&mut clock, 2_990);
        for milliseconds in [3_050, 3_150, 4_000] {
            clock.advance_without_frame(Timestamp(milliseconds * MS), 3_190 * MS);
        }
        assert_eq!(clock.now(), 3_190 * MS);
        clock.advance_without_frame(Timestamp(6_150 * MS), i64::MAX);
        assert_eq!(at(&mut clock, 6_145).now, 6_150 * MS);
    }
}
