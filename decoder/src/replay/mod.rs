//! Going back in a capture: checkpoints at intervals, and decoding on from the one before the place
//! wanted.
//!
//! ```text
//! frame   0 ────── 262,144 ────── 524,288 ──▶          each mark: reader's position + clone of the world
//!         mark     mark           mark
//! ```
//!
//! A checkpoint shares the object stores with its neighbours as long as nothing changed in them, so it
//! costs what the buses themselves hold ([`World::footprint`]).

mod latest;
mod world;

pub use latest::{Code, Latest, LatestOfNode, Start};
pub use world::{Counts, Spot, Told, World};

use crate::capture::MergedPosition;
use crate::frame::Timestamp;

/// Frames between two checkpoints.
pub(crate) const INTERVAL: u64 = 262_144;

/// Most checkpoints: when there are more, every second one goes and the interval doubles.
pub const MOST_MARKS: usize = 64;

/// One place from which decoding can go on.
#[derive(Clone)]
pub struct Mark {
    /// Frames before it.
    pub frames: u64,
    /// Time of the frame before it, if it has one.
    pub time: Option<Timestamp>,
    /// Where reading goes on.
    pub position: MergedPosition,
    /// What is known there.
    pub world: World,
}

/// Checkpoints of one capture, in order.
pub struct Index {
    marks: Vec<Mark>,
    interval: u64,
}

impl Default for Index {
    fn default() -> Self {
        Self { marks: Vec::new(), interval: INTERVAL }
    }
}

impl Index {
    /// An index that takes a mark every `interval` frames to begin with.
    pub fn every(interval: u64) -> Self {
        Self { marks: Vec::new(), interval: interval.max(1) }
    }

    /// Whether a mark is due after `frames` frames; ask between batches.
    pub fn is_due(&self, frames: u64) -> bool {
        let last = self.marks.last().map_or(0, |mark| mark.frames);
        self.marks.is_empty() || frames.saturating_sub(last) >= self.interval
    }

    /// Takes a mark; marks come in the order of their frames.
    pub fn add(&mut self, mark: Mark) {
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

    /// Forgets marks from which reading cannot go on any more: the first capture's bytes before `offset` are gone.
    pub fn forget_before(&mut self, offset: u64) {
        self.marks.retain(|mark| mark.position.offsets().next().is_some_and(|start| start >= offset));
    }

    /// The last mark with at most `frames` frames before it.
    pub fn before_frame(&self, frames: u64) -> Option<&Mark> {
        let after = self.marks.partition_point(|mark| mark.frames <= frames);
        self.marks.get(after.checked_sub(1)?)
    }

    /// The last mark before which every frame seen was earlier than `time`. Stamps that went back make
    /// this an early mark rather than a late one.
    pub fn before_time(&self, time: Timestamp) -> Option<&Mark> {
        let earlier = |mark: &&Mark| mark.time.is_none_or(|at| at < time);
        self.marks.iter().take_while(earlier).last()
    }

    /// The marks, in order.
    pub fn marks(&self) -> &[Mark] {
        &self.marks
    }
}
