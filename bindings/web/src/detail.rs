//! All fields of an event.

use cobscope_decoder::answers::events::EventDetail;
use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{CaptureWalk, EventPosition, PlacedEvent};

use crate::files::ContentSource;

/// The event at a position as `decode -f jsonl` prints it, with its payload; `walk` is before its frame.
///
/// # Errors
/// If the capture can no longer be read.
pub fn event_detail(
    mut walk: CaptureWalk<ContentSource>,
    at: EventPosition,
    zero: Option<Timestamp>,
) -> Result<Option<EventDetail>, CaptureError> {
    let mut found = None;
    while found.is_none() && walk.world.frames() <= at.frame {
        let mut see = |placed: PlacedEvent<'_>| {
            if placed.spot == at {
                found = Some(EventDetail::new(&placed, zero));
            }
        };
        if !walk.step_item(&mut see)? {
            break;
        }
    }
    Ok(found)
}
