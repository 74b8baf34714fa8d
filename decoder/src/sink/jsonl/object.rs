//! Writer for one JSON object.

use std::borrow::Cow;
use std::io::Write as _;

use crate::ascii::{push_code, push_decimal, push_hex, push_integer, push_seconds};
use crate::escape::escape_json;
use crate::frame::CanId;
use crate::query::record::{FieldConsumer, FieldValue};

/// Offsets of the parts of a line that vary between events of the same kind.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::sink) struct LineOffsets {
    /// End of the time.
    pub(super) behind_time: usize,
    /// Start of the first frame number.
    pub(super) frames: usize,
    /// End of the last frame number.
    pub(super) behind_frames: usize,
    /// Start of the hex digits of the payload; 0 without a payload.
    pub(super) data: usize,
}

/// Appends a value.
#[cfg(feature = "mcap")]
pub(in crate::sink) fn push(value: FieldValue<'_>, line: &mut Vec<u8>) {
    JsonObjectWriter::resume_object(line).write_value(value);
}

/// Writer for one JSON object.
pub(in crate::sink) struct JsonObjectWriter<'a> {
    line: &'a mut Vec<u8>,
    fresh: bool,
    /// Number of open nested lists and objects.
    depth: u32,
    marks: LineOffsets,
}

impl<'a> JsonObjectWriter<'a> {
    /// Starts an object at the end of `line`.
    pub(in crate::sink) fn begin_object(line: &'a mut Vec<u8>) -> Self {
        line.push(b'{');
        Self { line, fresh: true, depth: 0, marks: LineOffsets::default() }
    }

    /// Starts the first item of a list at the end of `line`.
    pub(super) fn in_list(line: &'a mut Vec<u8>) -> Self {
        Self { line, fresh: true, depth: 0, marks: LineOffsets::default() }
    }

    /// Continues an object in `line` that already has fields.
    pub(super) fn resume_object(line: &'a mut Vec<u8>) -> Self {
        Self { line, fresh: false, depth: 0, marks: LineOffsets::default() }
    }

    /// Ends the object and the line.
    pub(in crate::sink) fn end_object(self) -> LineOffsets {
        self.line.extend_from_slice(b"}\n");
        self.marks
    }

    #[inline]
    fn write_key(&mut self, key: &str) {
        if !std::mem::replace(&mut self.fresh, false) {
            self.line.push(b',');
        }
        if !key.is_empty() {
            self.line.push(b'"');
            self.line.extend_from_slice(key.as_bytes());
            self.line.extend_from_slice(b"\":");
        }
    }

    fn write_arguments(&mut self, arguments: std::fmt::Arguments<'_>) {
        // Writing to a vector cannot fail.
        let _ = self.line.write_fmt(arguments);
    }

    fn write_text(&mut self, text: &str) {
        let is_literal = text.bytes().all(|byte| byte >= b' ' && byte != b'"' && byte != b'\\')
            && matches!(escape_json(text), Cow::Borrowed(_));
        if is_literal {
            self.line.push(b'"');
            self.line.extend_from_slice(text.as_bytes());
            self.line.push(b'"');
        } else {
            let json = serde_json::to_string(text).unwrap_or_else(|_| "null".to_owned());
            self.line.extend_from_slice(escape_json(&json).as_bytes());
        }
    }

    fn write_code(&mut self, value: u64, digits: u8) {
        let digits = usize::from(digits);
        match u32::try_from(value) {
            Ok(value) if (1..=8).contains(&digits) => {
                self.line.extend_from_slice(b"\"0x");
                push_code(self.line, value, digits);
                self.line.push(b'"');
            }
            _ => self.write_arguments(format_args!("\"0x{value:0digits$X}\"")),
        }
    }

    fn write_value(&mut self, value: FieldValue<'_>) {
        match value {
            FieldValue::Bool(true) => self.line.extend_from_slice(b"true"),
            FieldValue::Bool(false) => self.line.extend_from_slice(b"false"),
            FieldValue::Unsigned(value) => push_decimal(self.line, value),
            FieldValue::Integer(value) => push_integer(self.line, value),
            FieldValue::Real(value) if value.is_finite() => self.write_arguments(format_args!("{value}")),
            FieldValue::Null | FieldValue::Real(_) => self.line.extend_from_slice(b"null"),
            FieldValue::Text(text) => self.write_text(text),
            FieldValue::Seconds(value) => push_seconds(self.line, value),
            FieldValue::Code(value, digits) => self.write_code(value, digits),
            FieldValue::Id(id) => {
                self.line.push(b'"');
                match id {
                    CanId::Standard(id) => push_code(self.line, u32::from(id), 3),
                    CanId::Extended(id) => push_code(self.line, id, 8),
                }
                self.line.push(b'"');
            }
            FieldValue::Object(object) => {
                self.line.extend_from_slice(b"\"0x");
                push_code(self.line, u32::from(object.index), 4);
                self.line.push(b':');
                push_code(self.line, u32::from(object.sub), 2);
                self.line.push(b'"');
            }
            FieldValue::Bytes(bytes) => {
                self.line.push(b'"');
                push_hex(self.line, bytes);
                self.line.push(b'"');
            }
        }
    }
}

impl FieldConsumer for JsonObjectWriter<'_> {
    fn add_field(&mut self, key: &'static str, value: FieldValue<'_>) {
        self.write_key(key);
        if self.depth == 0 && key == "data" {
            self.marks.data = self.line.len() + 1;
        }
        self.write_value(value);
        if self.depth == 0 && key == "t" {
            self.marks.behind_time = self.line.len();
        }
    }

    fn open_group(&mut self, key: &'static str) {
        self.write_key(key);
        self.line.push(b'{');
        self.fresh = true;
        self.depth += 1;
    }

    fn close_group(&mut self) {
        self.line.push(b'}');
        self.fresh = false;
        self.depth = self.depth.saturating_sub(1);
    }

    fn open_list(&mut self, key: &'static str) {
        self.write_key(key);
        self.line.push(b'[');
        self.fresh = true;
        self.depth += 1;
        if key == "frames" {
            self.marks.frames = self.line.len();
        }
    }

    fn close_list(&mut self) {
        if self.marks.behind_frames == 0 && self.marks.frames != 0 {
            self.marks.behind_frames = self.line.len();
        }
        self.line.push(b']');
        self.fresh = false;
        self.depth = self.depth.saturating_sub(1);
    }
}
