//! Values as a wide CSV table (RFC 4180): one row per event, one column per signal.
//!
//! ```text
//! time,bus,frame,node/2/tpdo1 Actual angle [%],node/2/tpdo1 Actual pressure [bar]
//! 1700000002.141000000,can0,28,49.40779,124.893219
//! ```
//!
//! The set of columns is complete only at the end of the input, so rows are spooled until then.

mod spool;

use std::collections::HashMap;
use std::io::{self, Read, Seek, Write};

use foldhash::fast::FixedState;

use super::csv::{push_cell, push_value};
use super::values::{self, CachedGroups, EventValues};
use super::{EventContent, EventFormat, EventSink};
use crate::ascii::{push_decimal, push_seconds};
use crate::event::Event;
use crate::frame::Timestamp;
use crate::query::record::quantity_value;
use crate::session::Bus;
use spool::{RowSpool, SpooledRows};

/// Maximum number of signal columns. Each row has a cell for each of them, so the limit bounds the size of
/// the output.
const MOST_COLUMNS: usize = 4096;

/// Columns of every row.
const HEADER: &str = "time,bus,frame";

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "csv-wide",
    suffix: "wide.csv",
    title: "values as wide CSV",
    help: "Values of PDOs and messages: one row per event, one column per signal",
    content: EventContent::Values,
    is_binary: false,
    sink: |files, _| Ok(Box::new(CsvWide::new(files.whole_file()?, files.spool_file()?))),
};

/// Writer for wide CSV. After the first write error nothing more is written; `finish` returns the error.
struct CsvWide<W, S: Write> {
    output: W,
    spool: RowSpool<S>,
    groups: CachedGroups<Vec<FieldColumn>>,
    columns: WideColumns,
    error: Option<io::Error>,
}

/// Column of one field of a layout.
struct FieldColumn {
    title: String,
    /// Assigned at the first value of the field.
    column: Option<u16>,
}

/// All signal columns.
struct WideColumns {
    titles: Vec<String>,
    numbers: HashMap<String, u16, FixedState>,
    most: usize,
    /// Number of values dropped for lack of a column.
    left_out: u64,
}

impl<W: Write, S: Read + Write + Seek> CsvWide<W, S> {
    /// Writes the table to `output`; `spool` must be empty.
    fn new(output: W, spool: S) -> Self {
        Self {
            output,
            spool: RowSpool::new(spool),
            groups: CachedGroups::default(),
            columns: WideColumns::new(MOST_COLUMNS),
            error: None,
        }
    }

    fn write_row(&mut self, event: &Event, bus: &Bus, carried: &EventValues<'_>) -> io::Result<()> {
        let places = self.groups.cached_or_learn(carried, || field_columns(carried, bus));
        let row = self.spool.begin_row();
        if let Some(Timestamp(time)) = event.time {
            push_seconds(row, time);
        }
        push_cell(row, bus.name());
        row.push(b',');
        push_decimal(row, event.frames.last);
        for (signal, place) in carried.zip_values(places) {
            if let Some(column) = self.columns.column_of(place) {
                push_value(
                    self.spool.begin_cell(column),
                    quantity_value(signal.field.meaning.as_deref(), &signal.value),
                );
            }
        }
        self.spool.end_row()
    }

    fn write_table(&mut self) -> io::Result<()> {
        let Some(mut rows) = self.spool.take_rows()? else { return Ok(()) };
        let mut line = HEADER.as_bytes().to_vec();
        self.columns.titles.iter().for_each(|title| push_cell(&mut line, title));
        loop {
            line.extend_from_slice(b"\r\n");
            self.output.write_all(&line)?;
            if !push_row(&mut rows, self.columns.titles.len(), &mut line)? {
                return self.output.flush();
            }
        }
    }
}

impl<W: Write, S: Read + Write + Seek> EventSink for CsvWide<W, S> {
    fn begin_capture(&mut self, _name: &str) {
        self.groups = CachedGroups::default();
    }

    fn write_event(&mut self, event: &Event, bus: &Bus) -> bool {
        if let Some(carried) = values::carried_values(event).filter(|_| self.error.is_none()) {
            self.error = self.write_row(event, bus, &carried).err();
        }
        true
    }

    /// Writes the table.
    fn finish_output(&mut self) -> io::Result<()> {
        match self.error.take() {
            Some(error) => Err(error),
            None => self.write_table(),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }

    fn omission_note(&self) -> Option<String> {
        let values = self.columns.left_out;
        (values > 0).then(|| {
            format!(
                "{values} values dropped: more than {MOST_COLUMNS} signals; select signals with --filter, or use -f csv"
            )
        })
    }
}

/// Replaces `line` with the next row, padded to all columns; `false` after the last row.
fn push_row<S: Read>(rows: &mut SpooledRows<S>, columns: usize, line: &mut Vec<u8>) -> io::Result<bool> {
    line.clear();
    let Some(row) = rows.next()? else { return Ok(false) };
    line.extend_from_slice(row.before);
    let mut next = 0;
    for (column, cell) in row.cells {
        let column = usize::from(column);
        line.resize(line.len() + column.saturating_sub(next), b',');
        // A cell starts with its comma.
        line.extend_from_slice(cell);
        next = column + 1;
    }
    line.resize(line.len() + columns.saturating_sub(next), b',');
    Ok(true)
}

impl WideColumns {
    fn new(most: usize) -> Self {
        Self { titles: Vec::new(), numbers: HashMap::default(), most, left_out: 0 }
    }

    /// Column of a field with a value: the column of its title, else a new one below the limit.
    fn column_of(&mut self, place: &mut FieldColumn) -> Option<u16> {
        if place.column.is_none() {
            place.column = self.numbers.get(&place.title).copied().or_else(|| self.add_column(&place.title));
        }
        if place.column.is_none() {
            self.left_out = self.left_out.saturating_add(1);
        }
        place.column
    }

    fn add_column(&mut self, title: &str) -> Option<u16> {
        let number = u16::try_from(self.titles.len()).ok().filter(|_| self.titles.len() < self.most)?;
        self.titles.push(title.to_owned());
        self.numbers.insert(title.to_owned(), number);
        Some(number)
    }
}

/// Columns for the fields of a layout, with unique titles: the second of two equal names gets a number.
fn field_columns(carried: &EventValues<'_>, bus: &Bus) -> Vec<FieldColumn> {
    let group = values::group_name(carried.group, bus);
    unique_titles(&group, carried).into_iter().map(|title| FieldColumn { title, column: None }).collect()
}

fn unique_titles(group: &str, carried: &EventValues<'_>) -> Vec<String> {
    let mut titles: Vec<String> = Vec::new();
    for field in &carried.layout.fields {
        let unit = values::field_unit(field);
        let unit = if unit.is_empty() { String::new() } else { format!(" [{unit}]") };
        let name = values::field_name(field);
        titles.push(values::not_taken(&titles, |number| {
            let number = number.map_or(String::new(), |number| format!(" {number}"));
            format!("{group} {name}{number}{unit}")
        }));
    }
    titles
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;
    use std::sync::Arc;

    use super::*;
    use crate::frame::{BusIndex, CanId};
    use crate::profile::{DataType, PayloadLayout, SignalField};
    use crate::sink::values::ValueGroupKey;
    use crate::wire::canopen::ObjectAddress;

    #[test]
    fn equal_names_are_numbered() {
        let field = |index| SignalField::of_object(ObjectAddress::new(index, 0), 0, 8, DataType::Unsigned8);
        let fields = vec![field(0x6041), field(0x6041), field(0x6042), field(0x6041)];
        let layout = Arc::new(PayloadLayout { fields, ..PayloadLayout::default() });
        let group = ValueGroupKey::Frame(BusIndex::default(), CanId::Standard(0x123));
        let carried = EventValues { group, layout: &layout, payload: &[] };
        assert_eq!(unique_titles("g", &carried), ["g 6041:00", "g 6041:00 2", "g 6042:00", "g 6041:00 3"]);
    }

    #[test]
    fn columns_are_limited() {
        let mut columns = WideColumns::new(2);
        let mut place =
            |title: &str| columns.column_of(&mut FieldColumn { title: title.to_owned(), column: None });
        assert_eq!(
            [place("a"), place("b"), place("c"), place("a"), place("d")],
            [Some(0), Some(1), None, Some(0), None]
        );
        assert_eq!(columns.left_out, 2);
    }

    #[test]
    fn every_row_has_a_place_for_every_column() {
        let mut spool = RowSpool::new(Cursor::new(Vec::new()));
        spool.begin_row().extend_from_slice(b"t,b,1");
        spool.begin_cell(1).extend_from_slice(b",5");
        spool.begin_cell(3).extend_from_slice(b",7");
        spool.end_row().unwrap();
        let mut rows = spool.take_rows().unwrap().unwrap();
        let mut line = Vec::new();
        assert!(push_row(&mut rows, 5, &mut line).unwrap());
        assert_eq!(line, b"t,b,1,,5,,7,");
        assert!(!push_row(&mut rows, 5, &mut line).unwrap());
    }
}
