//! All fields of an event.

use cobscope_decoder::capture::CaptureError;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{EventPosition, PlacedEvent, Walk};
use cobscope_decoder::sink::EventSink as _;
use cobscope_decoder::sink::escape_json;
use cobscope_decoder::sink::jsonl::Jsonl;
use serde_json::{Value, json};

use crate::files::Source;
use crate::rows::seconds;

/// The event at a position as `decode -f jsonl` prints it, with its payload; `walk` is before its frame.
///
/// # Errors
/// If the capture can no longer be read.
pub fn detail(
    mut walk: Walk<Source>,
    at: EventPosition,
    zero: Option<Timestamp>,
) -> Result<Value, CaptureError> {
    let mut found = None;
    while found.is_none() && walk.world.frames() <= at.frame {
        let mut see = |placed: PlacedEvent<'_>| {
            if placed.spot == at {
                found = Some(value(&placed, zero));
            }
        };
        if !walk.step(&mut see)? {
            break;
        }
    }
    Ok(found.unwrap_or(Value::Null))
}

fn value(placed: &PlacedEvent<'_>, zero: Option<Timestamp>) -> Value {
    let mut line = Vec::new();
    Jsonl::new(&mut line).write(placed.event, placed.bus);
    let line = String::from_utf8(line).unwrap_or_default();
    let event = serde_json::from_str::<Value>(&escape_json(line.trim_end())).ok();
    let frame = placed.frame.filter(|frame| placed.event.frames.last == frame.number);
    let bytes = frame.map(|frame| frame.data().iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>());
    json!({
        "event": event,
        "time": seconds(placed.event.time, zero),
        "id": frame.map(|frame| frame.id.to_string()),
        "meaning": frame.map(|frame| placed.bus.describe_id(frame.id)),
        "filter": frame.map(|frame| placed.bus.filter_of_id(frame.id)),
        "bytes": bytes,
    })
}
