//! Time of one bus: monotonic, whatever the stamps do, and its silences.

use crate::frame::Timestamp;

/// A backward step below this is jitter between stamps: time stands still until they catch up. A longer
/// one is a clock that was set: time goes on from where it was.
const JITTER: i64 = 1_000_000_000;

/// Periodic messages that make a pattern.
const PATTERN: u32 = 256;

/// Equal intervals between stamps from which they count as made up. Whoever judges a whole capture wants more of them.
const MADE_UP: u32 = 256;

/// Bounds of the silence limit in nanoseconds.
const SHORTEST_SILENCE: i64 = 200_000_000;
const LONGEST_SILENCE: i64 = 10_000_000_000;

/// Monotonic time and the pattern of periodic traffic.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Clock {
    last_stamp: Option<i64>,
    offset: i64,
    now: i64,
    /// Time of the last frame; without frames time may have gone on.
    heard: i64,
    periodic: Periodic,
    steps: Steps,
}

/// The first intervals between stamps: one and the same are made up by the recorder, and no deadline.
#[derive(Debug, Clone, Default)]
struct Steps {
    interval: i64,
    count: u32,
    have_varied: bool,
}

#[derive(Debug, Clone, Default)]
struct Periodic {
    last: i64,
    longest_before: i64,
    longest: i64,
    count: u32,
    limit: Option<i64>,
}

/// What a stamp brings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct Advance {
    /// Monotonic time.
    pub(in crate::session) now: i64,
    /// Stamp less the one before, where negative.
    pub(in crate::session) step: Option<i64>,
    /// Nanoseconds without any frame, where longer than the pattern of periodic traffic allows, and the
    /// limit it went beyond.
    pub(in crate::session) silence: Option<(i64, i64)>,
}

impl Clock {
    /// Takes the stamp of the next frame.
    #[inline]
    pub(in crate::session) fn advance(&mut self, stamp: Timestamp) -> Advance {
        let Some(last_stamp) = self.last_stamp.replace(stamp.0) else {
            (self.now, self.heard) = (stamp.0, stamp.0);
            return Advance { now: self.now, step: None, silence: None };
        };
        if !self.steps.have_varied {
            self.steps.add(stamp.0.saturating_sub(last_stamp));
        }
        let mut step = None;
        if stamp.0 < last_stamp {
            let difference = stamp.0.saturating_sub(last_stamp);
            if difference < -JITTER {
                self.offset = self.heard.saturating_sub(stamp.0);
            }
            step = Some(difference);
        }
        let before = self.heard;
        self.heard = before.max(stamp.0.saturating_add(self.offset));
        self.now = self.now.max(self.heard);
        let gap = self.heard.saturating_sub(before);
        let silence = match self.periodic.limit {
            Some(limit) if gap > limit => {
                // A silence is no pattern: the next interval does not count.
                self.periodic.last = self.now;
                Some((gap, limit))
            }
            _ => None,
        };
        Advance { now: self.now, step, silence }
    }

    /// Time goes on to `stamp` without a frame. It stops where the bus may have fallen silent: only the next frame
    /// tells whether it has.
    pub(in crate::session) fn pass(&mut self, stamp: Timestamp) -> i64 {
        let last = self.periodic.limit.map_or(i64::MAX, |limit| self.heard.saturating_add(limit));
        self.now = self.now.max(stamp.0.saturating_add(self.offset).min(last));
        self.now
    }

    /// How long all traffic may stop before the bus counts as silent; none until its pattern is known.
    pub(in crate::session) fn silence_limit(&self) -> Option<i64> {
        self.periodic.limit
    }

    /// Monotonic time in nanoseconds.
    pub(in crate::session) fn now(&self) -> i64 {
        self.now
    }

    /// Monotonic time as a stamp of the capture's clock.
    pub(in crate::session) fn stamp_of(&self, time: i64) -> Option<Timestamp> {
        self.last_stamp.map(|_| Timestamp(time.saturating_sub(self.offset)))
    }

    /// A stamp as monotonic time, not beyond the present.
    pub(in crate::session) fn monotonic(&self, stamp: Timestamp) -> i64 {
        stamp.0.saturating_add(self.offset).min(self.now)
    }

    /// Whether frames carry times.
    pub(in crate::session) fn runs(&self) -> bool {
        self.last_stamp.is_some()
    }

    /// Whether all stamps so far lie equally far apart: they are made up, and time says nothing.
    pub(in crate::session) fn is_made_up(&self) -> bool {
        !self.steps.have_varied && self.steps.count >= MADE_UP
    }

    /// A message that comes by itself (PDO, SYNC, heartbeat, guarding) was seen now.
    #[expect(clippy::inline_always, reason = "the call alone costs 1 % of a frame")]
    #[inline(always)]
    pub(in crate::session) fn saw_periodic(&mut self) {
        let periodic = &mut self.periodic;
        let interval = self.now.saturating_sub(periodic.last);
        periodic.last = self.now;
        if periodic.count != 0 {
            periodic.longest = periodic.longest.max(interval);
        }
        periodic.count += 1;
        if periodic.count >= PATTERN {
            let longest = periodic.longest.max(periodic.longest_before);
            periodic.limit = Some(longest.saturating_mul(3).clamp(SHORTEST_SILENCE, LONGEST_SILENCE));
            periodic.longest_before = periodic.longest;
            periodic.longest = 0;
            periodic.count = 1;
        }
    }
}

impl Steps {
    #[cold]
    fn add(&mut self, interval: i64) {
        // Stamps that stand still are those of a burst, or of a recorder that has none.
        self.have_varied = interval <= 0 || self.count > 0 && interval != self.interval;
        self.interval = interval;
        self.count = self.count.saturating_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    fn at(clock: &mut Clock, milliseconds: i64) -> Advance {
        clock.advance(Timestamp(milliseconds * MS))
    }

    #[test]
    fn small_backward_steps_stop_time_and_large_ones_shift_it() {
        let mut clock = Clock::default();
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
    fn a_stop_of_periodic_traffic_is_a_silence() {
        let mut clock = Clock::default();
        for index in 0..300 {
            assert_eq!(at(&mut clock, index * 10).silence, None);
            clock.saw_periodic();
        }
        assert_eq!(at(&mut clock, 2_990 + 150).silence, None);
        assert_eq!(at(&mut clock, 6_140).silence, Some((3_000 * MS, 200 * MS)));
    }

    #[test]
    fn time_that_passes_without_frames_is_no_traffic() {
        let mut clock = Clock::default();
        for index in 0..300 {
            at(&mut clock, index * 10);
            clock.saw_periodic();
        }
        for milliseconds in [3_050, 3_150, 4_000] {
            clock.pass(Timestamp(milliseconds * MS));
        }
        assert_eq!((clock.now(), clock.silence_limit()), (3_190 * MS, Some(200 * MS)));
        let woken = at(&mut clock, 6_140);
        assert_eq!((woken.silence, woken.step), (Some((3_150 * MS, 200 * MS)), None));
        clock.pass(Timestamp(6_150 * MS));
        assert_eq!(at(&mut clock, 6_145).now, 6_150 * MS);
    }

    #[test]
    fn without_periodic_traffic_nothing_is_a_silence() {
        let mut clock = Clock::default();
        at(&mut clock, 0);
        assert_eq!(at(&mut clock, 60_000).silence, None);
    }
}
