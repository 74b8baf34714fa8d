//! Load of a bus over time, in a bounded number of steps.

use cobscope_decoder::frame::{Frame, FrameFlags};
use cobscope_decoder::statistics::frame_bits;

/// Nanoseconds of a step in the beginning.
const FIRST_STEP: i64 = 100_000_000;

/// Steps kept: when there are more, two become one.
const MOST_STEPS: i64 = 4_096;

/// What was on a bus within one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Step {
    /// Frames.
    pub frames: u64,
    /// Bits on the wire with stuffing; FD and error frames are not in it.
    pub bits: u64,
    /// Error frames.
    pub errors: u64,
}

/// Frames, bits and error frames of each step of time.
#[derive(Debug, Clone)]
pub struct LoadOverTime {
    start: Option<i64>,
    step: i64,
    steps: Vec<Step>,
}

impl Default for LoadOverTime {
    fn default() -> Self {
        Self { start: None, step: FIRST_STEP, steps: Vec::new() }
    }
}

impl LoadOverTime {
    /// Takes a frame; one before the first counts as there.
    pub fn add(&mut self, frame: &Frame) {
        let Some(time) = frame.time else { return };
        let start = *self.start.get_or_insert(time.0);
        let since = time.0.saturating_sub(start).max(0);
        while since / self.step >= MOST_STEPS {
            self.halve();
        }
        let place = usize::try_from(since / self.step).unwrap_or(0);
        if self.steps.len() <= place {
            self.steps.resize(place + 1, Step::default());
        }
        if let Some(step) = self.steps.get_mut(place) {
            step.frames += 1;
            step.bits += u64::from(frame_bits(frame).unwrap_or(0));
            step.errors += u64::from(frame.flags.contains(FrameFlags::ERROR));
        }
    }

    fn halve(&mut self) {
        self.step = self.step.saturating_mul(2);
        let pair = |pair: &[Step]| {
            pair.iter().fold(Step::default(), |sum, step| Step {
                frames: sum.frames + step.frames,
                bits: sum.bits + step.bits,
                errors: sum.errors + step.errors,
            })
        };
        self.steps = self.steps.chunks(2).map(pair).collect();
    }

    /// Time of the first step, nanoseconds.
    pub fn start(&self) -> Option<i64> {
        self.start
    }

    /// Nanoseconds of a step.
    pub fn step(&self) -> i64 {
        self.step
    }

    /// The steps, in order.
    pub fn steps(&self) -> &[Step] {
        &self.steps
    }

    /// Steps that together make up at least `width` nanoseconds up to a time, taken to that width.
    pub fn over(&self, time: i64, width: i64) -> Step {
        let count = (width / self.step).max(1);
        let at = |back: i64| self.at(time.saturating_sub(back.saturating_mul(self.step))).unwrap_or_default();
        let sum = (0..count).map(at).fold(Step::default(), |sum, step| Step {
            frames: sum.frames + step.frames,
            bits: sum.bits + step.bits,
            errors: sum.errors + step.errors,
        });
        let share = |value: u64| {
            let whole = count.saturating_mul(self.step).unsigned_abs().max(1);
            u64::try_from(u128::from(value) * u128::from(width.unsigned_abs()) / u128::from(whole))
                .unwrap_or(u64::MAX)
        };
        Step { frames: share(sum.frames), bits: share(sum.bits), errors: share(sum.errors) }
    }

    /// The step in which a time lies.
    pub fn at(&self, time: i64) -> Option<Step> {
        let since = time.checked_sub(self.start?).filter(|since| *since >= 0)?;
        self.steps.get(usize::try_from(since / self.step).ok()?).copied()
    }
}

#[cfg(test)]
mod tests {
    use cobscope_decoder::frame::{CanId, Timestamp};

    use super::*;

    #[test]
    fn steps_grow_when_there_are_too_many() {
        let mut load = LoadOverTime::default();
        for second in 0..1_000 {
            let frame = Frame {
                time: Some(Timestamp(second * 1_000_000_000)),
                ..Frame::data_frame(CanId::standard(0x555), &[])
            };
            load.add(&frame);
        }
        // 999 s in 4,096 steps: of 400 ms, after 100 and 200 ms.
        assert_eq!((load.step(), load.steps().len()), (400_000_000, 2_498));
        assert_eq!(load.steps().iter().map(|step| step.frames).sum::<u64>(), 1_000);
        assert_eq!(load.at(10_000_000_000).map(|step| step.bits), Some(48));
        assert_eq!(load.at(-1), None);
    }
}
