//! Tables of results that commands write as JSON: findings, stories, objects.

use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::sink::escape;
use serde_json::Value;

use crate::columns::{ArrowKind, BooleanColumn, NameColumn, NumberColumn, TextColumn, table_schema};

/// A table of results: its name, and each column with its type and place in a record.
pub struct RecordTable {
    /// Name of the table.
    pub name: &'static str,
    columns: &'static [(&'static str, ArrowKind, CellPlace)],
}

/// Place of a cell in a record.
#[derive(Clone, Copy)]
enum CellPlace {
    /// JSON pointer.
    At(&'static str),
    /// JSON pointer to an object: `5208:02`, as in other tables, in place of `0x5208:02`.
    Object(&'static str),
    /// Texts of `lines`, one below the other.
    Lines,
    /// The whole record as JSON.
    Whole,
}

/// Findings of `check -f jsonl`.
pub const FINDINGS: RecordTable = RecordTable {
    name: "findings",
    columns: &[
        ("time", ArrowKind::Time, CellPlace::At("/occurrences/0/t")),
        ("capture", ArrowKind::Name, CellPlace::At("/capture")),
        ("bus", ArrowKind::Name, CellPlace::At("/bus")),
        ("first_frame", ArrowKind::Number, CellPlace::At("/occurrences/0/frames/0")),
        ("last_frame", ArrowKind::Number, CellPlace::At("/occurrences/0/frames/1")),
        ("finding", ArrowKind::Number, CellPlace::At("/finding")),
        ("fingerprint", ArrowKind::Text, CellPlace::At("/fingerprint")),
        ("rule", ArrowKind::Name, CellPlace::At("/rule")),
        ("title", ArrowKind::Name, CellPlace::At("/title")),
        ("severity", ArrowKind::Name, CellPlace::At("/severity")),
        ("standing", ArrowKind::Name, CellPlace::At("/standing")),
        ("suppressed", ArrowKind::Text, CellPlace::At("/suppressed")),
        ("protocol", ArrowKind::Name, CellPlace::At("/protocol")),
        ("node", ArrowKind::Number, CellPlace::At("/node")),
        ("node_name", ArrowKind::Name, CellPlace::At("/node_name")),
        ("about", ArrowKind::Name, CellPlace::At("/about")),
        ("text", ArrowKind::Text, CellPlace::At("/text")),
        ("count", ArrowKind::Number, CellPlace::At("/count")),
        ("duration", ArrowKind::Real, CellPlace::At("/duration")),
        ("lasts", ArrowKind::Truth, CellPlace::At("/lasts")),
        ("cause_finding", ArrowKind::Number, CellPlace::At("/cause_finding")),
        ("member_of", ArrowKind::Number, CellPlace::At("/member_of")),
        ("next_step", ArrowKind::Text, CellPlace::At("/next_step")),
        ("manual", ArrowKind::Text, CellPlace::At("/manual")),
        ("json", ArrowKind::Text, CellPlace::Whole),
    ],
};

/// Stories of `why -f json`.
pub const STORIES: RecordTable = RecordTable {
    name: "stories",
    columns: &[
        ("capture", ArrowKind::Name, CellPlace::At("/capture")),
        ("bus", ArrowKind::Name, CellPlace::At("/bus")),
        ("first_frame", ArrowKind::Number, CellPlace::At("/frames/0")),
        ("last_frame", ArrowKind::Number, CellPlace::At("/frames/1")),
        ("story", ArrowKind::Number, CellPlace::At("/story")),
        ("severity", ArrowKind::Name, CellPlace::At("/severity")),
        ("node", ArrowKind::Number, CellPlace::At("/node")),
        ("seconds", ArrowKind::Real, CellPlace::At("/seconds")),
        ("title", ArrowKind::Text, CellPlace::At("/title")),
        ("cause_visible", ArrowKind::Truth, CellPlace::At("/cause_visible")),
        ("text", ArrowKind::Text, CellPlace::Lines),
        ("json", ArrowKind::Text, CellPlace::Whole),
    ],
};

/// Objects of `objects -f json`.
pub const OBJECTS: RecordTable = RecordTable {
    name: "objects",
    columns: &[
        ("capture", ArrowKind::Name, CellPlace::At("/capture")),
        ("bus", ArrowKind::Name, CellPlace::At("/bus")),
        ("frame", ArrowKind::Number, CellPlace::At("/frame")),
        ("node", ArrowKind::Number, CellPlace::At("/node")),
        ("object", ArrowKind::Name, CellPlace::Object("/object")),
        ("name", ArrowKind::Name, CellPlace::At("/name")),
        ("value", ArrowKind::Real, CellPlace::At("/value")),
        ("text", ArrowKind::Text, CellPlace::At("/value")),
        ("unit", ArrowKind::Name, CellPlace::At("/unit")),
        ("data", ArrowKind::Text, CellPlace::At("/data")),
        ("size", ArrowKind::Number, CellPlace::At("/size")),
        ("origin", ArrowKind::Name, CellPlace::At("/origin")),
        ("stale", ArrowKind::Truth, CellPlace::At("/stale")),
        ("persists", ArrowKind::Name, CellPlace::At("/persists")),
        ("json", ArrowKind::Text, CellPlace::Whole),
    ],
};

impl RecordTable {
    /// Columns.
    pub fn schema(&self) -> SchemaRef {
        let columns: Vec<_> = self.columns.iter().map(|(name, kind, _)| (*name, *kind)).collect();
        table_schema(&columns)
    }

    /// One row per record.
    ///
    /// # Errors
    /// If the columns are inconsistent.
    pub fn build_batch(&self, records: &[Value]) -> Result<RecordBatch, ArrowError> {
        let columns = self.columns.iter().map(|(_, kind, place)| build_column(*kind, *place, records));
        RecordBatch::try_new(self.schema(), columns.collect::<Result<_, _>>()?)
    }
}

fn build_column(kind: ArrowKind, place: CellPlace, records: &[Value]) -> Result<ArrayRef, ArrowError> {
    let cells = records.iter().map(|record| match place {
        CellPlace::At(pointer) => record.pointer(pointer).cloned(),
        CellPlace::Object(pointer) => {
            let object = record.pointer(pointer).and_then(Value::as_str);
            object.map(|object| Value::String(object.trim_start_matches("0x").to_owned()))
        }
        CellPlace::Lines => Some(Value::String(joined_lines(record))),
        CellPlace::Whole => Some(Value::String(record.to_string())),
    });
    match kind {
        ArrowKind::Name => {
            let mut column = NameColumn::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_str)));
            column.take_rows()
        }
        ArrowKind::Text | ArrowKind::Bytes => {
            let mut column = TextColumn::default();
            for cell in cells {
                match (place, cell.as_ref().and_then(Value::as_str)) {
                    // JSON has its own escapes, and lines are escaped one by one.
                    (CellPlace::Whole | CellPlace::Lines, Some(text)) => column.push_bytes(text.as_bytes()),
                    (_, text) => column.push(text),
                }
            }
            column.take_rows()
        }
        ArrowKind::Number => {
            let mut column = NumberColumn::<i64>::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_i64)));
            Ok(column.take_rows())
        }
        ArrowKind::Real => {
            let mut column = NumberColumn::<f64>::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_f64)));
            Ok(column.take_rows())
        }
        ArrowKind::Time => {
            let mut column = NumberColumn::<i64>::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_f64).map(to_micros)));
            Ok(column.take_times())
        }
        ArrowKind::Truth => {
            let mut column = BooleanColumn::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_bool)));
            Ok(column.take_rows())
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "saturates")]
fn to_micros(seconds: f64) -> i64 {
    (seconds * 1e6).round() as i64
}

fn joined_lines(record: &Value) -> String {
    let lines = record.get("lines").and_then(Value::as_array).into_iter().flatten();
    let texts: Vec<_> = lines.filter_map(|line| line.get("text")?.as_str().map(escape)).collect();
    texts.join("\n")
}
