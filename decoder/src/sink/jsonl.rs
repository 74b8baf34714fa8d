//! JSON Lines: one object an event, keys as `docs/events.schema.json` describes them.

use std::io::{self, Write};

use crate::event::Event;
use crate::query::record::{FieldValue, Fields, visit};
use crate::session::Bus;

/// Writes events as JSON Lines. The first write error is kept and ends all writing.
pub struct Jsonl<W> {
    output: W,
    capture: Option<String>,
    line: Vec<u8>,
    error: Option<io::Error>,
}

impl<W: Write> Jsonl<W> {
    /// Writes to `output`, which should be buffered.
    pub fn new(output: W) -> Self {
        Self { output, capture: None, line: Vec::with_capacity(512), error: None }
    }

    /// Names the capture in every following line.
    pub fn set_capture(&mut self, capture: Option<String>) {
        self.capture = capture;
    }

    /// Writes one event.
    pub fn write(&mut self, event: &Event, bus: &Bus) {
        if self.error.is_some() {
            return;
        }
        self.line.clear();
        let mut object = Object { line: &mut self.line, fresh: true };
        object.line.push(b'{');
        visit(event, bus, self.capture.as_deref(), &mut object);
        self.line.extend_from_slice(b"}\n");
        self.error = self.output.write_all(&self.line).err();
    }

    /// Flushes; gives the first error of all writing.
    ///
    /// # Errors
    /// When anything could not be written.
    pub fn finish(&mut self) -> io::Result<()> {
        match self.error.take() {
            Some(error) => Err(error),
            None => self.output.flush(),
        }
    }

    /// Whether writing failed, so that more work is in vain.
    pub fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}

/// One JSON object being written.
struct Object<'a> {
    line: &'a mut Vec<u8>,
    fresh: bool,
}

impl Object<'_> {
    fn key(&mut self, key: &str) {
        if !std::mem::replace(&mut self.fresh, false) {
            self.line.push(b',');
        }
        if !key.is_empty() {
            self.line.push(b'"');
            self.line.extend_from_slice(key.as_bytes());
            self.line.extend_from_slice(b"\":");
        }
    }

    fn print(&mut self, arguments: std::fmt::Arguments<'_>) {
        // Writing to a vector cannot fail.
        let _ = self.line.write_fmt(arguments);
    }
}

impl Fields for Object<'_> {
    fn field(&mut self, key: &'static str, value: FieldValue<'_>) {
        self.key(key);
        match value {
            FieldValue::Null => self.line.extend_from_slice(b"null"),
            FieldValue::Real(value) if !value.is_finite() => self.line.extend_from_slice(b"null"),
            FieldValue::Bool(value) => self.print(format_args!("{value}")),
            FieldValue::Unsigned(value) => self.print(format_args!("{value}")),
            FieldValue::Integer(value) => self.print(format_args!("{value}")),
            FieldValue::Real(value) => self.print(format_args!("{value}")),
            FieldValue::Text(text) => {
                if serde_json::to_writer(&mut *self.line, text).is_err() {
                    self.line.extend_from_slice(b"null");
                }
            }
            FieldValue::Seconds(value) => self.print(format_args!("{}", crate::frame::Timestamp(value))),
            FieldValue::Code(value, digits) => {
                let digits = usize::from(digits);
                self.print(format_args!("\"0x{value:0digits$X}\""));
            }
            FieldValue::Id(id) => self.print(format_args!("\"{id}\"")),
            FieldValue::Object(object) => self.print(format_args!("\"0x{object}\"")),
            FieldValue::Bytes(bytes) => {
                self.line.push(b'"');
                for byte in bytes {
                    self.print(format_args!("{byte:02X}"));
                }
                self.line.push(b'"');
            }
        }
    }

    fn open(&mut self, key: &'static str) {
        self.key(key);
        self.line.push(b'{');
        self.fresh = true;
    }

    fn close(&mut self) {
        self.line.push(b'}');
        self.fresh = false;
    }

    fn open_list(&mut self, key: &'static str) {
        self.key(key);
        self.line.push(b'[');
        self.fresh = true;
    }

    fn close_list(&mut self) {
        self.line.push(b']');
        self.fresh = false;
    }
}
