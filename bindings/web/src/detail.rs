//! All fields of an event.

use cobscope_decoder::answers::EventObject;
use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{CaptureWalk, EventPosition, PlacedEvent};
use serde_json::{Value, json};

use crate::files::ContentSource;
use crate::rows::seconds_since;

/// The event at a position as `decode -f jsonl` prints it, with its payload; `walk` is before its frame.
///
/// # Errors
/// If the capture can no longer be read.
pub fn event_detail(
    mut walk: CaptureWalk<ContentSource>,
    at: EventPosition,
    zero: Option<Timestamp>,
) -> Result<Value, CaptureError> {
    let mut found = None;
    while found.is_none() && walk.world.frames() <= at.frame {
        let mut see = |placed: PlacedEvent<'_>| {
            if placed.spot == at {
                found = Some(event_value(&placed, zero));
            }
        };
        if !walk.step_item(&mut see)? {
            break;
        }
    }
    Ok(found.unwrap_or(Value::Null))
}

fn event_value(placed: &PlacedEvent<'_>, zero: Option<Timestamp>) -> Value {
    let frame = placed.frame.filter(|frame| placed.event.frames.last == frame.number);
    let bytes = frame.map(|frame| frame.data().iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>());
    json!({
        "event": EventObject::new(placed.event, placed.bus),
        "time": seconds_since(placed.event.time, zero),
        "id": frame.map(|frame| frame.id.to_string()),
        "meaning": frame.map(|frame| placed.bus.describe_id(frame.id)),
        "filter": frame.map(|frame| placed.bus.filter_of_id(frame.id)),
        "bytes": bytes,
    })
}
