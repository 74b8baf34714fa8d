//! Values as a table: CSV (RFC 4180), a line a value.
//!
//! ```text
//! time,bus,frame,node,device,group,signal,id,value,unit,label,raw
//! 1700000000.020000000,can0,12,2,rexroth-sydfec,node/2/tpdo1,Actual pressure,6041:00,102.3,bar,,3274
//! ```

use std::io::{self, Write};

use super::escape::push_escaped;
use super::values::{self, Groups, Named};
use super::{EventContent, EventFormat, EventSink};
use crate::ascii::push_seconds;
use crate::event::Event;
use crate::frame::Timestamp;
use crate::query::record::FieldValue;
use crate::session::Bus;

/// First line.
const HEADER: &str = "time,bus,frame,node,device,group,signal,id,value,unit,label,raw\r\n";

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "csv",
    suffix: "values.csv",
    title: "values as CSV",
    help: "The values of PDOs and messages: a line a value, with units",
    content: EventContent::Values,
    is_binary: false,
    sink: |files, _| Ok(Box::new(Csv::new(files.whole()?))),
};

/// Writes values as CSV, long. The first write error is kept and ends all writing.
struct Csv<W> {
    output: W,
    groups: Groups<Named>,
    line: Vec<u8>,
    has_begun: bool,
    error: Option<io::Error>,
}

impl<W: Write> Csv<W> {
    fn new(output: W) -> Self {
        Self {
            output,
            groups: Groups::default(),
            line: Vec::with_capacity(256),
            has_begun: false,
            error: None,
        }
    }

    /// Writes the values of an event, if it has any.
    fn values(&mut self, event: &Event, bus: &Bus) {
        let Some(carried) = values::carried(event).filter(|_| self.error.is_none()) else { return };
        self.begin();
        let Some(named) = self.groups.of(&carried, || Named::of(&carried, bus)) else { return };
        for (signal, (name, id)) in carried.with(&named.fields) {
            let told = values::told(&signal);
            self.line.clear();
            let line = &mut self.line;
            if let Some(Timestamp(time)) = event.time {
                push_seconds(line, time);
            }
            push_cell(line, bus.name());
            push_number(line, event.frames.last);
            let node = event.node.map_or(String::new(), |node| node.number().to_string());
            push_cell(line, &node);
            let device = event.node.and_then(|node| bus.node(node)).and_then(|node| node.device_id());
            push_cell(line, device.unwrap_or_default());
            push_cell(line, &named.group);
            push_cell(line, name);
            push_cell(line, id);
            push_value(line, told.value);
            push_cell(line, values::unit(signal.field));
            push_cell(line, told.label.unwrap_or_default());
            push_number(line, signal.raw);
            line.extend_from_slice(b"\r\n");
            if let Err(error) = self.output.write_all(line) {
                self.error = Some(error);
                return;
            }
        }
    }

    fn begin(&mut self) {
        if !std::mem::replace(&mut self.has_begun, true) {
            self.error = self.output.write_all(HEADER.as_bytes()).err();
        }
    }
}

impl<W: Write> EventSink for Csv<W> {
    fn begin_capture(&mut self, _name: &str) {
        self.groups = Groups::default();
    }

    fn write(&mut self, event: &Event, bus: &Bus) -> bool {
        self.values(event, bus);
        true
    }

    fn flush(&mut self) -> io::Result<()> {
        self.finish()
    }

    fn finish(&mut self) -> io::Result<()> {
        self.begin();
        match self.error.take() {
            Some(error) => Err(error),
            None => self.output.flush(),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}

/// Appends a cell behind others.
pub(super) fn push_cell(line: &mut Vec<u8>, text: &str) {
    line.push(b',');
    push_text(line, text);
}

/// Appends a text: quoted where it has to be, and such that no spreadsheet takes it for a formula.
pub(super) fn push_text(line: &mut Vec<u8>, text: &str) {
    let is_formula = text.starts_with(['=', '+', '-', '@']);
    let needs_quotes = text.contains([',', '"', ';', '\n', '\r']);
    if !is_formula && !needs_quotes {
        push_escaped(line, text.as_bytes());
        return;
    }
    line.push(b'"');
    if is_formula {
        line.push(b'\'');
    }
    push_escaped(line, text.replace('"', "\"\"").as_bytes());
    line.push(b'"');
}

fn push_number(line: &mut Vec<u8>, number: u64) {
    line.push(b',');
    crate::ascii::push_decimal(line, number);
}

/// Appends a value: numbers as they are, so that a negative one stays a number.
pub(super) fn push_value(line: &mut Vec<u8>, value: FieldValue<'_>) {
    match value {
        FieldValue::Text(text) => push_cell(line, text),
        FieldValue::Bytes(bytes) => {
            line.push(b',');
            crate::ascii::push_hex(line, bytes);
        }
        FieldValue::Unsigned(value) => push_number(line, value),
        FieldValue::Integer(value) => {
            line.push(b',');
            crate::ascii::push_integer(line, value);
        }
        FieldValue::Real(value) if value.is_finite() => {
            // Writing to a vector cannot fail.
            let _ = write!(line, ",{value}");
        }
        _ => line.push(b','),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_is_a_formula_or_breaks_its_line() {
        let cell = |text: &str| {
            let mut line = Vec::new();
            push_cell(&mut line, text);
            String::from_utf8(line).unwrap()
        };
        assert_eq!(cell("Actual pressure"), ",Actual pressure");
        assert_eq!(cell("=1+1"), ",\"'=1+1\"");
        assert_eq!(cell("-x"), ",\"'-x\"");
        assert_eq!(cell("a,b \"c\""), ",\"a,b \"\"c\"\"\"");
        assert_eq!(cell("a\nb\x1b"), ",\"a\\nb\\u{1b}\"");
    }

    #[test]
    fn numbers_stay_numbers() {
        let mut line = Vec::new();
        for value in
            [FieldValue::Real(-1.5), FieldValue::Integer(-2), FieldValue::Null, FieldValue::Real(f64::NAN)]
        {
            push_value(&mut line, value);
        }
        assert_eq!(line, b",-1.5,-2,,");
    }
}
