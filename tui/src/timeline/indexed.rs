//! Captures with checkpoints and without threads: for requests that are answered one after the other.

use std::sync::PoisonError;
use std::sync::mpsc::channel;

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;

use super::shared::SharedResults;
use super::walk::{self, TimelineWalk};
use super::{TimelineCaptures, open_captures, threads};

/// Captures whose index is complete.
pub struct IndexedCapture {
    shared: SharedResults,
}

/// Where a walk starts.
#[derive(Debug, Clone, Copy)]
pub enum WalkStart {
    /// Before a frame, by its number.
    Frame(u64),
    /// Before all frames of this time or later.
    Time(Timestamp),
}

impl IndexedCapture {
    /// Reads captures once and keeps checkpoints.
    ///
    /// # Errors
    /// A capture cannot be opened or has an unknown format.
    pub fn open(captures: TimelineCaptures) -> anyhow::Result<Self> {
        let (lanes, _) = open_captures(&captures)?;
        let shared = SharedResults::new(lanes, captures.session, captures.read);
        // News of the index has no receiver.
        let (news, _) = channel();
        threads::index::run_index(&shared, &news);
        Ok(Self { shared })
    }

    /// A walk from the last checkpoint before `start`.
    ///
    /// # Errors
    /// The capture cannot be read any more.
    pub fn walk_from(&self, start: WalkStart) -> Result<TimelineWalk, CaptureError> {
        let index = self.shared.index.read().unwrap_or_else(PoisonError::into_inner);
        let mark = match start {
            WalkStart::Frame(frame) => index.before_frame(frame.saturating_sub(1)),
            WalkStart::Time(time) => index.before_time(time),
        };
        match mark {
            Some(mark) => walk::resume_walk(&self.shared, mark),
            None => walk::start_walk(&self.shared),
        }
    }
}
