//! The adapter's milliseconds on this computer's clock.

use cobscope_decoder::frame::Timestamp;

const MILLISECOND: i64 = 1_000_000;

/// Milliseconds after which an adapter's stamps begin anew (CAN232 manual, command Z)…
const WRAP: i64 = 60_000 * MILLISECOND;

/// …and after which those of firmware begin anew that lets all sixteen bits run.
const LONG_WRAP: i64 = 65_536 * MILLISECOND;

/// So much later than its arrival a frame may seem before a whole wrap is taken off: clocks that drift, and
/// frames that are out of their order.
const AHEAD: i64 = 2_000 * MILLISECOND;

/// How often the adapter's clock is looked at.
const WINDOW: i64 = 10_000 * MILLISECOND;

/// Drift that is made good: more than the stamps' own milliseconds and the jitter of a serial line.
const DRIFT: i64 = 5 * MILLISECOND;

/// Longest step backwards that is held back, so that frames stay in their order.
const ORDER: i64 = 250 * MILLISECOND;

/// Maps stamps to times.
///
/// A frame cannot have been received after it arrived here, so the one that arrived with the least delay
/// tells best how both clocks stand. The first stamp stands for its arrival; one that would be later than
/// its arrival moves all that follow back; and where none of a window's frames arrived without delay, the
/// adapter's clock is slow, and all that follow move forward. Silence of any length does not matter, as a
/// stamp is taken for the last moment before its arrival which it can be.
#[derive(Debug, Clone, Default)]
pub struct StampClock {
    /// Time of the adapter's zero, up to whole wraps; none before the first stamp.
    zero: Option<i64>,
    is_long: bool,
    last: i64,
    window_end: i64,
    least_delay: i64,
}

impl StampClock {
    /// The time of a frame with this stamp that arrived at `arrival`.
    pub fn time(&mut self, milliseconds: u16, arrival: Timestamp) -> Timestamp {
        let stamp = i64::from(milliseconds) * MILLISECOND;
        self.is_long |= stamp >= WRAP;
        let wrap = if self.is_long { LONG_WRAP } else { WRAP };
        let zero = *self.zero.get_or_insert(arrival.0.saturating_sub(stamp));
        let delay = arrival.0.saturating_sub(zero).saturating_sub(stamp).rem_euclid(wrap);
        let delay = if delay > wrap - AHEAD { delay - wrap } else { delay };
        self.watch(zero, delay, arrival.0);
        let time = arrival.0.saturating_sub(delay.max(0));
        let is_before = (0..ORDER).contains(&self.last.saturating_sub(time));
        self.last = if is_before { self.last } else { time };
        Timestamp(self.last)
    }

    /// Moves the adapter's zero where delays show that it is elsewhere.
    fn watch(&mut self, zero: i64, delay: i64, arrival: i64) {
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

    /// Times in milliseconds from the start, of (stamp, arrival in milliseconds from the start).
    fn times(frames: &[(i64, i64)]) -> Vec<i64> {
        let mut clock = StampClock::default();
        let time = |(stamp, arrival): &(i64, i64)| {
            (clock.time(u16::try_from(*stamp).unwrap(), Timestamp(START + arrival * MILLISECOND)).0 - START)
                / MILLISECOND
        };
        frames.iter().map(time).collect()
    }

    #[test]
    fn the_first_stamp_stands_for_its_arrival_and_the_others_keep_their_distance() {
        assert_eq!(times(&[(100, 0), (110, 14), (120, 21), (130, 30)]), [0, 10, 20, 30]);
    }

    #[test]
    fn no_frame_is_later_than_its_arrival_nor_before_the_one_before_it() {
        // The first was 8 ms late, which the second shows: it came 2 ms after it, with 10 ms between them.
        assert_eq!(times(&[(100, 0), (110, 2), (111, 3), (120, 15)]), [0, 2, 3, 12]);
        assert_eq!(times(&[(100, 0), (101, 0)]), [0, 0]);
    }

    #[test]
    fn stamps_begin_anew_each_minute() {
        assert_eq!(times(&[(59_990, 0), (59_999, 9), (0, 10), (40, 55)]), [0, 9, 10, 50]);
        let a_minute: Vec<_> = (0..130).map(|second| (second * 1_000 % 60_000, second * 1_000)).collect();
        assert_eq!(times(&a_minute), (0..130).map(|second| second * 1_000).collect::<Vec<_>>());
    }

    #[test]
    fn firmware_whose_stamps_run_to_65_535_is_recognised() {
        assert_eq!(
            times(&[(59_000, 0), (65_000, 6_000), (464, 7_000), (465, 7_003)]),
            [0, 6_000, 7_000, 7_001]
        );
    }

    #[test]
    fn silence_longer_than_a_wrap_is_none_of_the_stamps_business() {
        // 200,000 ms later: 1,000 + 200,000 - 3 × 60,000 = 21,000.
        assert_eq!(times(&[(1_000, 0), (21_000, 200_004), (21_010, 200_011)]), [0, 200_000, 200_010]);
    }

    #[test]
    fn frames_that_waited_keep_their_times() {
        // Nobody read for 30 s: all arrive at once.
        assert_eq!(times(&[(0, 0), (10, 30_000), (20, 30_000), (30_000, 30_001)]), [0, 10, 20, 30_000]);
    }

    #[test]
    fn a_slow_clock_is_made_good_and_a_fast_one_at_once() {
        // 1 ‰ slow: a second of the adapter takes 1,001 ms. After 60 s it would be 60 ms behind.
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
