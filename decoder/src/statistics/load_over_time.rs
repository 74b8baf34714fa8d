//! Bus load over time in a bounded number of steps.

use super::frame_bits;
use crate::frame::Frame;

/// Initial length of a step, in ns.
const FIRST_STEP: i64 = 100_000_000;

/// Maximum number of steps; beyond it pairs of steps are merged.
const MOST_STEPS: i64 = 4_096;

/// Traffic of one step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LoadStep {
    /// Number of frames.
    pub frames: u64,
    /// Bits on the wire including stuff bits; CAN FD frames and error frames are not counted.
    pub bits: u64,
    /// Number of error frames.
    pub errors: u64,
}

/// Frames, bits and error frames per step.
#[derive(Debug, Clone)]
pub struct LoadOverTime {
    start: Option<i64>,
    step: i64,
    steps: Vec<LoadStep>,
}

impl Default for LoadOverTime {
    fn default() -> Self {
        Self { start: None, step: FIRST_STEP, steps: Vec::new() }
    }
}

impl LoadOverTime {
    /// Counts a frame. A timestamp before the first one counts in the first step.
    pub fn count_frame(&mut self, frame: &Frame) {
        let Some(time) = frame.time else { return };
        let start = *self.start.get_or_insert(time.0);
        let since = time.0.saturating_sub(start).max(0);
        while since / self.step >= MOST_STEPS {
            self.merge_steps();
        }
        let place = usize::try_from(since / self.step).unwrap_or(0);
        if self.steps.len() <= place {
            self.steps.resize(place + 1, LoadStep::default());
        }
        if let Some(step) = self.steps.get_mut(place) {
            step.frames += 1;
            step.bits += u64::from(frame_bits(frame).unwrap_or(0));
            step.errors += u64::from(frame.reports_error());
        }
    }

    fn merge_steps(&mut self) {
        self.step = self.step.saturating_mul(2);
        let pair = |pair: &[LoadStep]| {
            pair.iter().fold(LoadStep::default(), |sum, step| LoadStep {
                frames: sum.frames + step.frames,
                bits: sum.bits + step.bits,
                errors: sum.errors + step.errors,
            })
        };
        self.steps = self.steps.chunks(2).map(pair).collect();
    }

    /// Start of the first step, in ns.
    pub fn start(&self) -> Option<i64> {
        self.start
    }

    /// Length of a step, in ns.
    pub fn step(&self) -> i64 {
        self.step
    }

    /// The steps in time order.
    pub fn steps(&self) -> &[LoadStep] {
        &self.steps
    }

    /// Traffic in the `width` ns up to a time, scaled from whole steps.
    pub fn load_before(&self, time: i64, width: i64) -> LoadStep {
        let count = (width / self.step).max(1);
        let at =
            |back: i64| self.step_at(time.saturating_sub(back.saturating_mul(self.step))).unwrap_or_default();
        let sum = (0..count).map(at).fold(LoadStep::default(), |sum, step| LoadStep {
            frames: sum.frames + step.frames,
            bits: sum.bits + step.bits,
            errors: sum.errors + step.errors,
        });
        let share = |value: u64| {
            let whole = count.saturating_mul(self.step).unsigned_abs().max(1);
            u64::try_from(u128::from(value) * u128::from(width.unsigned_abs()) / u128::from(whole))
                .unwrap_or(u64::MAX)
        };
        LoadStep { frames: share(sum.frames), bits: share(sum.bits), errors: share(sum.errors) }
    }

    /// The step that contains a time.
    pub fn step_at(&self, time: i64) -> Option<LoadStep> {
        let since = time.checked_sub(self.start?).filter(|since| *since >= 0)?;
        self.steps.get(usize::try_from(since / self.step).ok()?).copied()
    }
}

#[cfg(test)]
mod tests {
    use crate::frame::{CanId, Timestamp};

    use super::*;

    #[test]
    fn steps_grow_when_there_are_too_many() {
        let mut load = LoadOverTime::default();
        for second in 0..1_000 {
            let frame = Frame {
                time: Some(Timestamp(second * 1_000_000_000)),
                ..Frame::data_frame(CanId::from_standard(0x555), &[])
            };
            load.count_frame(&frame);
        }
        // 999 s need 2,498 steps of 400 ms, after 100 and 200 ms.
        assert_eq!((load.step(), load.steps().len()), (400_000_000, 2_498));
        assert_eq!(load.steps().iter().map(|step| step.frames).sum::<u64>(), 1_000);
        assert_eq!(load.step_at(10_000_000_000).map(|step| step.bits), Some(48));
        assert_eq!(load.step_at(-1), None);
    }
}
