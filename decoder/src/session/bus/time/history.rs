//! What became of the period of a message: silences of its sender, changes of the period, elements of a second sender.

use super::jumps::{ByteJumps, ValueJumps};

/// Kept silences and changes of the period; later ones are only counted.
const KEPT: usize = 8;

/// Usual intervals before a change of the period.
const SETTLED: u32 = 20;

/// A silence of one message: two missing elements or more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct StreamSilence {
    /// Monotonic time of the last element before it, and of the first one after it, in ns.
    pub(crate) times: (i64, i64),
    /// Numbers of these frames.
    pub(crate) frames: (u64, u64),
}

impl StreamSilence {
    /// Duration in ns.
    pub(crate) fn duration(&self) -> i64 {
        self.times.1.saturating_sub(self.times.0)
    }
}

/// A change of the usual interval.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PeriodChange {
    /// Monotonic time of the first element of the new period, in ns.
    pub(crate) time: i64,
    /// Number of its frame.
    pub(crate) frame: u64,
    /// Interval before, in ns.
    pub(crate) from: i64,
    /// Number of usual intervals before, since the last change.
    pub(crate) count: u32,
}

/// A time in which a message was sent far too often.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct StreamBurst {
    /// Number of windows of 32 frames.
    pub(crate) windows: u32,
    /// Monotonic time in ns and frame at which it began, and at which it ended.
    pub(crate) began: (i64, u64),
    pub(crate) ended: (i64, u64),
    /// Mean interval before it in ns; 0 for a message that begins with it.
    pub(crate) mean: i64,
}

/// Irregular intervals of one message. Most messages have none.
#[derive(Debug, Clone, Default)]
pub(crate) struct StreamHistory {
    silences: Vec<StreamSilence>,
    changes: Vec<PeriodChange>,
    /// Number of usual intervals at the last change of the period.
    regular: u32,
    /// Elements between two regular ones: another sender with the same period.
    splits: u32,
    /// First element of the other sender: time and frame.
    first_split: (i64, u64),
    burst: StreamBurst,
    pub(super) jumps: ByteJumps,
}

impl StreamHistory {
    pub(super) fn note_silence(&mut self, silence: StreamSilence) {
        if self.silences.len() < KEPT {
            self.silences.push(silence);
        } else if let Some(shortest) =
            self.silences.iter().enumerate().min_by_key(|(_, each)| each.duration())
            && shortest.1.duration() < silence.duration()
        {
            let place = shortest.0;
            self.silences.remove(place);
            self.silences.push(silence);
        }
    }

    /// Notes that an interval other than `from` is usual from a frame on; `regular` is the number of usual intervals up to now.
    pub(super) fn note_change(&mut self, (time, frame): (i64, u64), from: i64, regular: u32) {
        let count = regular.saturating_sub(self.regular);
        self.regular = regular;
        if count >= SETTLED && self.changes.len() < KEPT {
            self.changes.push(PeriodChange { time, frame, from, count });
        }
    }

    pub(super) fn note_burst(&mut self, began: (i64, u64), ended: (i64, u64), mean: i64) {
        let windows = self.burst.windows.saturating_add(1);
        if windows == 1 {
            (self.burst.began, self.burst.mean) = (began, mean);
        }
        (self.burst.windows, self.burst.ended) = (windows, ended);
    }

    /// The time in which the message was sent far too often.
    pub(crate) fn burst(&self) -> StreamBurst {
        self.burst
    }

    pub(super) fn note_split(&mut self, time: i64, frame: u64) {
        if self.splits == 0 {
            self.first_split = (time, frame);
        }
        self.splits = self.splits.saturating_add(1);
    }

    /// A value that jumps, of a payload with so many changes in so many frames.
    pub(crate) fn value_jumps(&self, changes: u32, frames: u32) -> Option<ValueJumps> {
        self.jumps.value(changes, frames)
    }

    /// The longest silences in order of time, at most eight.
    pub(crate) fn silences(&self) -> &[StreamSilence] {
        &self.silences
    }

    /// The first changes of a settled period, at most eight.
    pub(crate) fn changes(&self) -> &[PeriodChange] {
        &self.changes
    }

    /// Number of usual intervals since the last change of the period, of `regular` in all.
    pub(crate) fn present_count(&self, regular: u32) -> u32 {
        regular.saturating_sub(self.regular)
    }

    /// Number of elements of another sender with the same period, and time and frame of the first one.
    pub(crate) fn splits(&self) -> (u32, (i64, u64)) {
        (self.splits, self.first_split)
    }
}
