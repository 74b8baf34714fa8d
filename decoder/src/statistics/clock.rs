//! Clock of the recorder: times of frames without its backward steps.
//!
//! ```text
//! stored     1000.0  1000.5    10.0    10.5  1001.0
//! corrected  1000.0  1000.5  1000.5  1001.0  1001.0
//! ```

use crate::frame::{Frame, Timestamp};

/// Longest backward step without a change of the clock: frames of several adapters overtake each other, in ns.
const JITTER: i64 = 1_000_000_000;

/// Longest step of a clock in ns, 100 years: an earlier timestamp follows a damaged one.
const LONGEST: i64 = 100 * 31_557_600 * 1_000_000_000;

/// Maximum number of steps whose frames are known.
const MOST_STEPS: usize = 1_000;

/// Removes backward steps of the clock: times continue at the latest one, until the clock reaches it again.
#[derive(Debug, Clone, Default)]
pub(super) struct RecorderClock {
    /// Latest corrected time, in ns.
    latest: Option<i64>,
    /// Time by which the clock is behind, in ns.
    offset: i64,
    /// First frames from which on an offset applies, in order.
    steps: Vec<(u64, i64)>,
}

impl RecorderClock {
    /// Whether the frames so far need no correction.
    pub(super) fn is_steady(&self) -> bool {
        self.steps.is_empty()
    }

    /// Takes frames without any step; `false`, and none is taken, if there are or were steps.
    pub(super) fn take_steady(&mut self, frames: &[Frame]) -> bool {
        if !self.is_steady() {
            return false;
        }
        let mut latest = self.latest.unwrap_or(i64::MIN);
        for Timestamp(time) in frames.iter().filter_map(|frame| frame.time) {
            if time >= latest {
                latest = time;
            } else if time < latest.saturating_sub(JITTER) {
                return false;
            }
        }
        if latest > i64::MIN {
            self.latest = Some(latest);
        }
        true
    }

    /// Takes a frame; whether the clock was set before it, so that no time across it is known.
    pub(super) fn take_frame(&mut self, frame: &Frame) -> bool {
        let Some(Timestamp(time)) = frame.time else { return false };
        let latest = *self.latest.get_or_insert(time);
        let steps = self.steps.len();
        if self.offset != 0 && time >= latest {
            // The clock was set forward again.
            self.set_offset(frame.number, 0);
        } else if time.saturating_add(self.offset) < latest.saturating_sub(JITTER)
            && latest.saturating_sub(time) <= LONGEST
        {
            self.set_offset(frame.number, latest.saturating_sub(time));
        }
        self.latest = Some(latest.max(time.saturating_add(self.offset)));
        self.steps.len() > steps
    }

    fn set_offset(&mut self, frame: u64, offset: i64) {
        self.offset = offset;
        if self.steps.len() < MOST_STEPS {
            self.steps.push((frame, offset));
        }
    }

    /// Corrected time of a frame.
    pub(super) fn corrected(&self, frame: u64, time: Timestamp) -> Timestamp {
        let step = self.steps_until(frame).checked_sub(1).and_then(|at| self.steps.get(at));
        step.map_or(time, |(_, offset)| time.plus(*offset))
    }

    /// Number of steps up to a frame.
    pub(super) fn steps_until(&self, frame: u64) -> usize {
        // An event without a frame follows the last one.
        let frame = if frame == 0 { u64::MAX } else { frame };
        self.steps.partition_point(|(first, _)| *first <= frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    const MS: i64 = 1_000_000;

    fn frames(milliseconds: &[i64]) -> Vec<Frame> {
        let frame = |(number, time): (u64, &i64)| Frame {
            number,
            time: Some(Timestamp(time * MS)),
            ..Frame::data_frame(CanId::from_standard(0x701), &[5])
        };
        (1..).zip(milliseconds).map(frame).collect()
    }

    fn corrected(milliseconds: &[i64]) -> Vec<i64> {
        let frames = frames(milliseconds);
        let mut clock = RecorderClock::default();
        for frame in &frames {
            clock.take_frame(frame);
        }
        frames.iter().map(|frame| clock.corrected(frame.number, frame.time.unwrap()).0 / MS).collect()
    }

    #[test]
    fn times_continue_after_a_backward_step() {
        let set_back = [1_000_000, 1_000_500, 10_000, 10_500];
        assert_eq!(corrected(&set_back), [1_000_000, 1_000_500, 1_000_500, 1_001_000]);
        let restored = [1_000_000, 1_000_500, 10_000, 10_500, 1_001_000, 1_001_500];
        assert_eq!(corrected(&restored), [1_000_000, 1_000_500, 1_000_500, 1_001_000, 1_001_000, 1_001_500]);
        let twice = [50_000, 10_000, 10_100, 5_000, 5_100];
        assert_eq!(corrected(&twice), [50_000, 50_000, 50_100, 50_100, 50_200]);
    }

    #[test]
    fn a_step_back_of_1_s_is_jitter_and_a_longer_one_is_not() {
        assert_eq!(corrected(&[5_000, 4_000, 5_100]), [5_000, 4_000, 5_100]);
        assert_eq!(corrected(&[5_000, 3_999, 4_099]), [5_000, 5_000, 5_100]);
        let mut clock = RecorderClock::default();
        assert!(clock.take_steady(&frames(&[5_000, 4_000, 5_100])));
        assert!(!clock.take_steady(&frames(&[4_099])));
        assert_eq!(clock.latest, Some(5_100 * MS));
    }
}
