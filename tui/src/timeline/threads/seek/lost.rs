//! The window at a position whose frames cannot be read again.

use std::sync::{Arc, PoisonError};

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::replay::{EventPosition, ReplayState};

use crate::timeline::order::{RowWindow, SeekTarget, WindowRequest};
use crate::timeline::shared::SharedResults;
use crate::timeline::{ReplayRow, TimelineNews};

/// One row with the reason, and the nearest state that was read before the position.
pub(super) fn lost_window(
    shared: &SharedResults,
    order: &WindowRequest,
    error: &CaptureError,
) -> TimelineNews {
    let spot = match order.target {
        SeekTarget::Event(spot) => spot,
        SeekTarget::Time(_) | SeekTarget::End => EventPosition::after_frame(shared.progress.frames()),
    };
    let index = shared.index.read().unwrap_or_else(PoisonError::into_inner);
    let world = index.before_frame(spot.frame).map(|mark| mark.world.clone());
    drop(index);
    let world = Arc::new(world.unwrap_or_else(|| ReplayState::new(shared.options.clone())));
    let reason = match error {
        CaptureError::Io(error) => error.to_string(),
        other => other.to_string(),
    };
    let rows = vec![ReplayRow::unreadable_row(spot, format!("{reason}; these frames cannot be read again"))];
    let (serial, selected, frames) = (order.serial, 0, Vec::new());
    let (is_pending, is_missed) = (false, false);
    TimelineNews::Window(Box::new(RowWindow {
        serial,
        rows,
        selected,
        spot,
        world,
        frames,
        is_pending,
        is_missed,
    }))
}
