//! Intervals of one identifier.

use super::regularity::StreamRegularity;

/// Frames after which older intervals are forgotten.
const WINDOW: u32 = 32;

/// Frames of an identifier before its longest interval is known.
const KNOWN: u32 = 3;

/// Intervals of an identifier.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct IdentifierIntervals {
    last: i64,
    longest: i64,
    /// Longest interval of the window before.
    before: i64,
    count: u32,
    regularity: StreamRegularity,
}

impl IdentifierIntervals {
    /// Before the first frame.
    pub(in crate::session) const NEW: Self =
        Self { last: 0, longest: 0, before: 0, count: 0, regularity: StreamRegularity::NEW };

    /// Registers a frame at a monotonic time.
    #[inline]
    pub(in crate::session) fn note_frame(&mut self, now: i64) {
        if self.count != 0 {
            let interval = now.saturating_sub(self.last);
            self.longest = self.longest.max(interval);
            self.regularity.note_interval(interval, now);
        }
        self.last = now;
        self.count = self.count.wrapping_add(1);
        if self.count.is_multiple_of(WINDOW) {
            (self.before, self.longest) = (self.longest, 0);
        }
    }

    /// Missing elements of a periodic message.
    pub(in crate::session) fn regularity(&self) -> StreamRegularity {
        self.regularity
    }

    /// Moves the last frame by `delay` ns, during which all traffic stopped.
    pub(in crate::session) fn postpone_frame(&mut self, delay: i64) {
        self.last = self.last.saturating_add(delay);
    }

    /// Time at which the next frame is missing; `None` if too few frames are known.
    pub(in crate::session) fn due_time(&self) -> Option<i64> {
        let longest = self.longest.max(self.before);
        (self.count >= KNOWN).then(|| self.last.saturating_add(longest).saturating_add(longest / 5))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;

    #[test]
    fn old_intervals_are_forgotten() {
        let mut pulse = IdentifierIntervals::NEW;
        for n in 0..4 {
            pulse.note_frame(n * 1_000 * MS);
        }
        assert_eq!(pulse.due_time(), Some(4_200 * MS));
        for n in 1..=64 {
            pulse.note_frame((3_000 + n * 10) * MS);
        }
        assert_eq!(pulse.due_time(), Some((3_640 + 12) * MS));
    }
}
