//! Rows of the table of events.

use std::io;

use super::table::{Cell, Heading, Kind, always, maybe};
use super::time::{TimeCell, nanos, small_number};
use crate::event::Event;
use crate::session::Bus;
use crate::sink::rows;

/// Columns of the table of events.
pub(super) const HEADINGS: &[Heading] = &[
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

/// Converts events to rows.
pub(super) struct EventRows {
    rows: rows::EventRows,
    capture: Option<String>,
    time: TimeCell,
}

impl EventRows {
    pub(super) fn new(time: TimeCell) -> Self {
        Self { rows: rows::EventRows::default(), capture: None, time }
    }

    /// Adds the capture name to every following row.
    pub(super) fn set_capture(&mut self, name: &str) {
        self.rows.set_capture(name);
        self.capture = Some(name.to_owned());
    }

    /// Passes the row of an event to `push`.
    pub(super) fn row(
        &mut self,
        event: &Event,
        bus: &Bus,
        push: &mut dyn FnMut(&[Cell<'_>]) -> io::Result<()>,
    ) -> io::Result<()> {
        let row = self.rows.row(event, bus);
        push(&[
            (self.time)(row.time),
            nanos(row.time),
            Cell::text(self.capture.as_deref()),
            Cell::Text(row.bus),
            Cell::Number(row.first_frame.cast_signed()),
            Cell::Number(row.last_frame.cast_signed()),
            Cell::Text(row.kind),
            Cell::Text(row.protocol),
            small_number(row.node),
            Cell::text(row.node_name),
            Cell::text(row.device),
            Cell::Truth(row.presumed),
            Cell::Truth(row.routine),
            Cell::Text(&row.text),
            Cell::Text(&row.json),
        ])
    }
}
