//! Events and their values as two Parquet files, for DuckDB, Polars and Spark.
//!
//! ```text
//! signals  one row per value, as in CSV; values that are not numbers are in `text`
//! events   one row per event, with its text line and its JSON Lines object
//! ```
//!
//! Types are those that Spark, DuckDB, Polars, Arrow and `DataFusion` read without options: times in µs, signed integers,
//! texts.

mod table;

use std::io::{self, Write};

use super::jsonl::Lines;
use super::text::Line;
use super::values::{self, EventValues, FieldNames, GroupNames, Groups};
use super::{EventContent, EventFormat, EventSink};
use crate::event::Event;
use crate::frame::Timestamp;
use crate::query::record::{FieldValue, protocol};
use crate::session::Bus;
use table::{Cell, Heading, Kind, Table, always, maybe};

const SIGNALS: &[Heading] = &[
    maybe("time", Kind::Time),
    maybe("time_ns", Kind::Rising),
    maybe("capture", Kind::Name),
    always("bus", Kind::Name),
    always("frame", Kind::Rising),
    maybe("node", Kind::Number),
    maybe("device", Kind::Name),
    always("group", Kind::Name),
    always("signal", Kind::Name),
    always("id", Kind::Name),
    maybe("value", Kind::Real),
    maybe("text", Kind::Name),
    maybe("unit", Kind::Name),
    maybe("label", Kind::Name),
    maybe("raw", Kind::Number),
    maybe("raw_hex", Kind::Name),
];

const EVENTS: &[Heading] = &[
    maybe("time", Kind::Time),
    maybe("time_ns", Kind::Rising),
    maybe("capture", Kind::Name),
    always("bus", Kind::Name),
    always("first_frame", Kind::Rising),
    always("last_frame", Kind::Rising),
    always("kind", Kind::Name),
    always("protocol", Kind::Name),
    maybe("node", Kind::Number),
    maybe("node_name", Kind::Name),
    maybe("device", Kind::Name),
    always("presumed", Kind::Truth),
    always("routine", Kind::Truth),
    always("text", Kind::Text),
    always("json", Kind::Json),
];

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "parquet",
    suffix: "parquet",
    title: "events as Parquet",
    help: "Events and values for DuckDB, Polars and Spark: NAME.events.parquet and NAME.signals.parquet; \
           requires -o NAME",
    content: EventContent::Events,
    is_binary: true,
    sink: |files, _| Ok(Box::new(Parquet::new(files.part("events")?, files.part("signals")?)?)),
};

/// Writer for events and values as Parquet. After the first write error nothing more is written; `finish`
/// returns the error.
struct Parquet<W: Write + Send> {
    events: Table<W>,
    signals: Table<W>,
    lines: Lines,
    groups: Groups<GroupNames>,
    capture: Option<String>,
    error: Option<io::Error>,
}

impl<W: Write + Send> Parquet<W> {
    /// Starts both files.
    fn new(events: W, signals: W) -> io::Result<Self> {
        Ok(Self {
            events: Table::new(events, EVENTS)?,
            signals: Table::new(signals, SIGNALS)?,
            lines: Lines::default(),
            groups: Groups::default(),
            capture: None,
            error: None,
        })
    }

    fn event(&mut self, event: &Event, bus: &Bus) -> io::Result<()> {
        let words = Line::of(event, bus);
        let blank = if words.who.is_empty() { "" } else { " " };
        let text = format!("{}{blank}{} {}", words.who, words.kind, words.what);
        let json = String::from_utf8_lossy(self.lines.of(event, bus).trim_ascii_end());
        let node = event.node.and_then(|node| bus.node(node));
        self.events.push(&[
            micros(event),
            time(event),
            Cell::text(self.capture.as_deref()),
            Cell::Text(bus.name()),
            Cell::Number(event.frames.first.cast_signed()),
            Cell::Number(event.frames.last.cast_signed()),
            Cell::Text(event.kind.name()),
            Cell::Text(protocol(event.protocol)),
            number(event),
            Cell::text(node.and_then(|node| node.name())),
            Cell::text(node.and_then(|node| node.device_id())),
            Cell::Truth(event.presumed),
            Cell::Truth(event.routine),
            Cell::Text(&text),
            Cell::Text(&json),
        ])
    }

    fn values(&mut self, event: &Event, bus: &Bus, carried: &EventValues<'_>) -> io::Result<()> {
        let Some(named) = self.groups.of(carried, || GroupNames::of(carried, bus)) else { return Ok(()) };
        let device = event.node.and_then(|node| bus.node(node)).and_then(|node| node.device_id());
        for (signal, FieldNames { name, id, label }) in carried.with(&mut named.fields) {
            let reading = values::reading(&signal, label);
            let mut hex = String::new();
            let (value, text) = cells(reading.value, &mut hex);
            let unit = values::unit(signal.field);
            let mut digits = String::new();
            let raw = raw_cells(signal.raw, &mut digits);
            self.signals.push(&[
                micros(event),
                time(event),
                Cell::text(self.capture.as_deref()),
                Cell::Text(bus.name()),
                Cell::Number(event.frames.last.cast_signed()),
                number(event),
                Cell::text(device),
                Cell::Text(&named.group),
                Cell::Text(name),
                Cell::Text(id),
                value,
                text,
                if unit.is_empty() { Cell::Null } else { Cell::Text(unit) },
                Cell::text(reading.label),
                raw.0,
                raw.1,
            ])?;
        }
        Ok(())
    }
}

impl<W: Write + Send> EventSink for Parquet<W> {
    /// Adds the capture name to every following row.
    fn begin_capture(&mut self, name: &str) {
        self.groups = Groups::default();
        self.lines.set_capture(name);
        self.capture = Some(name.to_owned());
    }

    fn write(&mut self, event: &Event, bus: &Bus) -> bool {
        if self.error.is_none() {
            let written = self.event(event, bus).and_then(|()| match values::carried(event) {
                Some(carried) => self.values(event, bus, &carried),
                None => Ok(()),
            });
            self.error = written.err();
        }
        true
    }

    fn finish(&mut self) -> io::Result<()> {
        match self.error.take() {
            Some(error) => Err(error),
            // Finish `signals` even if `events` fails: one readable file is better than none.
            None => self.events.finish().and(self.signals.finish()),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}

fn time(event: &Event) -> Cell<'static> {
    event.time.map_or(Cell::Null, |Timestamp(time)| Cell::Number(time))
}

fn micros(event: &Event) -> Cell<'static> {
    event.time.map_or(Cell::Null, |Timestamp(time)| Cell::Number(time.div_euclid(1_000)))
}

/// Transmitted bits as a number, or in hex if they exceed the signed integers that every engine has.
fn raw_cells(raw: u64, digits: &mut String) -> (Cell<'static>, Cell<'_>) {
    if let Ok(number) = i64::try_from(raw) {
        return (Cell::Number(number), Cell::Null);
    }
    *digits = format!("{raw:016X}");
    (Cell::Null, Cell::Text(digits))
}

fn number(event: &Event) -> Cell<'static> {
    event.node.map_or(Cell::Null, |node| Cell::Number(i64::from(node.number())))
}

/// The number and the text cell of a value; one of them is null.
#[expect(clippy::cast_precision_loss, reason = "raw is exact")]
fn cells<'a>(value: FieldValue<'a>, hex: &'a mut String) -> (Cell<'a>, Cell<'a>) {
    let number = match value {
        FieldValue::Unsigned(value) => value as f64,
        FieldValue::Integer(value) => value as f64,
        FieldValue::Real(value) if value.is_finite() => value,
        FieldValue::Text(text) => return (Cell::Null, Cell::Text(text)),
        FieldValue::Bytes(bytes) => {
            let mut digits = Vec::new();
            crate::ascii::push_hex(&mut digits, bytes);
            *hex = String::from_utf8_lossy(&digits).into_owned();
            return (Cell::Null, Cell::Text(hex));
        }
        _ => return (Cell::Null, Cell::Null),
    };
    (Cell::Real(number), Cell::Null)
}
