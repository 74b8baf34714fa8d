//! Times relative to the first frame, for formats with a start date and relative times only.

use crate::frame::Timestamp;

/// Converts times to times since the start of the capture.
#[derive(Debug)]
pub(super) struct Elapsed {
    unit: i64,
    earliest: i64,
    start: Option<i64>,
    /// Time of the first frame that has one.
    first: Option<i64>,
    last: i64,
}

impl Elapsed {
    /// The start is rounded down to a multiple of `unit` nanoseconds, but is not before `earliest`, in
    /// nanoseconds since 1970.
    pub(super) fn new(unit: i64, earliest: i64) -> Self {
        Self { unit: unit.max(1), earliest, start: None, first: None, last: 0 }
    }

    /// Start in nanoseconds since 1970, if this frame is the first.
    #[inline]
    pub(super) fn start_time(&mut self, time: Option<Timestamp>) -> Option<i64> {
        if self.start.is_some() {
            return None;
        }
        let time = time.unwrap_or_default().0;
        self.start = Some(time.saturating_sub(time.rem_euclid(self.unit)).max(self.earliest));
        self.start
    }

    /// Nanoseconds since the start. A frame without time gets the time of the frame before; a frame earlier
    /// than the first gets the time of the first.
    #[inline]
    pub(super) fn elapsed_since_start(&mut self, time: Option<Timestamp>) -> u64 {
        if let Some(Timestamp(time)) = time {
            self.last = time.max(*self.first.get_or_insert(time));
        }
        let start = self.start.unwrap_or_default();
        u64::try_from(self.last.saturating_sub(start)).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offsets(unit: i64, times: &[Option<i64>]) -> (i64, Vec<u64>) {
        let mut elapsed = Elapsed::new(unit, -10);
        let start = elapsed.start_time(times[0].map(Timestamp)).unwrap();
        assert_eq!(elapsed.start_time(None), None);
        (start, times.iter().map(|time| elapsed.elapsed_since_start(time.map(Timestamp))).collect())
    }

    #[test]
    fn the_start_is_whole_and_times_are_never_before_the_first() {
        assert_eq!(offsets(100, &[Some(250), Some(210), None, Some(900)]), (200, vec![50, 50, 50, 700]));
        assert_eq!(offsets(100, &[None, None, Some(40), Some(30)]), (0, vec![0, 0, 40, 40]));
        assert_eq!(offsets(1, &[Some(-20), Some(-9), Some(5)]), (-10, vec![0, 1, 15]));
        assert_eq!(offsets(1, &[None, Some(-5), Some(i64::MAX)]), (0, vec![0, 0, i64::MAX as u64]));
    }
}
