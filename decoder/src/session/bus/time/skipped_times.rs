//! Times of the last frames of an identifier that had no event.

use crate::frame::Timestamp;

/// Number of frames kept, a power of two.
const KEPT: usize = 8;

/// Times of the last frames without an event. An observer that needs the intervals of an identifier reads them when it
/// needs them.
#[derive(Debug, Clone, Default)]
pub(crate) struct SkippedTimes {
    /// Number of all frames without an event.
    count: u64,
    /// Time and frame of the last ones; frame n is at n modulo [`KEPT`].
    last: [(Timestamp, u64); KEPT],
}

impl SkippedTimes {
    /// Adds a frame.
    #[inline]
    pub(in crate::session) fn push(&mut self, time: Timestamp, frame: u64) {
        if let Some(place) = self.last.get_mut(ring_place(self.count)) {
            *place = (time, frame);
        }
        self.count = self.count.wrapping_add(1);
    }

    /// Number of all frames without an event.
    pub(crate) fn skipped_count(&self) -> u64 {
        self.count
    }

    /// Time and frame of those after the first `seen`, oldest first; at most the last eight.
    pub(crate) fn times_after(&self, seen: u64) -> impl Iterator<Item = (Timestamp, u64)> {
        let first = seen.max(self.count.saturating_sub(KEPT as u64));
        (first..self.count).filter_map(|number| self.last.get(ring_place(number)).copied())
    }
}

#[inline]
fn ring_place(number: u64) -> usize {
    usize::try_from(number % KEPT as u64).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_eight_after_those_seen() {
        let mut times = SkippedTimes::default();
        let frames =
            |times: &SkippedTimes, seen| times.times_after(seen).map(|(_, frame)| frame).collect::<Vec<_>>();
        assert_eq!(frames(&times, 0), [0_u64; 0]);
        for frame in 1..=10 {
            times.push(Timestamp(0), frame);
        }
        assert_eq!(frames(&times, 0), [3, 4, 5, 6, 7, 8, 9, 10]);
        assert_eq!((frames(&times, 8), frames(&times, 10)), (vec![9, 10], vec![]));
        assert_eq!(times.skipped_count(), 10);
    }
}
