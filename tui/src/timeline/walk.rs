//! Walks through the captures of a timeline.

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::replay::{CaptureWalk, Checkpoint, ReplayState};

use super::shared::SharedResults;
use crate::source::StoreReader;

/// A walk through the captures of a timeline.
pub type TimelineWalk = CaptureWalk<StoreReader>;

/// Starts at the beginning, or at the first kept mark.
pub(super) fn start_walk(shared: &SharedResults) -> Result<TimelineWalk, CaptureError> {
    if let Some(mark) = shared.first_kept() {
        return resume_walk(shared, &mark);
    }
    Ok(CaptureWalk::new(shared.open()?, ReplayState::new(shared.options.clone())))
}

/// Starts at a mark.
pub(super) fn resume_walk(shared: &SharedResults, mark: &Checkpoint) -> Result<TimelineWalk, CaptureError> {
    Ok(CaptureWalk::new(shared.resume_readers(&mark.position)?, mark.world.clone()))
}

/// Whether all available frames of a growing capture are processed: the next step would block.
pub(super) fn is_at_head(walk: &TimelineWalk, shared: &SharedResults) -> bool {
    walk.is_drained() && walk.offset() >= shared.progress.bytes() && !shared.progress.is_complete()
}
