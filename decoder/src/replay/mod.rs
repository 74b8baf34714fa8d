//! Navigation to any frame of a capture: checkpoints at intervals, and decoding from the checkpoint before
//! the requested frame.
//!
//! ```text
//! frame   0 ────── 262,144 ────── 524,288 ──▶        each mark: position of the reader + clone of the world
//!         mark     mark           mark
//! ```
//!
//! Checkpoints share object stores that did not change between them, so that a checkpoint only needs the
//! memory of the bus state ([`ReplayState::footprint`]).

mod latest;
mod pattern;
mod row;
mod sampling;
pub mod signal;
mod walk;
mod world;

pub use latest::{BootOccurrence, ErrorCode, LatestOccurrences, LatestOfNode};
pub use pattern::RowPattern;
pub use row::{ReplayRow, node_filter};
pub use sampling::{MOST_BUCKETS, SampleBucket, SignalPoints, SignalSampler};
pub use signal::SignalKey;
pub use walk::CaptureWalk;
pub use world::{EarlierPayloads, EventPosition, PlacedEvent, ProblemCounts, ReplayState};

use crate::capture::MergedPosition;
use crate::frame::Timestamp;

/// Frames between two checkpoints.
pub(crate) const INTERVAL: u64 = 262_144;

/// Maximum number of checkpoints: above it, every second one is dropped and the interval is doubled.
pub const MOST_MARKS: usize = 64;

/// A checkpoint from which decoding can resume.
#[derive(Clone)]
pub struct Checkpoint {
    /// Number of frames before the checkpoint.
    pub frames: u64,
    /// Time of the last frame before the checkpoint, if it has one.
    pub time: Option<Timestamp>,
    /// Position at which reading resumes.
    pub position: MergedPosition,
    /// Decoder state at the checkpoint.
    pub world: ReplayState,
}

/// Checkpoints of one capture, in order.
pub struct CheckpointIndex {
    marks: Vec<Checkpoint>,
    interval: u64,
}

impl Default for CheckpointIndex {
    fn default() -> Self {
        Self { marks: Vec::new(), interval: INTERVAL }
    }
}

impl CheckpointIndex {
    /// Creates an index with an initial interval of `interval` frames.
    pub fn with_interval(interval: u64) -> Self {
        Self { marks: Vec::new(), interval: interval.max(1) }
    }

    /// Whether a mark is due after `frames` frames; to be called between batches.
    pub fn is_due(&self, frames: u64) -> bool {
        let last = self.marks.last().map_or(0, |mark| mark.frames);
        self.marks.is_empty() || frames.saturating_sub(last) >= self.interval
    }

    /// Adds a mark; marks must be added in order of their frames.
    pub fn add_checkpoint(&mut self, mark: Checkpoint) {
        if self.marks.len() >= MOST_MARKS {
            let mut keep = false;
            self.marks.retain(|_| {
                keep = !keep;
                keep
            });
            self.interval = self.interval.saturating_mul(2);
        }
        self.marks.push(mark);
    }

    /// Removes marks from which reading can no longer resume, because the first capture's bytes before
    /// `offset` were dropped.
    pub fn forget_before(&mut self, offset: u64) {
        self.marks.retain(|mark| mark.position.offsets().next().is_some_and(|start| start >= offset));
    }

    /// The last mark that has at most `frames` frames before it.
    pub fn before_frame(&self, frames: u64) -> Option<&Checkpoint> {
        let after = self.marks.partition_point(|mark| mark.frames <= frames);
        self.marks.get(after.checked_sub(1)?)
    }

    /// The last mark before which all frames are earlier than `time`. Backward steps of timestamps result in
    /// an earlier mark, never in a later one.
    pub fn before_time(&self, time: Timestamp) -> Option<&Checkpoint> {
        let earlier = |mark: &&Checkpoint| mark.time.is_none_or(|at| at < time);
        self.marks.iter().take_while(earlier).last()
    }

    /// The marks, in order.
    pub fn checkpoints(&self) -> &[Checkpoint] {
        &self.marks
    }
}
