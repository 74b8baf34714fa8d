//! Values as a wide table: CSV (RFC 4180), a row an event, a column a signal.
//!
//! ```text
//! time,bus,frame,node/2/tpdo1 Actual angle [%],node/2/tpdo1 Actual pressure [bar]
//! 1700000002.141000000,can0,28,49.40779,124.893219
//! ```
//!
//! Which columns there are is known at the end, so rows wait in a spool until then.

mod spool;

use std::collections::HashMap;
use std::io::{self, Read, Seek, Write};

use foldhash::fast::FixedState;

use super::csv::{push_cell, push_value};
use super::values::{self, Carried, Groups};
use super::{EventContent, EventFormat, EventSink};
use crate::ascii::{push_decimal, push_seconds};
use crate::event::Event;
use crate::frame::Timestamp;
use crate::session::Bus;
use spool::{Rows, Spool};

/// Signals that get a column. Each row has a place for all of them, so a capture made for it could fill any disk.
const MOST_COLUMNS: usize = 4096;

/// Columns that every row has.
const HEADER: &str = "time,bus,frame";

pub(super) const FORMAT: EventFormat = EventFormat {
    name: "csv-wide",
    suffix: "wide.csv",
    title: "values as wide CSV",
    help: "The same values: a line an event, a column a signal",
    content: EventContent::Values,
    is_binary: false,
    sink: |files, _| Ok(Box::new(CsvWide::new(files.whole()?, files.spool()?))),
};

/// Writes values as CSV, wide. The first write error is kept and ends all writing.
struct CsvWide<W, S: Write> {
    output: W,
    spool: Spool<S>,
    groups: Groups<Vec<Place>>,
    columns: Columns,
    error: Option<io::Error>,
}

/// A field of a layout.
struct Place {
    title: String,
    /// Known from its first value on.
    column: Option<u16>,
}

/// All columns there are.
struct Columns {
    titles: Vec<String>,
    numbers: HashMap<String, u16, FixedState>,
    most: usize,
    /// Values without a column.
    left_out: u64,
}

impl<W: Write, S: Read + Write + Seek> CsvWide<W, S> {
    /// Writes to `output` what waited in `spool`, which should be empty.
    fn new(output: W, spool: S) -> Self {
        Self {
            output,
            spool: Spool::new(spool),
            groups: Groups::default(),
            columns: Columns::new(MOST_COLUMNS),
            error: None,
        }
    }

    fn row(&mut self, event: &Event, bus: &Bus, carried: &Carried<'_>) -> io::Result<()> {
        let Some(places) = self.groups.of(carried, || places(carried, bus)) else { return Ok(()) };
        let row = self.spool.begin();
        if let Some(Timestamp(time)) = event.time {
            push_seconds(row, time);
        }
        push_cell(row, bus.name());
        row.push(b',');
        push_decimal(row, event.frames.last);
        for (signal, place) in carried.with(places) {
            if let Some(column) = self.columns.of(place) {
                push_value(self.spool.cell(column), values::told(&signal).value);
            }
        }
        self.spool.end()
    }

    fn table(&mut self) -> io::Result<()> {
        let Some(mut rows) = self.spool.take()? else { return Ok(()) };
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
        self.groups = Groups::default();
    }

    fn write(&mut self, event: &Event, bus: &Bus) -> bool {
        if let Some(carried) = values::carried(event).filter(|_| self.error.is_none()) {
            self.error = self.row(event, bus, &carried).err();
        }
        true
    }

    /// Writes the table.
    fn finish(&mut self) -> io::Result<()> {
        match self.error.take() {
            Some(error) => Err(error),
            None => self.table(),
        }
    }

    fn has_failed(&self) -> bool {
        self.error.is_some()
    }

    fn remark(&self) -> Option<String> {
        let values = self.columns.left_out;
        (values > 0).then(|| {
            format!(
                "{values} values of further signals are left out: there is a column for {MOST_COLUMNS}; --filter chooses, \
                 -f csv has all"
            )
        })
    }
}

/// Replaces a line by the next row with all its columns; `false` behind the last one.
fn push_row<S: Read>(rows: &mut Rows<S>, columns: usize, line: &mut Vec<u8>) -> io::Result<bool> {
    line.clear();
    let Some(row) = rows.next()? else { return Ok(false) };
    line.extend_from_slice(row.before);
    let mut next = 0;
    for (column, cell) in row.cells {
        let column = usize::from(column);
        line.resize(line.len() + column.saturating_sub(next), b',');
        // A cell has its comma in front.
        line.extend_from_slice(cell);
        next = column + 1;
    }
    line.resize(line.len() + columns.saturating_sub(next), b',');
    Ok(true)
}

impl Columns {
    fn new(most: usize) -> Self {
        Self { titles: Vec::new(), numbers: HashMap::default(), most, left_out: 0 }
    }

    /// The column of a field that has a value: that of its title, else a new one while there is room.
    fn of(&mut self, place: &mut Place) -> Option<u16> {
        if place.column.is_none() {
            place.column = self.numbers.get(&place.title).copied().or_else(|| self.add(&place.title));
        }
        if place.column.is_none() {
            self.left_out = self.left_out.saturating_add(1);
        }
        place.column
    }

    fn add(&mut self, title: &str) -> Option<u16> {
        let number = u16::try_from(self.titles.len()).ok().filter(|_| self.titles.len() < self.most)?;
        self.titles.push(title.to_owned());
        self.numbers.insert(title.to_owned(), number);
        Some(number)
    }
}

/// What the fields of a layout are called, each once: with a number behind the second of a name.
fn places(carried: &Carried<'_>, bus: &Bus) -> Vec<Place> {
    let group = values::name(carried.group, bus);
    titles(&group, carried).into_iter().map(|title| Place { title, column: None }).collect()
}

fn titles(group: &str, carried: &Carried<'_>) -> Vec<String> {
    let mut titles: Vec<String> = Vec::new();
    for field in &carried.layout.fields {
        let unit = values::unit(field);
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
    use crate::profile::{DataType, Field, Layout};
    use crate::sink::values::Group;
    use crate::wire::canopen::ObjectAddress;

    #[test]
    fn a_name_that_comes_twice_gets_a_number() {
        let field = |index| Field::of_object(ObjectAddress::new(index, 0), 0, 8, DataType::Unsigned8);
        let fields = vec![field(0x6041), field(0x6041), field(0x6042), field(0x6041)];
        let layout = Arc::new(Layout { fields, ..Layout::default() });
        let group = Group::Frame(BusIndex::default(), CanId::Standard(0x123));
        let carried = Carried { group, layout: &layout, payload: &[] };
        assert_eq!(titles("g", &carried), ["g 6041:00", "g 6041:00 2", "g 6042:00", "g 6041:00 3"]);
    }

    #[test]
    fn there_are_so_many_columns_and_no_more() {
        let mut columns = Columns::new(2);
        let mut place = |title: &str| columns.of(&mut Place { title: title.to_owned(), column: None });
        assert_eq!(
            [place("a"), place("b"), place("c"), place("a"), place("d")],
            [Some(0), Some(1), None, Some(0), None]
        );
        assert_eq!(columns.left_out, 2);
    }

    #[test]
    fn every_row_has_a_place_for_every_column() {
        let mut spool = Spool::new(Cursor::new(Vec::new()));
        spool.begin().extend_from_slice(b"t,b,1");
        spool.cell(1).extend_from_slice(b",5");
        spool.cell(3).extend_from_slice(b",7");
        spool.end().unwrap();
        let mut rows = spool.take().unwrap().unwrap();
        let mut line = Vec::new();
        assert!(push_row(&mut rows, 5, &mut line).unwrap());
        assert_eq!(line, b"t,b,1,,5,,7,");
        assert!(!push_row(&mut rows, 5, &mut line).unwrap());
    }
}
