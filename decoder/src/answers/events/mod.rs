//! Events: as objects inside of other answers, as rows of a list, and with their payload.

use serde::Serialize;
use serde_json::value::RawValue;

use super::numbers::seconds_after;
use crate::event::Event;
use crate::finding::Severity;
use crate::frame::Timestamp;
use crate::replay::{EventPosition, PlacedEvent, ReplayRow};
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

/// Position of an event.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct PositionRecord {
    /// Number of the frame.
    pub frame: u64,
    /// Number of the event among those of the frame.
    pub ordinal: u32,
}

/// A row of the list of events. Its texts are escaped.
#[derive(Debug, Clone, Serialize)]
pub struct EventRow {
    /// Name of the bus.
    pub bus: String,
    /// Payload, or reason why the frame has none.
    pub data: String,
    /// Filter for events of the same node and kind.
    pub filter: String,
    /// Number of the frame.
    pub frame: u64,
    /// Identifier of the frame.
    pub id: Option<String>,
    /// Kind in at most nine characters.
    pub kind: &'static str,
    /// The row as one line.
    pub line: String,
    /// Severity of the finding at the frame.
    pub mark: Option<&'static str>,
    /// Number of the event among those of the frame.
    pub ordinal: u32,
    /// Place in the list.
    pub row: u64,
    /// Seconds from the first frame.
    pub time: Option<f64>,
    /// Class of the colour.
    pub tone: &'static str,
    /// Part of the text that did not change.
    pub unchanged: String,
    /// Text.
    pub what: String,
    /// Node, or source and destination.
    pub who: String,
}

/// An event with its frame.
#[derive(Debug, Clone, Serialize)]
pub struct EventDetail {
    /// Bytes of the frame in hexadecimal digits.
    pub bytes: Option<Vec<String>>,
    /// The event.
    pub event: Option<EventObject>,
    /// Filter for the identifier.
    pub filter: Option<String>,
    /// Identifier of the frame.
    pub id: Option<String>,
    /// Meaning of the identifier.
    pub meaning: Option<String>,
    /// Seconds from the first frame.
    pub time: Option<f64>,
}

impl From<EventPosition> for PositionRecord {
    fn from(EventPosition { frame, ordinal }: EventPosition) -> Self {
        Self { frame, ordinal }
    }
}

impl EventRow {
    /// Row number `place` of a list; `mark` is the severity of the finding at its frame, `zero` the time of the first
    /// frame.
    pub fn new(row: &ReplayRow, place: u64, mark: Option<Severity>, zero: Option<Timestamp>) -> Self {
        Self {
            bus: row.bus.clone(),
            data: row.data_text(),
            filter: row.filter_expression(),
            frame: row.spot.frame,
            id: row.id().map(|id| id.to_string()),
            kind: row.kind,
            line: row.row_text(),
            mark: mark.map(Severity::name),
            ordinal: row.spot.ordinal,
            row: place,
            time: seconds_after(row.event.time, zero),
            tone: row.tone.name(),
            unchanged: row.unchanged.clone(),
            what: row.what.clone(),
            who: row.who.clone(),
        }
    }
}

impl EventDetail {
    /// The event; `zero` is the time of the first frame.
    pub fn new(placed: &PlacedEvent<'_>, zero: Option<Timestamp>) -> Self {
        let frame = placed.frame.filter(|frame| placed.event.frames.last == frame.number);
        let bytes = frame.map(|frame| frame.data().iter().map(|byte| format!("{byte:02X}")).collect());
        Self {
            bytes,
            event: EventObject::new(placed.event, placed.bus),
            filter: frame.map(|frame| placed.bus.filter_of_id(frame.id)),
            id: frame.map(|frame| frame.id.to_string()),
            meaning: frame.map(|frame| placed.bus.describe_id(frame.id)),
            time: seconds_after(placed.event.time, zero),
        }
    }
}
