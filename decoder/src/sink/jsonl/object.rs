//! Writer for one JSON object.

use std::borrow::Cow;
use std::io::Write as _;

use crate::ascii::{push_code, push_decimal, push_hex, push_integer, push_seconds};
use crate::escape::escape_json;
use crate::frame::CanId;
use crate::query::record::{FieldValue, Fields};

/// Offsets of the parts of a line that vary between events of the same kind.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::sink) struct Marks {
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
    Object::resume(line).value(value);
}

/// Writer for one JSON object.
pub(in crate::sink) struct Object<'a> {
    line: &'a mut Vec<u8>,
    fresh: bool,
    /// Number of open nested lists and objects.
    depth: u32,
    marks: Marks,
}

impl<'a> Object<'a> {
    /// Starts an object at the end of `line`.
    pub(in crate::sink) fn begin(line: &'a mut Vec<u8>) -> Self {
        line.push(b'{');
        Self { line, fresh: true, depth: 0, marks: Marks::default() }
    }

    /// Starts the first item of a list at the end of `line`.
    pub(super) fn in_list(line: &'a mut Vec<u8>) -> Self {
        Self { line, fresh: true, depth: 0, marks: Marks::default() }
    }

    /// Continues an object in `line` that already has fields.
    pub(super) fn resume(line: &'a mut Vec<u8>) -> Self {
        Self { line, fresh: false, depth: 0, marks: Marks::default() }
    }

    /// Ends the object and the line.
    pub(in crate::sink) fn end(self) -> Marks {
        self.line.extend_from_slice(b"}\n");
        self.marks
    }

    #[inline]
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

    fn text(&mut self, text: &str) {
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

    fn code(&mut self, value: u64, digits: u8) {
        let digits = usize::from(digits);
        match u32::try_from(value) {
            Ok(value) if (1..=8).contains(&digits) => {
                self.line.extend_from_slice(b"\"0x");
                push_code(self.line, value, digits);
                self.line.push(b'"');
            }
            _ => self.print(format_args!("\"0x{value:0digits$X}\"")),
        }
    }

    fn value(&mut self, value: FieldValue<'_>) {
        match value {
            FieldValue::Bool(true) => self.line.extend_from_slice(b"true"),
            FieldValue::Bool(false) => self.line.extend_from_slice(b"false"),
            FieldValue::Unsigned(value) => push_decimal(self.line, value),
            FieldValue::Integer(value) => push_integer(self.line, value),
            FieldValue::Real(value) if value.is_finite() => self.print(format_args!("{value}")),
            FieldValue::Null | FieldValue::Real(_) => self.line.extend_from_slice(b"null"),
            FieldValue::Text(text) => self.text(text),
            FieldValue::Seconds(value) => push_seconds(self.line, value),
            FieldValue::Code(value, digits) => self.code(value, digits),
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

impl Fields for Object<'_> {
    fn field(&mut self, key: &'static str, value: FieldValue<'_>) {
        self.key(key);
        if self.depth == 0 && key == "data" {
            self.marks.data = self.line.len() + 1;
        }
        self.value(value);
        if self.depth == 0 && key == "t" {
            self.marks.behind_time = self.line.len();
        }
    }

    fn open(&mut self, key: &'static str) {
        self.key(key);
        self.line.push(b'{');
        self.fresh = true;
        self.depth += 1;
    }

    fn close(&mut self) {
        self.line.push(b'}');
        self.fresh = false;
        self.depth = self.depth.saturating_sub(1);
    }

    fn open_list(&mut self, key: &'static str) {
        self.key(key);
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
