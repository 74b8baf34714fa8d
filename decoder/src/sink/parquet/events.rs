//! Rows of the table of events.

use std::io;

use super::table::{ColumnHeading, ColumnType, RowCell, optional_column, required_column};
use super::time::{TimeCell, nanos_cell, small_number};
use crate::event::Event;
use crate::session::Bus;
use crate::sink::rows;

/// Columns of the table of events.
pub(super) const HEADINGS: &[ColumnHeading] = &[
    optional_column("time", ColumnType::Time),
    optional_column("time_ns", ColumnType::Rising),
    optional_column("capture", ColumnType::Name),
    required_column("bus", ColumnType::Name),
    required_column("first_frame", ColumnType::Rising),
    required_column("last_frame", ColumnType::Rising),
    required_column("kind", ColumnType::Name),
    required_column("protocol", ColumnType::Name),
    optional_column("node", ColumnType::Number),
    optional_column("node_name", ColumnType::Name),
    optional_column("device", ColumnType::Name),
    required_column("presumed", ColumnType::Truth),
    required_column("routine", ColumnType::Truth),
    required_column("text", ColumnType::Text),
    required_column("json", ColumnType::Json),
];

/// Converts events to rows.
pub(super) struct EventRowConverter {
    rows: rows::EventTableRows,
    capture: Option<String>,
    time: TimeCell,
}

impl EventRowConverter {
    pub(super) fn new(time: TimeCell) -> Self {
        Self { rows: rows::EventTableRows::default(), capture: None, time }
    }

    /// Adds the capture name to every following row.
    pub(super) fn set_capture(&mut self, name: &str) {
        self.rows.set_capture(name);
        self.capture = Some(name.to_owned());
    }

    /// Passes the row of an event to `push`.
    pub(super) fn push_row(
        &mut self,
        event: &Event,
        bus: &Bus,
        push: &mut dyn FnMut(&[RowCell<'_>]) -> io::Result<()>,
    ) -> io::Result<()> {
        let row = self.rows.event_row(event, bus);
        push(&[
            (self.time)(row.time),
            nanos_cell(row.time),
            RowCell::text_or_null(self.capture.as_deref()),
            RowCell::Text(row.bus),
            RowCell::Number(row.first_frame.cast_signed()),
            RowCell::Number(row.last_frame.cast_signed()),
            RowCell::Text(row.kind),
            RowCell::Text(row.protocol),
            small_number(row.node),
            RowCell::text_or_null(row.node_name),
            RowCell::text_or_null(row.device),
            RowCell::Truth(row.presumed),
            RowCell::Truth(row.routine),
            RowCell::Text(&row.text),
            RowCell::Text(&row.json),
        ])
    }
}
