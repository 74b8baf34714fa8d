//! Rows of the table of values.

use std::io;

use super::table::{ColumnHeading, ColumnType, RowCell, optional_column, required_column};
use super::time::{TimeCell, nanos_cell, small_number};
use crate::event::Event;
use crate::session::Bus;
use crate::sink::rows::{ValueCells, ValueRows, ValueSource, ValueTable};

/// Columns of the table of values.
pub(super) const HEADINGS: &[ColumnHeading] = &[
    optional_column("time", ColumnType::Time),
    optional_column("time_ns", ColumnType::Rising),
    optional_column("capture", ColumnType::Name),
    required_column("bus", ColumnType::Name),
    required_column("frame", ColumnType::Rising),
    optional_column("node", ColumnType::Number),
    optional_column("device", ColumnType::Name),
    required_column("group", ColumnType::Name),
    required_column("signal", ColumnType::Name),
    required_column("id", ColumnType::Name),
    optional_column("value", ColumnType::Real),
    optional_column("text", ColumnType::Name),
    optional_column("unit", ColumnType::Name),
    optional_column("label", ColumnType::Name),
    optional_column("raw", ColumnType::Number),
    optional_column("raw_hex", ColumnType::Name),
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
    pub(super) fn push_rows(
        &mut self,
        event: &Event,
        bus: &Bus,
        push: &mut dyn FnMut(&[RowCell<'_>]) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut pushed =
            RowPusher { push, capture: self.capture.as_deref(), time: self.time, result: Ok(()) };
        self.rows.visit_values(event, bus, &mut pushed);
        pushed.result
    }
}

/// Passes each value as a row, until that fails.
struct RowPusher<'p> {
    push: &'p mut dyn FnMut(&[RowCell<'_>]) -> io::Result<()>,
    capture: Option<&'p str>,
    time: TimeCell,
    result: io::Result<()>,
}

impl ValueTable for RowPusher<'_> {
    fn add_value(&mut self, source: &ValueSource<'_>, cells: &ValueCells<'_>) {
        if self.result.is_err() {
            return;
        }
        let mut digits = String::new();
        let raw = cells.raw.map_or((RowCell::Null, RowCell::Null), |raw| raw_cells(raw, &mut digits));
        self.result = (self.push)(&[
            (self.time)(source.time),
            nanos_cell(source.time),
            RowCell::text_or_null(self.capture),
            RowCell::Text(source.bus),
            RowCell::Number(source.frame.cast_signed()),
            small_number(source.node),
            RowCell::text_or_null(source.device),
            RowCell::Text(source.group),
            RowCell::Text(cells.signal),
            RowCell::Text(cells.id),
            cells.value.map_or(RowCell::Null, RowCell::Real),
            RowCell::text_or_null(cells.text.as_deref()),
            if cells.unit.is_empty() { RowCell::Null } else { RowCell::Text(cells.unit) },
            RowCell::text_or_null(cells.label),
            raw.0,
            raw.1,
        ]);
    }

    fn add_source(&mut self, _: &ValueSource<'_>, _: u32, _: usize) {
        // Each row has the cells of its source.
    }
}

/// Transmitted bits as a number, or in hex if they exceed the signed integers that every engine has.
fn raw_cells(raw: u64, digits: &mut String) -> (RowCell<'static>, RowCell<'_>) {
    if let Ok(number) = i64::try_from(raw) {
        return (RowCell::Number(number), RowCell::Null);
    }
    *digits = format!("{raw:016X}");
    (RowCell::Null, RowCell::Text(digits))
}
