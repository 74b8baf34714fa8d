//! JSON Lines: one object per event, with the keys of `docs/events.schema.json`.

mod key;
pub(super) mod object;
mod signals;
mod templates;

use std::io::{self, Write};

use super::{EventContent, EventFormat, EventSink};
use crate::event::Event;
use crate::query::record::visit_event;
use crate::session::Bus;
use key::KeyedEvent;
use object::{JsonObjectWriter, LineOffsets};
use templates::LineTemplates;

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "jsonl",
    suffix: "jsonl",
    title: "events as JSON Lines",
    help: "One JSON object per line",
    content: EventContent::Events,
    is_binary: false,
    sink: |files, _| Ok(Box::new(JsonlSink::new(files.whole_file()?))),
};

/// Writer for JSON Lines. After the first write error nothing more is written; `finish` returns the error.
pub struct JsonlSink<W> {
    output: W,
    lines: JsonLines,
    error: Option<io::Error>,
}

impl<W: Write> JsonlSink<W> {
    /// Writes to `output`, which should be buffered.
    pub fn new(output: W) -> Self {
        Self { output, lines: JsonLines::default(), error: None }
    }

    #[cold]
    fn store_error(&mut self, error: io::Error) {
        self.error = Some(error);
    }
}

impl<W: Write> EventSink for JsonlSink<W> {
    /// Adds the capture name to every following line.
    fn begin_capture(&mut self, name: &str) {
        self.lines.set_capture(name);
    }

    #[inline]
    fn write_event(&mut self, event: &Event, bus: &Bus) -> bool {
        if self.error.is_none()
            && let Err(error) = self.output.write_all(self.lines.line_of(event, bus))
        {
            self.store_error(error);
        }
        true
    }

    fn flush(&mut self) -> io::Result<()> {
        self.finish_output()
    }

    fn finish_output(&mut self) -> io::Result<()> {
        match self.error.take() {
            Some(error) => Err(error),
            None => self.output.flush(),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}

/// Formats events as lines in a reused buffer.
#[derive(Default)]
pub(super) struct JsonLines {
    capture: Option<String>,
    templates: LineTemplates,
    line: Vec<u8>,
}

impl JsonLines {
    /// Adds the capture name to every following line; its buses are others than those of the capture before.
    pub(super) fn set_capture(&mut self, capture: &str) {
        self.capture = Some(capture.to_owned());
        self.templates = LineTemplates::default();
    }

    /// The line of an event, with its line end.
    // Not `#[inline_keys]`: the calling crate would compile it at its own optimisation level.
    pub(super) fn line_of(&mut self, event: &Event, bus: &Bus) -> &[u8] {
        let keyed = KeyedEvent::key_event(event, bus);
        if let Some(keyed) = &keyed
            && self.templates.fill_template(keyed, event, bus)
        {
            return self.templates.line_in_slot(keyed.slot);
        }
        self.general_line(event, bus, keyed)
    }

    /// The line of an event without a suitable template.
    #[inline(never)]
    fn general_line(&mut self, event: &Event, bus: &Bus, keyed: Option<KeyedEvent>) -> &[u8] {
        self.line.clear();
        let marks = write_line(event, bus, self.capture.as_deref(), &mut self.line);
        if let Some(keyed) = keyed {
            self.templates.learn_template(&keyed, event, bus, &self.line, marks);
        }
        &self.line
    }
}

/// Appends the line of an event; returns the offsets of its variable parts.
fn write_line(event: &Event, bus: &Bus, capture: Option<&str>, line: &mut Vec<u8>) -> LineOffsets {
    let mut object = JsonObjectWriter::begin_object(line);
    visit_event(event, bus, capture, &mut object);
    object.end_object()
}
