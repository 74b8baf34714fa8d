//! The window at a position whose frames cannot be read again.

use std::sync::{Arc, PoisonError};

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::replay::{EventPosition, ReplayState};

use crate::timeline::order::{Order, Target, Window};
use crate::timeline::shared::Shared;
use crate::timeline::{News, Row};

/// One row with the reason, and the nearest state that was read before the position.
pub(super) fn window(shared: &Shared, order: &Order, error: &CaptureError) -> News {
    let spot = match order.target {
        Target::Event(spot) => spot,
        Target::Time(_) | Target::End => EventPosition::after(shared.progress.frames()),
    };
    let index = shared.index.read().unwrap_or_else(PoisonError::into_inner);
    let world = index.before_frame(spot.frame).map(|mark| mark.world.clone());
    drop(index);
    let world = Arc::new(world.unwrap_or_else(|| ReplayState::new(shared.options.clone())));
    let reason = match error {
        CaptureError::Io(error) => error.to_string(),
        other => other.to_string(),
    };
    let rows = vec![Row::unreadable(spot, format!("{reason}; these frames cannot be read again"))];
    let (serial, selected, frames) = (order.serial, 0, Vec::new());
    let (is_pending, is_missed) = (false, false);
    News::Window(Box::new(Window { serial, rows, selected, spot, world, frames, is_pending, is_missed }))
}
