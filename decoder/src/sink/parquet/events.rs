//! Rows of the table of events.

use std::io;

use super::table::{Cell, Heading, Kind, always, maybe};
use super::time::{TimeCell, nanos, node_number};
use crate::event::Event;
use crate::query::record::protocol;
use crate::session::Bus;
use crate::sink::jsonl::Lines;
use crate::sink::text::Line;

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
    lines: Lines,
    capture: Option<String>,
    time: TimeCell,
}

impl EventRows {
    pub(super) fn new(time: TimeCell) -> Self {
        Self { lines: Lines::default(), capture: None, time }
    }

    /// Adds the capture name to every following row.
    pub(super) fn set_capture(&mut self, name: &str) {
        self.lines.set_capture(name);
        self.capture = Some(name.to_owned());
    }

    /// Passes the row of an event to `push`.
    pub(super) fn row(
        &mut self,
        event: &Event,
        bus: &Bus,
        push: &mut dyn FnMut(&[Cell<'_>]) -> io::Result<()>,
    ) -> io::Result<()> {
        let words = Line::of(event, bus);
        let blank = if words.who.is_empty() { "" } else { " " };
        let text = format!("{}{blank}{} {}", words.who, words.kind, words.what);
        let json = String::from_utf8_lossy(self.lines.of(event, bus).trim_ascii_end());
        let node = event.node.and_then(|node| bus.node(node));
        push(&[
            (self.time)(event.time),
            nanos(event.time),
            Cell::text(self.capture.as_deref()),
            Cell::Text(bus.name()),
            Cell::Number(event.frames.first.cast_signed()),
            Cell::Number(event.frames.last.cast_signed()),
            Cell::Text(event.kind.name()),
            Cell::Text(protocol(event.protocol)),
            node_number(event.node),
            Cell::text(node.and_then(|node| node.name())),
            Cell::text(node.and_then(|node| node.device_id())),
            Cell::Truth(event.presumed),
            Cell::Truth(event.routine),
            Cell::Text(&text),
            Cell::Text(&json),
        ])
    }
}
