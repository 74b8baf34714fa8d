//! Frames and bits on the bus: in total, and in the busiest second.

/// Step of the sliding window in ns; the window has `PARTS` steps, that is 1 s.
const PART: i64 = 100_000_000;
const PARTS: i64 = 10;

/// Bus load.
#[derive(Debug, Clone, Default)]
pub struct BusLoad {
    /// Number of frames.
    pub frames: u64,
    /// Bits on the wire including stuffing, without FD and error frames.
    pub bits: u64,
    /// Those of [`Self::worst_frames`] and [`Self::worst_bits`] before the current step. Within a step the window only
    /// grows, so that its last value is the largest.
    worst: ((u64, i64), (u64, i64)),
    parts: [(u64, u64); 10],
    window: (u64, u64),
    /// Number of the current step.
    part: i64,
    /// Index of the current step in `parts`.
    part_index: usize,
    /// End of the current step, in corrected time.
    part_end: i64,
    first: i64,
    last: Option<i64>,
    /// Correction of timestamps after the clock was set back, so that frames do not accumulate in one second.
    offset: i64,
}

impl BusLoad {
    /// Counts a frame of `bits` at `time`.
    pub(super) fn count_bits(&mut self, bits: u32, time: Option<i64>) {
        let bits = u64::from(bits);
        let Some(time) = time else {
            self.frames += 1;
            self.bits += bits;
            return;
        };
        if !self.continues_at(time) {
            self.move_to(time);
        }
        self.add_many((1, bits));
    }

    /// Advances to the time of a frame, if it is in the same part of a second as the last one.
    #[inline]
    pub(super) fn continues_at(&mut self, time: i64) -> bool {
        let now = time.saturating_add(self.offset);
        let continues = self.last.is_some_and(|last| (last..self.part_end).contains(&now));
        if continues {
            self.last = Some(now);
        }
        continues
    }

    /// Adds frames and bits at the present time.
    #[inline]
    pub(super) fn add_many(&mut self, (frames, bits): (u64, u64)) {
        self.frames += frames;
        self.bits += bits;
        if let Some(part) = self.parts.get_mut(self.part_index) {
            *part = (part.0 + frames, part.1 + bits);
        }
        self.window = (self.window.0 + frames, self.window.1 + bits);
    }

    /// Maximum number of frames in one second, and its start in ns.
    pub fn worst_frames(&self) -> (u64, i64) {
        let (frames, _) = self.worst;
        if self.window.0 > frames.0 { (self.window.0, self.window_start()) } else { frames }
    }

    /// Maximum number of bits in one second, and its start in ns.
    pub fn worst_bits(&self) -> (u64, i64) {
        let (_, bits) = self.worst;
        if self.window.1 > bits.0 { (self.window.1, self.window_start()) } else { bits }
    }

    /// Start of the window.
    fn window_start(&self) -> i64 {
        (self.part - PARTS + 1).saturating_mul(PART).saturating_sub(self.offset).max(self.first)
    }

    /// Moves the window to `time`.
    #[cold]
    fn move_to(&mut self, time: i64) {
        self.worst = (self.worst_frames(), self.worst_bits());
        let Some(last) = self.last else {
            (self.last, self.first) = (Some(time), time);
            return self.set_part(time.div_euclid(PART));
        };
        let mut now = time.saturating_add(self.offset);
        if now < last {
            self.offset = last.saturating_sub(time);
            self.first = self.first.min(time);
            now = last;
        }
        self.last = Some(now);
        let part = now.div_euclid(PART);
        for step in 1..=part.saturating_sub(self.part).clamp(0, PARTS) {
            if let Some(old) = self.parts.get_mut(index_of(self.part.saturating_add(step))) {
                self.window = (self.window.0.saturating_sub(old.0), self.window.1.saturating_sub(old.1));
                *old = (0, 0);
            }
        }
        self.set_part(part);
    }

    fn set_part(&mut self, part: i64) {
        self.part = part;
        self.part_index = index_of(part);
        self.part_end = part.saturating_add(1).saturating_mul(PART);
    }
}

fn index_of(part: i64) -> usize {
    usize::try_from(part.rem_euclid(PARTS)).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Load of frames of 48 bits at the given times in ms.
    fn load(milliseconds: impl Iterator<Item = i64>) -> BusLoad {
        let mut load = BusLoad::default();
        for time in milliseconds {
            load.count_bits(48, Some(time * 1_000_000));
        }
        load
    }

    #[test]
    fn the_worst_second_may_begin_anywhere() {
        // Four frames from 0.5 to 1.4 s.
        let found = load([0, 500, 1_200, 1_300, 1_400, 2_500].into_iter());
        assert_eq!((found.frames, found.bits), (6, 6 * 48));
        assert_eq!(found.worst_frames(), (4, 500_000_000));
        assert_eq!(found.worst_bits(), (4 * 48, 500_000_000));
        // A second does not start before the first frame.
        assert_eq!(load([7_350, 7_360].into_iter()).worst_frames(), (2, 7_350_000_000));
    }

    #[test]
    fn a_clock_set_back_does_not_pile_frames_up() {
        let steady = (0..50).chain(0..50).map(|second| second * 1_000);
        assert_eq!(load(steady).worst_frames().0, 2);
        assert_eq!(load([i64::MIN / 1_000_000, i64::MAX / 1_000_000].into_iter()).frames, 2);
    }
}
