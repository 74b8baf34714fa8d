//! JSON Lines: one object an event, keys as `docs/events.schema.json` describes them.

pub(super) mod object;
mod prepared;
mod signals;

use std::io::{self, Write};

use super::{EventContent, EventFormat, EventSink};
use crate::event::Event;
use crate::query::record::visit;
use crate::session::Bus;
use object::{Marks, Object};
use prepared::Prepared;

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "jsonl",
    suffix: "jsonl",
    title: "events as JSON Lines",
    help: "One JSON object a line",
    content: EventContent::Events,
    is_binary: false,
    sink: |files, _| Ok(Box::new(Jsonl::new(files.whole()?))),
};

/// Writes events as JSON Lines. The first write error is kept and ends all writing.
pub struct Jsonl<W> {
    output: W,
    lines: Lines,
    error: Option<io::Error>,
}

impl<W: Write> Jsonl<W> {
    /// Writes to `output`, which should be buffered.
    pub fn new(output: W) -> Self {
        Self { output, lines: Lines::default(), error: None }
    }
}

impl<W: Write> EventSink for Jsonl<W> {
    /// Every following line names it.
    fn begin_capture(&mut self, name: &str) {
        self.lines.set_capture(name);
    }

    #[inline]
    fn write(&mut self, event: &Event, bus: &Bus) -> bool {
        if self.error.is_none() {
            self.error = self.output.write_all(self.lines.of(event, bus)).err();
        }
        true
    }

    fn flush(&mut self) -> io::Result<()> {
        self.finish()
    }

    fn finish(&mut self) -> io::Result<()> {
        match self.error.take() {
            Some(error) => Err(error),
            None => self.output.flush(),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}

/// Makes lines of events, each in the same memory.
#[derive(Default)]
pub(super) struct Lines {
    capture: Option<String>,
    prepared: Prepared,
    line: Vec<u8>,
}

impl Lines {
    /// Names the capture in every following line.
    pub(super) fn set_capture(&mut self, capture: &str) {
        self.capture = Some(capture.to_owned());
        self.prepared = Prepared::default();
    }

    /// The line of an event, with its end.
    // Not `#[inline]`: the crate that uses the writer would compile it, at its own level of optimisation.
    pub(super) fn of(&mut self, event: &Event, bus: &Bus) -> &[u8] {
        self.line.clear();
        if !self.prepared.write(event, bus, &mut self.line) {
            self.line.clear();
            let marks = write_line(event, bus, self.capture.as_deref(), &mut self.line);
            self.prepared.learn(event, bus, &self.line, marks);
        }
        &self.line
    }
}

/// Appends the line of any event; says where its parts begin.
fn write_line(event: &Event, bus: &Bus, capture: Option<&str>, line: &mut Vec<u8>) -> Marks {
    let mut object = Object::begin(line);
    visit(event, bus, capture, &mut object);
    object.end()
}
