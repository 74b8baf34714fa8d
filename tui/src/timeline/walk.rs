//! Walks through the captures of a timeline.

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::replay::{Checkpoint, ReplayState, Walk};

use super::shared::Shared;
use crate::source::StoreReader;

/// A walk through the captures of a timeline.
pub type TimelineWalk = Walk<StoreReader>;

/// Starts at the beginning, or at the first kept mark.
pub(super) fn start(shared: &Shared) -> Result<TimelineWalk, CaptureError> {
    if let Some(mark) = shared.first_kept() {
        return resume(shared, &mark);
    }
    Ok(Walk::new(shared.open()?, ReplayState::new(shared.options.clone())))
}

/// Starts at a mark.
pub(super) fn resume(shared: &Shared, mark: &Checkpoint) -> Result<TimelineWalk, CaptureError> {
    Ok(Walk::new(shared.resume(&mark.position)?, mark.world.clone()))
}

/// Whether all available frames of a growing capture are processed: the next step would block.
pub(super) fn is_at_head(walk: &TimelineWalk, shared: &Shared) -> bool {
    walk.is_drained() && walk.offset() >= shared.progress.bytes() && !shared.progress.is_complete()
}
