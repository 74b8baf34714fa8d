//! Intervals of one identifier.

use super::history::{StreamHistory, StreamSilence};
use super::jumps::JUMPING;
use super::regularity::{Irregularity, StreamRegularity};

/// Frames after which older intervals are forgotten.
const WINDOW: u32 = 32;

/// Frames of an identifier before its longest interval is known.
const KNOWN: u32 = 3;

/// Time of a window of frames, in ns, that no usual message reaches: 2 ms per frame.
const DENSE: i64 = 64_000_000;

/// Multiple of the usual frequency that is a burst.
const FAR: i64 = 8;

/// Intervals of an identifier, and changes of its payload. A frame with a usual interval changes only the first fields.
#[derive(Debug, Clone)]
pub(in crate::session) struct IdentifierIntervals {
    last: i64,
    /// Number of the last frame.
    last_frame: u64,
    longest: i64,
    count: u32,
    /// Number of frames up to which `regularity` counts.
    settled: u32,
    regularity: StreamRegularity,
    /// Number of changes of the payload, and time and frame of the last one.
    changes: u32,
    last_change: i64,
    change_frame: u64,
    /// Longest time between two changes.
    longest_change: i64,
    /// Bits of the payload of which a change is a jump.
    jumping: u64,
    first: i64,
    /// Begin of the present window: monotonic time and frame.
    window: (i64, u64),
    /// Longest interval of the window before.
    before: i64,
    /// `None` before the first irregular interval.
    history: Option<Box<StreamHistory>>,
}

/// Changes of the payload of an identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PayloadChanges {
    /// Number of changes.
    pub(crate) count: u32,
    /// Monotonic time of the last change in ns; `i64::MAX` before the first one.
    pub(crate) last: i64,
    /// Number of the frame of the last change.
    pub(crate) frame: u64,
    /// Longest time between two changes in ns.
    pub(crate) longest: i64,
}

impl IdentifierIntervals {
    /// Before the first frame.
    pub(in crate::session) const NEW: Self = Self {
        last: 0,
        last_frame: 0,
        longest: 0,
        count: 0,
        settled: 0,
        regularity: StreamRegularity::NEW,
        changes: 0,
        last_change: i64::MAX,
        change_frame: 0,
        longest_change: 0,
        jumping: JUMPING,
        first: 0,
        window: (0, 0),
        before: 0,
        history: None,
    };

    /// Registers a frame at a monotonic time.
    #[inline]
    pub(in crate::session) fn note_frame(&mut self, now: i64, frame: u64) {
        let interval = now.wrapping_sub(self.last);
        if !self.regularity.is_usual(interval) {
            self.note_other(now, frame);
        } else if interval > self.longest {
            self.longest = interval;
        }
        (self.last, self.last_frame) = (now, frame);
        self.count = self.count.wrapping_add(1);
        if self.count.is_multiple_of(WINDOW) {
            self.end_window(now, frame);
        }
    }

    /// Ends a window of frames: notes whether they were far closer together than those before.
    #[cold]
    fn end_window(&mut self, now: i64, frame: u64) {
        (self.before, self.longest) = (self.longest, 0);
        self.settle(self.count);
        let (start, first_frame) = std::mem::replace(&mut self.window, (now, frame));
        let start = if self.count == WINDOW { self.first } else { start };
        let span = now.saturating_sub(start);
        let known = i64::from(self.count.saturating_sub(WINDOW));
        let mean = start.saturating_sub(self.first).checked_div(known).unwrap_or(0);
        let is_dense = match known {
            0 => span <= DENSE,
            _ => span <= 5 * DENSE && span.saturating_mul(FAR) <= mean.saturating_mul(i64::from(WINDOW)),
        };
        let burst = self.history.as_ref().is_some_and(|history| history.burst().windows > 0);
        let is_dense = is_dense || burst && span <= DENSE;
        if is_dense {
            let begin = (start, first_frame);
            self.history.get_or_insert_default().note_burst(begin, (now, frame), mean);
        }
    }

    /// Registers the first frame, or one after an unusual interval.
    #[cold]
    fn note_other(&mut self, now: i64, frame: u64) {
        if self.count == 0 {
            self.first = now;
            self.settled = 1;
            return self.regularity.begin();
        }
        let interval = now.saturating_sub(self.last);
        self.longest = self.longest.max(interval);
        // Only intervals beyond the longest unit can be usual nevertheless.
        if interval >> 42 != 0 && self.regularity.is_usual_in_units(interval) {
            return;
        }
        if self.settled != self.count {
            self.settle(self.count);
        }
        // The present frame ends an unusual interval.
        self.settled = self.settled.wrapping_add(1);
        if self.regularity.is_silence(interval) {
            let silence = StreamSilence { times: (self.last, now), frames: (self.last_frame, frame) };
            self.history.get_or_insert_default().note_silence(silence);
        }
        let last = (self.last, self.last_frame);
        match self.regularity.note_other(interval, now) {
            Irregularity::Single => {}
            Irregularity::Period { from } => {
                let regular = self.regularity.regular_count();
                self.history.get_or_insert_default().note_change(last, from, regular);
            }
            Irregularity::Split => self.history.get_or_insert_default().note_split(last.0, last.1),
        }
    }

    /// Adds the usual intervals of the frames up to `count`.
    fn settle(&mut self, count: u32) {
        self.regularity.note_usual(count.wrapping_sub(self.settled));
        self.settled = count;
    }

    /// Registers a frame with another payload than the one before, at a monotonic time; `change` are the bits that differ.
    #[inline]
    pub(in crate::session) fn note_change(&mut self, (now, frame): (i64, u64), payload: u64, change: u64) {
        if change & self.jumping != 0 {
            self.note_jump((now, frame), payload, change);
        }
        let interval = now.saturating_sub(self.last_change);
        if interval > self.longest_change {
            self.longest_change = interval;
        }
        self.changes = self.changes.saturating_add(1);
        (self.last_change, self.change_frame) = (now, frame);
    }

    #[cold]
    fn note_jump(&mut self, at: (i64, u64), payload: u64, change: u64) {
        let count = self.count;
        let history = self.history.get_or_insert_default();
        history.jumps.note_jump((payload, change), count, at);
        self.jumping = history.jumps.jumping_bits(u64::MAX);
    }

    /// Monotonic times of the first and the last frame.
    pub(in crate::session) fn times(&self) -> (i64, i64) {
        (self.first, self.last)
    }

    /// Number of frames.
    pub(in crate::session) fn count(&self) -> u32 {
        self.count
    }

    /// Longest of the last 32 to 64 intervals in ns.
    pub(in crate::session) fn longest_interval(&self) -> i64 {
        self.longest.max(self.before)
    }

    /// Number of the last frame.
    pub(in crate::session) fn last_frame(&self) -> u64 {
        self.last_frame
    }

    /// Irregular intervals; `None` without any.
    pub(in crate::session) fn history(&self) -> Option<&StreamHistory> {
        self.history.as_deref()
    }

    /// Changes of the payload.
    pub(in crate::session) fn payload_changes(&self) -> PayloadChanges {
        PayloadChanges {
            count: self.changes,
            last: self.last_change,
            frame: self.change_frame,
            longest: self.longest_change,
        }
    }

    /// Missing elements of a periodic message.
    pub(in crate::session) fn regularity(&self) -> StreamRegularity {
        let mut regularity = self.regularity;
        regularity.note_usual(self.count.wrapping_sub(self.settled));
        regularity
    }

    /// Moves the last frame by `delay` ns, during which all traffic stopped.
    pub(in crate::session) fn postpone_frame(&mut self, delay: i64) {
        self.last = self.last.saturating_add(delay);
    }

    /// Time at which the next frame is missing; `None` if too few frames are known.
    pub(in crate::session) fn due_time(&self) -> Option<i64> {
        let longest = self.longest_interval();
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
            pulse.note_frame(n * 1_000 * MS, 0);
        }
        assert_eq!(pulse.due_time(), Some(4_200 * MS));
        for n in 1..=64 {
            pulse.note_frame((3_000 + n * 10) * MS, 0);
        }
        assert_eq!(pulse.due_time(), Some((3_640 + 12) * MS));
    }

    /// Counting only irregular frames gives the same as counting each interval.
    #[test]
    fn the_regularity_of_all_intervals() {
        let (mut pulse, mut each) = (IdentifierIntervals::NEW, StreamRegularity::NEW);
        let (mut random, mut now, mut frame): (u64, i64, u64) = (1, 0, 0);
        let counts = |it: StreamRegularity| {
            (it.gap_count(), it.missing_count(), it.silence_count(), it.regular_count(), it.usual_interval())
        };
        for (period, frames) in [(0, 40), (10, 400), (100, 300), (7, 90), (50_000_000, 300), (20, 300)] {
            for _ in 0..frames {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let times = [1, 1, 1, 1, 1, 1, 1, 2, 3, 9];
                let usual = period * times[usize::try_from(random >> 40).unwrap() % times.len()] * MS;
                let interval = usual + i64::try_from(random >> 44 & 0xFFF).unwrap();
                now += interval;
                frame += 1;
                pulse.note_frame(now, frame);
                if frame > 1 && each.is_usual_in_units(interval) {
                    each.note_usual(1);
                } else if frame > 1 {
                    each.note_other(interval, now);
                }
                assert_eq!(counts(pulse.regularity()), counts(each), "frame {frame}");
            }
        }
        assert!(each.gap_count() > 10 && each.regular_count() > 500);
    }
}
