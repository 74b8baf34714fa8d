//! Rows of the tables of events and values, for columnar formats: each cell has its type, no text is escaped.
//!
//! The columns are those of `docs/columns.md`.

use std::borrow::Cow;

use super::jsonl::JsonLines;
use super::text::EventLine;
use super::values::{self, CachedGroups, EventValues, FieldNames, GroupNames};
use crate::ascii::push_hex;
use crate::event::Event;
use crate::frame::Timestamp;
use crate::query::record::{FieldValue, protocol_name};
use crate::session::Bus;
use crate::wire::NodeId;

/// A row of the table of events.
#[derive(Debug, Clone, PartialEq)]
pub struct EventRow<'a> {
    /// Time of the last frame.
    pub time: Option<Timestamp>,
    /// Name of the bus.
    pub bus: &'a str,
    /// First frame of the event.
    pub first_frame: u64,
    /// Last frame of the event.
    pub last_frame: u64,
    /// Kind, as in JSON Lines.
    pub kind: &'static str,
    /// Protocol, as in JSON Lines.
    pub protocol: &'static str,
    /// Node-ID or J1939 address.
    pub node: Option<u8>,
    /// Name of the node in the bus file.
    pub node_name: Option<&'a str>,
    /// Profile and variant of the node.
    pub device: Option<&'a str>,
    /// Whether the event depends on unproven assumptions.
    pub presumed: bool,
    /// Whether the event only repeats an earlier one.
    pub routine: bool,
    /// Line of the text output.
    pub text: String,
    /// Object of JSON Lines.
    pub json: Cow<'a, str>,
}

/// Rows of the table of events.
#[derive(Default)]
pub struct EventTableRows(JsonLines);

impl EventTableRows {
    /// Adds the name of the capture to the JSON objects.
    pub fn set_capture(&mut self, name: &str) {
        self.0.set_capture(name);
    }

    /// The row of an event.
    pub fn event_row<'a>(&'a mut self, event: &Event, bus: &'a Bus) -> EventRow<'a> {
        let words = EventLine::describe_event(event, bus);
        let blank = if words.who.is_empty() { "" } else { " " };
        let node = event.node.and_then(|node| bus.node(node));
        EventRow {
            time: event.time,
            bus: bus.name(),
            first_frame: event.frames.first,
            last_frame: event.frames.last,
            kind: event.kind.name(),
            protocol: protocol_name(event.protocol),
            node: event.node.map(NodeId::number),
            node_name: node.and_then(|node| node.name()),
            device: node.and_then(|node| node.device_id()),
            presumed: event.presumed,
            routine: event.routine,
            text: format!("{}{blank}{} {}", words.who, words.kind, words.what),
            json: String::from_utf8_lossy(self.0.line_of(event, bus).trim_ascii_end()),
        }
    }
}

/// Columns that all values of an event have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ValueSource<'a> {
    /// Time of the last frame.
    pub time: Option<Timestamp>,
    /// Name of the bus.
    pub bus: &'a str,
    /// Last frame of the event.
    pub frame: u64,
    /// Node-ID or J1939 address; `None` for frames of a database.
    pub node: Option<u8>,
    /// Profile and variant of the node.
    pub device: Option<&'a str>,
    /// Message of the values: `node/2/tpdo1`.
    pub group: &'a str,
}

/// A value of an event.
#[derive(Debug, Clone, PartialEq)]
pub struct ValueCells<'a> {
    /// Number of the signal: rows with the same number have the same bus, group, name, identification and unit.
    pub signal_number: u32,
    /// Name of the signal.
    pub signal: &'a str,
    /// Object, else the identification of the value in its message.
    pub id: &'a str,
    /// Value in `unit`; `None` for texts, and if `label` marks it as not available.
    pub value: Option<f64>,
    /// Value of another type, bytes in hex.
    pub text: Option<Cow<'a, str>>,
    /// Unit of the value; empty for plain numbers.
    pub unit: &'a str,
    /// Name of the value in an enumeration, or of a special value.
    pub label: Option<&'a str>,
    /// Transmitted bits; `None` for texts and bytes.
    pub raw: Option<u64>,
}

/// Receiver of the rows of the table of values.
pub trait ValueTable {
    /// Adds the cells of a value, except for those of its source.
    fn add_value(&mut self, source: &ValueSource<'_>, cells: &ValueCells<'_>);

    /// Adds the common cells of the last `count` values, of which `signal_number` was the last one.
    fn add_source(&mut self, source: &ValueSource<'_>, signal_number: u32, count: usize);
}

/// Rows of the table of values.
#[derive(Default)]
pub struct ValueRows {
    groups: CachedGroups<NumberedNames>,
    signals: u32,
}

struct NumberedNames {
    /// Number of the first signal; the others follow.
    first: u32,
    names: GroupNames,
}

impl ValueRows {
    /// Adds all values of an event to a table.
    #[inline]
    pub fn visit_values(&mut self, event: &Event, bus: &Bus, table: &mut impl ValueTable) {
        let Some(carried) = values::carried_values(event) else { return };
        let Self { groups, signals } = self;
        let NumberedNames { first, names } =
            groups.cached_or_learn(&carried, || number_names(&carried, bus, signals));
        let source = ValueSource {
            time: event.time,
            bus: bus.name(),
            frame: event.frames.last,
            node: event.node.map(NodeId::number),
            device: event.node.and_then(|node| bus.node(node)).and_then(|node| node.device_id()),
            group: &names.group,
        };
        let numbers = *first..;
        let (mut count, mut last) = (0, 0);
        for (signal, (FieldNames { name, id, label }, signal_number)) in
            carried.zip_values(names.fields.iter_mut().zip(numbers))
        {
            let reading = values::signal_reading(&signal, label);
            let (value, text) = number_or_text(reading.value);
            let unit = values::field_unit(signal.field);
            let (label, raw) = (reading.label, (!signal.field.is_text()).then_some(signal.raw));
            let cells = ValueCells { signal_number, signal: name, id, value, text, unit, label, raw };
            table.add_value(&source, &cells);
            (count, last) = (count + 1, signal_number);
        }
        if count > 0 {
            table.add_source(&source, last, count);
        }
    }
}

/// Names of a group, with the next numbers.
fn number_names(carried: &EventValues<'_>, bus: &Bus, signals: &mut u32) -> NumberedNames {
    let names = GroupNames::names_of(carried, bus);
    let first = *signals;
    *signals = signals.saturating_add(u32::try_from(names.fields.len()).unwrap_or(u32::MAX));
    NumberedNames { first, names }
}

/// The number, or the text; both are `None` for an unavailable value.
#[expect(clippy::cast_precision_loss, reason = "raw is exact")]
fn number_or_text(value: FieldValue<'_>) -> (Option<f64>, Option<Cow<'_, str>>) {
    match value {
        FieldValue::Unsigned(value) => (Some(value as f64), None),
        FieldValue::Integer(value) => (Some(value as f64), None),
        FieldValue::Real(value) if value.is_finite() => (Some(value), None),
        FieldValue::Text(text) => (None, Some(Cow::Borrowed(text))),
        FieldValue::Bytes(bytes) => {
            let mut digits = Vec::new();
            push_hex(&mut digits, bytes);
            (None, Some(Cow::Owned(String::from_utf8_lossy(&digits).into_owned())))
        }
        _ => (None, None),
    }
}
