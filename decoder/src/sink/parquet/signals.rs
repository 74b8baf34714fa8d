//! Rows of the table of values.

use std::io;

use super::table::{Cell, Heading, Kind, always, maybe};
use super::time::{TimeCell, nanos, node_number};
use crate::event::Event;
use crate::query::record::FieldValue;
use crate::session::Bus;
use crate::sink::values::{self, FieldNames, GroupNames, Groups};

/// Columns of the table of values.
pub(super) const HEADINGS: &[Heading] = &[
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

/// Converts the values of events to rows.
pub(super) struct SignalRows {
    groups: Groups<GroupNames>,
    capture: Option<String>,
    time: TimeCell,
}

impl SignalRows {
    pub(super) fn new(time: TimeCell) -> Self {
        Self { groups: Groups::default(), capture: None, time }
    }

    /// Adds the capture name to every following row.
    pub(super) fn set_capture(&mut self, name: &str) {
        self.groups = Groups::default();
        self.capture = Some(name.to_owned());
    }

    /// Passes the row of each value of an event to `push`.
    pub(super) fn rows(
        &mut self,
        event: &Event,
        bus: &Bus,
        push: &mut dyn FnMut(&[Cell<'_>]) -> io::Result<()>,
    ) -> io::Result<()> {
        let Some(carried) = values::carried(event) else { return Ok(()) };
        let Some(named) = self.groups.of(&carried, || GroupNames::of(&carried, bus)) else { return Ok(()) };
        let device = event.node.and_then(|node| bus.node(node)).and_then(|node| node.device_id());
        for (signal, FieldNames { name, id, label }) in carried.with(&mut named.fields) {
            let reading = values::reading(&signal, label);
            let mut hex = String::new();
            let (value, text) = cells(reading.value, &mut hex);
            let unit = values::unit(signal.field);
            let mut digits = String::new();
            let raw = raw_cells(signal.raw, &mut digits);
            push(&[
                (self.time)(event.time),
                nanos(event.time),
                Cell::text(self.capture.as_deref()),
                Cell::Text(bus.name()),
                Cell::Number(event.frames.last.cast_signed()),
                node_number(event.node),
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

/// Transmitted bits as a number, or in hex if they exceed the signed integers that every engine has.
fn raw_cells(raw: u64, digits: &mut String) -> (Cell<'static>, Cell<'_>) {
    if let Ok(number) = i64::try_from(raw) {
        return (Cell::Number(number), Cell::Null);
    }
    *digits = format!("{raw:016X}");
    (Cell::Null, Cell::Text(digits))
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
