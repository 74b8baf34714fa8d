//! Rows of the table of values.

use std::io;

use super::table::{Cell, Heading, Kind, always, maybe};
use super::time::{TimeCell, nanos, small_number};
use crate::event::Event;
use crate::session::Bus;
use crate::sink::rows::{ValueCells, ValueRows, ValueSource, ValueTable};

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
    rows: ValueRows,
    capture: Option<String>,
    time: TimeCell,
}

impl SignalRows {
    pub(super) fn new(time: TimeCell) -> Self {
        Self { rows: ValueRows::default(), capture: None, time }
    }

    /// Adds the capture name to every following row.
    pub(super) fn set_capture(&mut self, name: &str) {
        self.rows = ValueRows::default();
        self.capture = Some(name.to_owned());
    }

    /// Passes the row of each value of an event to `push`.
    pub(super) fn rows(
        &mut self,
        event: &Event,
        bus: &Bus,
        push: &mut dyn FnMut(&[Cell<'_>]) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut pushed = Pushed { push, capture: self.capture.as_deref(), time: self.time, result: Ok(()) };
        self.rows.visit(event, bus, &mut pushed);
        pushed.result
    }
}

/// Passes each value as a row, until that fails.
struct Pushed<'p> {
    push: &'p mut dyn FnMut(&[Cell<'_>]) -> io::Result<()>,
    capture: Option<&'p str>,
    time: TimeCell,
    result: io::Result<()>,
}

impl ValueTable for Pushed<'_> {
    fn value(&mut self, source: &ValueSource<'_>, cells: &ValueCells<'_>) {
        if self.result.is_err() {
            return;
        }
        let mut digits = String::new();
        let raw = raw_cells(cells.raw, &mut digits);
        self.result = (self.push)(&[
            (self.time)(source.time),
            nanos(source.time),
            Cell::text(self.capture),
            Cell::Text(source.bus),
            Cell::Number(source.frame.cast_signed()),
            small_number(source.node),
            Cell::text(source.device),
            Cell::Text(source.group),
            Cell::Text(cells.signal),
            Cell::Text(cells.id),
            cells.value.map_or(Cell::Null, Cell::Real),
            Cell::text(cells.text.as_deref()),
            if cells.unit.is_empty() { Cell::Null } else { Cell::Text(cells.unit) },
            Cell::text(cells.label),
            raw.0,
            raw.1,
        ]);
    }

    fn source(&mut self, _: &ValueSource<'_>, _: u32, _: usize) {
        // Each row has the cells of its source.
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
