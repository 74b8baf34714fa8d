//! Maps the timestamps of an adapter, which restart at 0, to the clock of this computer.

use cobscope_decoder::frame::Timestamp;

const MILLISECOND: i64 = 1_000_000;

/// Maximum time by which a frame may seem later than its arrival before a whole wrap is subtracted: clocks
/// drift, and frames may be out of order.
const AHEAD: i64 = 2_000 * MILLISECOND;

/// Interval between two corrections of the clock.
const WINDOW: i64 = 10_000 * MILLISECOND;

/// Minimum drift that is corrected: more than the resolution of the timestamps and the jitter of a serial or USB
/// line.
const DRIFT: i64 = 5 * MILLISECOND;

/// Maximum backward step that is suppressed to keep the frames in order.
const ORDER: i64 = 250 * MILLISECOND;

/// Maps timestamps to times.
///
/// A frame arrives after its reception, so the frame with the shortest delay gives the best relation of the
/// clocks. The first timestamp is set to its arrival. A timestamp later than its arrival moves all later ones
/// back. If all frames of a window were delayed, the clock of the adapter is slow, and all later ones move
/// forward. Silence has no effect, because a timestamp is the latest possible moment before its arrival.
#[derive(Debug, Clone, Default)]
pub struct StampClock {
    /// Time of timestamp 0, except for whole wraps; None before the first timestamp.
    zero: Option<i64>,
    last: i64,
    window_end: i64,
    least_delay: i64,
}

impl StampClock {
    /// Time of a frame with timestamp `stamp` that arrived at `arrival`. Timestamps restart at 0 after `wrap`. Both
    /// are in ns.
    pub fn time_of(&mut self, stamp: i64, wrap: i64, arrival: Timestamp) -> Timestamp {
        let zero = *self.zero.get_or_insert(arrival.0.saturating_sub(stamp));
        let delay = arrival.0.saturating_sub(zero).saturating_sub(stamp).rem_euclid(wrap);
        let delay = if delay > wrap.saturating_sub(AHEAD) { delay.saturating_sub(wrap) } else { delay };
        self.watch_delay(zero, delay, arrival.0);
        let time = arrival.0.saturating_sub(delay.max(0));
        let is_before = (0..ORDER).contains(&self.last.saturating_sub(time));
        self.last = if is_before { self.last } else { time };
        Timestamp(self.last)
    }

    /// Corrects the time of timestamp 0 by the observed delays.
    fn watch_delay(&mut self, zero: i64, delay: i64, arrival: i64) {
        let window = self.window_end.saturating_sub(WINDOW)..self.window_end;
        if delay >= 0 && window.contains(&arrival) {
            self.least_delay = self.least_delay.min(delay);
            return;
        }
        if delay < 0 {
            self.zero = Some(zero.saturating_add(delay));
        } else if self.least_delay > DRIFT {
            self.zero = Some(zero.saturating_add(self.least_delay));
        }
        self.window_end = arrival.saturating_add(WINDOW);
        self.least_delay = delay.max(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: i64 = 1_700_000_000_000 * MILLISECOND;

    /// Times in ms for pairs of timestamp and arrival in ms.
    fn times(frames: &[(i64, i64)]) -> Vec<i64> {
        let mut clock = StampClock::default();
        let time = |(stamp, arrival): &(i64, i64)| {
            let arrival = Timestamp(START + arrival * MILLISECOND);
            (clock.time_of(stamp * MILLISECOND, 60_000 * MILLISECOND, arrival).0 - START) / MILLISECOND
        };
        frames.iter().map(time).collect()
    }

    #[test]
    fn the_first_timestamp_is_its_arrival_and_the_others_keep_their_distance() {
        assert_eq!(times(&[(100, 0), (110, 14), (120, 21), (130, 30)]), [0, 10, 20, 30]);
    }

    #[test]
    fn no_frame_is_later_than_its_arrival_nor_before_the_one_before_it() {
        // The second frame shows that the first was 8 ms late: it arrived 2 ms after it, with 10 ms between
        // the timestamps.
        assert_eq!(times(&[(100, 0), (110, 2), (111, 3), (120, 15)]), [0, 2, 3, 12]);
        assert_eq!(times(&[(100, 0), (101, 0)]), [0, 0]);
    }

    #[test]
    fn stamps_restart_each_minute() {
        assert_eq!(times(&[(59_990, 0), (59_999, 9), (0, 10), (40, 55)]), [0, 9, 10, 50]);
        let a_minute: Vec<_> = (0..130).map(|second| (second * 1_000 % 60_000, second * 1_000)).collect();
        assert_eq!(times(&a_minute), (0..130).map(|second| second * 1_000).collect::<Vec<_>>());
    }

    #[test]
    fn silence_longer_than_a_wrap_is_none_of_the_stamps_business() {
        // 200,000 ms later: 1,000 + 200,000 - 3 × 60,000 = 21,000.
        assert_eq!(times(&[(1_000, 0), (21_000, 200_004), (21_010, 200_011)]), [0, 200_000, 200_010]);
    }

    #[test]
    fn frames_that_waited_keep_their_times() {
        // No read for 30 s: all frames arrive together.
        assert_eq!(times(&[(0, 0), (10, 30_000), (20, 30_000), (30_000, 30_001)]), [0, 10, 20, 30_000]);
    }

    #[test]
    fn a_slow_clock_is_made_good_and_a_fast_one_at_once() {
        // 1 ‰ slow: a second of the adapter takes 1,001 ms, which would be 60 ms after 60 s.
        let slow: Vec<_> = (0..60).map(|second| (second * 1_000, second * 1_001)).collect();
        let found = times(&slow);
        for ((_, arrival), time) in slow.iter().zip(&found) {
            assert!((0..=22).contains(&(arrival - time)), "{arrival}: {time}");
        }
        assert!(found.is_sorted());
        let fast: Vec<_> = (0..60).map(|second| (second * 1_000, second * 999)).collect();
        assert_eq!(times(&fast), fast.iter().map(|(_, arrival)| *arrival).collect::<Vec<_>>());
    }

    #[test]
    fn a_step_of_this_computers_clock_is_followed() {
        for step in [3_600_000, -3_600_000, 1_000, -1_000] {
            let before = (0..30).map(|second| (second * 1_000, second * 1_000));
            let after = (30..60).map(|second| (second * 1_000, second * 1_000 + step));
            let frames: Vec<_> = before.chain(after).collect();
            assert_eq!(times(&frames).last(), Some(&(59_000 + step)), "{step}");
        }
    }
}
