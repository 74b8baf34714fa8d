//! Time of the ring: the timestamps of the frames without the steps of their clock.
//!
//! ```text
//! timestamps   10:00:00  10:00:01  09:30:02  09:30:03      set back by half an hour
//! ring time    10:00:00  10:00:01  10:00:01  10:00:02
//! ```
//! Without steps it is equal to the timestamps, also where they are slightly out of order.

use cobscope_decoder::capture::Notice;
use cobscope_decoder::frame::Timestamp;

/// Smallest backward step of a clock, in ns. Frames of several sources can be out of order by less.
const BACKWARD: i64 = 1_000_000_000;

/// Delay of frames that are not yet missing, in ns: text over a network can stop for a while.
const DELAY: i64 = 10_000_000_000;

/// Clock of the ring.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RingClock {
    /// Difference between ring time and timestamps, in ns.
    offset: i64,
    /// Latest ring time of an item; None before the first item with a time.
    now: Option<i64>,
    /// Ring time up to which no frame arrived. Delayed frames can still be earlier.
    silent_until: Option<i64>,
}

impl RingClock {
    /// Latest ring time in ns.
    pub(super) fn now(&self) -> i64 {
        self.now.unwrap_or(0)
    }

    /// Ring time up to which all frames or none arrived, in ns.
    pub(super) fn latest_complete(&self) -> i64 {
        self.silent_until.map_or(self.now(), |until| until.max(self.now()))
    }

    /// Ring time before which no further frame is expected, in ns.
    pub(super) fn expected_from(&self) -> i64 {
        let silent = self.silent_until.map(|until| until.saturating_sub(DELAY));
        silent.map_or(self.now(), |until| until.max(self.now()))
    }

    /// Ring time of a timestamp, on the clock as set now.
    pub(super) fn ring_time(&self, time: Timestamp) -> i64 {
        time.0.saturating_add(self.offset)
    }

    /// Ring time of the next frame; a frame without a timestamp has the latest time.
    pub(super) fn frame_time(&mut self, time: Option<Timestamp>) -> i64 {
        let Some(stamp) = time else { return self.now() };
        let mut time = self.ring_time(stamp);
        if let Some(now) = self.now.filter(|now| time < now.saturating_sub(BACKWARD)) {
            self.offset = now.saturating_sub(stamp.0);
            time = now;
        }
        self.now = Some(self.now.map_or(time, |now| now.max(time)));
        self.silent_until = None;
        time
    }

    /// Ring time of the next notice.
    pub(super) fn notice_time(&mut self, notice: &Notice) -> i64 {
        match notice {
            Notice::Link { time, .. } => self.frame_time(Some(*time)),
            Notice::Quiet(time) => {
                let time = self.ring_time(*time);
                self.silent_until = Some(time);
                time
            }
            Notice::ClockSet { time, step, .. } => {
                // Several sources with this clock report the same step; the first report removes it.
                if self.ring_time(*time) > self.now().saturating_add(step / 2) {
                    self.offset = self.offset.saturating_sub(*step);
                }
                self.frame_time(Some(*time))
            }
            _ => self.now(),
        }
    }
}

#[cfg(test)]
mod tests {
    use cobscope_decoder::frame::BusIndex;

    use super::*;

    const SECOND: i64 = 1_000_000_000;

    fn frames(seconds: &[i64]) -> Vec<i64> {
        let mut clock = RingClock::default();
        seconds.iter().map(|second| clock.frame_time(Some(Timestamp(second * SECOND))) / SECOND).collect()
    }

    #[test]
    fn without_steps_it_is_the_timestamp() {
        assert_eq!(frames(&[100, 101, 103, 102, 104]), [100, 101, 103, 102, 104]);
        let mut clock = RingClock::default();
        assert_eq!(clock.frame_time(None), 0);
        assert_eq!([clock.frame_time(Some(Timestamp(7))), clock.frame_time(None)], [7, 7]);
        assert_eq!(clock.ring_time(Timestamp(3)), 3);
    }

    #[test]
    fn a_clock_that_is_set_back_does_not_stop_it() {
        assert_eq!(frames(&[5_000, 5_001, 1_000, 1_001, 1_003]), [5_000, 5_001, 5_001, 5_002, 5_004]);
        assert_eq!(frames(&[i64::MAX / SECOND, 5, 6]).last(), Some(&(i64::MAX / SECOND)));
    }

    #[test]
    fn a_clock_that_is_set_forward_does_not_empty_the_ring() {
        let mut clock = RingClock::default();
        clock.frame_time(Some(Timestamp(10 * SECOND)));
        let set = |second: i64| Notice::ClockSet {
            bus: BusIndex(0),
            time: Timestamp(second * SECOND),
            step: 3_600 * SECOND,
        };
        // Two sources with the same clock.
        assert_eq!(clock.notice_time(&set(3_611)), 11 * SECOND);
        assert_eq!(clock.notice_time(&set(3_612)), 12 * SECOND);
        assert_eq!(clock.frame_time(Some(Timestamp(3_613 * SECOND))), 13 * SECOND);
        assert_eq!(clock.notice_time(&Notice::Quiet(Timestamp(3_614 * SECOND))), 14 * SECOND);
        assert_eq!(clock.ring_time(Timestamp(3_600 * SECOND)), 0);
    }

    #[test]
    fn delayed_frames_are_no_step() {
        let mut clock = RingClock::default();
        clock.frame_time(Some(Timestamp(10 * SECOND)));
        for second in 11..60 {
            assert_eq!(clock.notice_time(&Notice::Quiet(Timestamp(second * SECOND))), second * SECOND);
        }
        assert_eq!([clock.now(), clock.expected_from()], [10 * SECOND, 49 * SECOND]);
        assert_eq!(clock.frame_time(Some(Timestamp(11 * SECOND))), 11 * SECOND);
        assert_eq!([clock.now(), clock.expected_from()], [11 * SECOND, 11 * SECOND]);
    }
}
