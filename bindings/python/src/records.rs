//! Tables of results that commands write as JSON: findings, stories, objects.

use arrow_array::{ArrayRef, RecordBatch};
use arrow_schema::{ArrowError, SchemaRef};
use cobscope_decoder::sink::escape;
use serde_json::Value;

use crate::columns::{Kind, Names, Numbers, Texts, Truths, schema};

/// A table of results: its name, and each column with its type and place in a record.
pub struct RecordTable {
    /// Name of the table.
    pub name: &'static str,
    columns: &'static [(&'static str, Kind, Place)],
}

/// Place of a cell in a record.
#[derive(Clone, Copy)]
enum Place {
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
        ("time", Kind::Time, Place::At("/occurrences/0/t")),
        ("capture", Kind::Name, Place::At("/capture")),
        ("bus", Kind::Name, Place::At("/bus")),
        ("first_frame", Kind::Number, Place::At("/occurrences/0/frames/0")),
        ("last_frame", Kind::Number, Place::At("/occurrences/0/frames/1")),
        ("finding", Kind::Number, Place::At("/finding")),
        ("fingerprint", Kind::Text, Place::At("/fingerprint")),
        ("rule", Kind::Name, Place::At("/rule")),
        ("title", Kind::Name, Place::At("/title")),
        ("severity", Kind::Name, Place::At("/severity")),
        ("standing", Kind::Name, Place::At("/standing")),
        ("suppressed", Kind::Text, Place::At("/suppressed")),
        ("protocol", Kind::Name, Place::At("/protocol")),
        ("node", Kind::Number, Place::At("/node")),
        ("node_name", Kind::Name, Place::At("/node_name")),
        ("about", Kind::Name, Place::At("/about")),
        ("text", Kind::Text, Place::At("/text")),
        ("count", Kind::Number, Place::At("/count")),
        ("duration", Kind::Real, Place::At("/duration")),
        ("lasts", Kind::Truth, Place::At("/lasts")),
        ("cause_finding", Kind::Number, Place::At("/cause_finding")),
        ("member_of", Kind::Number, Place::At("/member_of")),
        ("next_step", Kind::Text, Place::At("/next_step")),
        ("manual", Kind::Text, Place::At("/manual")),
        ("json", Kind::Text, Place::Whole),
    ],
};

/// Stories of `why -f json`.
pub const STORIES: RecordTable = RecordTable {
    name: "stories",
    columns: &[
        ("capture", Kind::Name, Place::At("/capture")),
        ("bus", Kind::Name, Place::At("/bus")),
        ("first_frame", Kind::Number, Place::At("/frames/0")),
        ("last_frame", Kind::Number, Place::At("/frames/1")),
        ("story", Kind::Number, Place::At("/story")),
        ("severity", Kind::Name, Place::At("/severity")),
        ("node", Kind::Number, Place::At("/node")),
        ("seconds", Kind::Real, Place::At("/seconds")),
        ("title", Kind::Text, Place::At("/title")),
        ("cause_visible", Kind::Truth, Place::At("/cause_visible")),
        ("text", Kind::Text, Place::Lines),
        ("json", Kind::Text, Place::Whole),
    ],
};

/// Objects of `objects -f json`.
pub const OBJECTS: RecordTable = RecordTable {
    name: "objects",
    columns: &[
        ("capture", Kind::Name, Place::At("/capture")),
        ("bus", Kind::Name, Place::At("/bus")),
        ("frame", Kind::Number, Place::At("/frame")),
        ("node", Kind::Number, Place::At("/node")),
        ("object", Kind::Name, Place::Object("/object")),
        ("name", Kind::Name, Place::At("/name")),
        ("value", Kind::Real, Place::At("/value")),
        ("text", Kind::Text, Place::At("/value")),
        ("unit", Kind::Name, Place::At("/unit")),
        ("data", Kind::Text, Place::At("/data")),
        ("size", Kind::Number, Place::At("/size")),
        ("origin", Kind::Name, Place::At("/origin")),
        ("stale", Kind::Truth, Place::At("/stale")),
        ("persists", Kind::Name, Place::At("/persists")),
        ("json", Kind::Text, Place::Whole),
    ],
};

impl RecordTable {
    /// Columns.
    pub fn schema(&self) -> SchemaRef {
        let columns: Vec<_> = self.columns.iter().map(|(name, kind, _)| (*name, *kind)).collect();
        schema(&columns)
    }

    /// One row per record.
    ///
    /// # Errors
    /// If the columns are inconsistent.
    pub fn batch(&self, records: &[Value]) -> Result<RecordBatch, ArrowError> {
        let columns = self.columns.iter().map(|(_, kind, place)| column(*kind, *place, records));
        RecordBatch::try_new(self.schema(), columns.collect::<Result<_, _>>()?)
    }
}

fn column(kind: Kind, place: Place, records: &[Value]) -> Result<ArrayRef, ArrowError> {
    let cells = records.iter().map(|record| match place {
        Place::At(pointer) => record.pointer(pointer).cloned(),
        Place::Object(pointer) => {
            let object = record.pointer(pointer).and_then(Value::as_str);
            object.map(|object| Value::String(object.trim_start_matches("0x").to_owned()))
        }
        Place::Lines => Some(Value::String(lines(record))),
        Place::Whole => Some(Value::String(record.to_string())),
    });
    match kind {
        Kind::Name => {
            let mut column = Names::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_str)));
            column.take()
        }
        Kind::Text | Kind::Bytes => {
            let mut column = Texts::default();
            for cell in cells {
                match (place, cell.as_ref().and_then(Value::as_str)) {
                    // JSON has its own escapes, and lines are escaped one by one.
                    (Place::Whole | Place::Lines, Some(text)) => column.push_bytes(text.as_bytes()),
                    (_, text) => column.push(text),
                }
            }
            column.take()
        }
        Kind::Number => {
            let mut column = Numbers::<i64>::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_i64)));
            Ok(column.take())
        }
        Kind::Real => {
            let mut column = Numbers::<f64>::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_f64)));
            Ok(column.take())
        }
        Kind::Time => {
            let mut column = Numbers::<i64>::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_f64).map(micros)));
            Ok(column.take_times())
        }
        Kind::Truth => {
            let mut column = Truths::default();
            cells.for_each(|cell| column.push(cell.as_ref().and_then(Value::as_bool)));
            Ok(column.take())
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "saturates")]
fn micros(seconds: f64) -> i64 {
    (seconds * 1e6).round() as i64
}

fn lines(record: &Value) -> String {
    let lines = record.get("lines").and_then(Value::as_array).into_iter().flatten();
    let texts: Vec<_> = lines.filter_map(|line| line.get("text")?.as_str().map(escape)).collect();
    texts.join("\n")
}
