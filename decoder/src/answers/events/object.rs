//! Events inside of other answers.

use serde::Serialize;
use serde_json::value::RawValue;

use crate::event::Event;
use crate::session::Bus;
use crate::sink::EventSink as _;
use crate::sink::jsonl::JsonlSink;

/// Event as printed by decode -f jsonl (docs/events.schema.json).
#[derive(Debug, Clone, Serialize)]
#[serde(transparent)]
pub struct EventObject(Box<RawValue>);

impl EventObject {
    /// The event on its bus, in the state after it.
    pub fn new(event: &Event, bus: &Bus) -> Option<Self> {
        let mut line = Vec::new();
        JsonlSink::new(&mut line).write_event(event, bus);
        let line = String::from_utf8(line).ok()?;
        RawValue::from_string(line.trim_end().to_owned()).ok().map(Self)
    }
}
