//! Values as a CSV table (RFC 4180), one row per value.
//!
//! ```text
//! time,bus,frame,node,device,group,signal,id,value,unit,label,raw
//! 1700000000.020000000,can0,12,2,rexroth-sydfec,node/2/tpdo1,Actual pressure,6041:00,102.3,bar,,3274
//! ```

use std::io::{self, Write};

use super::values::{self, CachedGroups, FieldNames, GroupNames};
use super::{EventContent, EventFormat, EventSink};
use crate::ascii::push_seconds;
use crate::escape::push_escaped;
use crate::event::Event;
use crate::frame::Timestamp;
use crate::profile::as_word;
use crate::query::record::{FieldValue, quantity_value};
use crate::session::Bus;

/// Header row.
const HEADER: &str = "time,bus,frame,node,device,group,signal,id,value,unit,label,raw\r\n";

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "csv",
    suffix: "values.csv",
    title: "values as CSV",
    help: "Values of PDOs, messages and transfers: one row per value, with units",
    content: EventContent::Values,
    is_binary: false,
    sink: |files, _| Ok(Box::new(CsvSink::new(files.whole_file()?))),
};

/// Writer for CSV with one row per value. After the first write error nothing more is written; `finish`
/// returns the error.
struct CsvSink<W> {
    output: W,
    groups: CachedGroups<GroupNames>,
    line: Vec<u8>,
    has_begun: bool,
    error: Option<io::Error>,
}

impl<W: Write> CsvSink<W> {
    fn new(output: W) -> Self {
        Self {
            output,
            groups: CachedGroups::default(),
            line: Vec::with_capacity(256),
            has_begun: false,
            error: None,
        }
    }

    /// Writes the values of an event.
    fn write_values(&mut self, event: &Event, bus: &Bus) {
        let Some(carried) = values::carried_values(event).filter(|_| self.error.is_none()) else { return };
        self.begin_row();
        let named = self.groups.cached_or_learn(&carried, || GroupNames::names_of(&carried, bus));
        for (signal, FieldNames { name, id, label }) in carried.zip_values(&mut named.fields) {
            let reading = values::signal_reading(&signal, label);
            self.line.clear();
            let cells = CsvCells {
                group: &named.group,
                name,
                id,
                value: reading.value,
                unit: values::field_unit(signal.field),
                label: reading.label.unwrap_or_default(),
                raw: (!signal.field.is_text()).then_some(signal.raw),
            };
            cells.push(event, bus, &mut self.line);
            if let Err(error) = self.output.write_all(&self.line) {
                self.error = Some(error);
                return;
            }
        }
    }

    /// Writes the value that an SDO or UDS service transferred.
    fn write_transferred(&mut self, event: &Event, bus: &Bus) {
        let Some(value) = values::transferred_value(event, bus).filter(|_| self.error.is_none()) else {
            return;
        };
        self.begin_row();
        self.line.clear();
        let meaning = value.meaning;
        let label = meaning.and_then(|meaning| meaning.description(&value.value)).unwrap_or_default();
        let cells = CsvCells {
            group: &value.group,
            name: value.name,
            id: &value.id,
            value: quantity_value(meaning, &value.value),
            unit: meaning.map_or("", |meaning| &meaning.unit),
            label: &label,
            raw: as_word(&value.value),
        };
        cells.push(event, bus, &mut self.line);
        self.error = self.output.write_all(&self.line).err();
    }

    fn begin_row(&mut self) {
        if !std::mem::replace(&mut self.has_begun, true) {
            self.error = self.output.write_all(HEADER.as_bytes()).err();
        }
    }
}

impl<W: Write> EventSink for CsvSink<W> {
    fn begin_capture(&mut self, _name: &str) {
        self.groups = CachedGroups::default();
    }

    fn write_event(&mut self, event: &Event, bus: &Bus) -> bool {
        self.write_values(event, bus);
        self.write_transferred(event, bus);
        true
    }

    fn flush(&mut self) -> io::Result<()> {
        self.finish_output()
    }

    fn finish_output(&mut self) -> io::Result<()> {
        self.begin_row();
        match self.error.take() {
            Some(error) => Err(error),
            None => self.output.flush(),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }
}

/// Cells of a row, except for those of the event.
struct CsvCells<'a> {
    group: &'a str,
    name: &'a str,
    id: &'a str,
    value: FieldValue<'a>,
    unit: &'a str,
    label: &'a str,
    raw: Option<u64>,
}

impl CsvCells<'_> {
    /// Appends the row.
    fn push(&self, event: &Event, bus: &Bus, line: &mut Vec<u8>) {
        if let Some(Timestamp(time)) = event.time {
            push_seconds(line, time);
        }
        push_cell(line, bus.name());
        push_number(line, event.frames.last);
        let node = event.node.map_or(String::new(), |node| node.number().to_string());
        push_cell(line, &node);
        let device = event.node.and_then(|node| bus.node(node)).and_then(|node| node.device_id());
        push_cell(line, device.unwrap_or_default());
        push_cell(line, self.group);
        push_cell(line, self.name);
        push_cell(line, self.id);
        push_value(line, self.value);
        push_cell(line, self.unit);
        push_cell(line, self.label);
        match self.raw {
            Some(raw) => push_number(line, raw),
            None => line.push(b','),
        }
        line.extend_from_slice(b"\r\n");
    }
}

/// Appends a comma and a cell.
pub(super) fn push_cell(line: &mut Vec<u8>, text: &str) {
    line.push(b',');
    push_text(line, text);
}

/// Appends a text, quoted if necessary, with a leading `'` if a spreadsheet would interpret it as a formula.
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

/// Appends a comma and a value. Numbers are not protected against formulas, so that negative ones stay
/// numbers.
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
