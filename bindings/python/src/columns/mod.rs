//! Columns that grow by rows and become Arrow arrays, each of one type.

mod names;
mod numbers;
mod texts;

use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray};
use arrow_schema::{DataType, Field, Schema, SchemaRef, TimeUnit};

pub use names::{Key, NameColumn, dictionary_array};
pub use numbers::{NumberColumn, NumberParts};
pub use texts::TextColumn;

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArrowKind {
    /// Microseconds since 1970, UTC.
    Time,
    /// Signed integers.
    Number,
    /// Floating-point numbers.
    Real,
    /// Booleans.
    Truth,
    /// Texts that repeat: a dictionary.
    Name,
    /// Texts that rarely repeat.
    Text,
    /// Bytes.
    Bytes,
}

/// Schema of a table; every column may contain nulls.
pub fn table_schema(columns: &[(&str, ArrowKind)]) -> SchemaRef {
    let field = |(name, kind): &(&str, ArrowKind)| {
        let data_type = match kind {
            ArrowKind::Time => DataType::Timestamp(TimeUnit::Microsecond, Some(UTC.into())),
            ArrowKind::Number => DataType::Int64,
            ArrowKind::Real => DataType::Float64,
            ArrowKind::Truth => DataType::Boolean,
            ArrowKind::Name => DataType::Dictionary(DataType::Int32.into(), DataType::Utf8.into()),
            ArrowKind::Text => DataType::Utf8,
            ArrowKind::Bytes => DataType::Binary,
        };
        Field::new(*name, data_type, true)
    };
    Arc::new(Schema::new(columns.iter().map(field).collect::<Vec<_>>()))
}

const UTC: &str = "UTC";

/// Booleans with nulls.
#[derive(Default)]
pub struct BooleanColumn(Vec<Option<bool>>);

impl BooleanColumn {
    /// Adds a row.
    pub fn push(&mut self, value: Option<bool>) {
        self.0.push(value);
    }

    /// The rows so far.
    pub fn take_rows(&mut self) -> ArrayRef {
        Arc::new(std::mem::take(&mut self.0).into_iter().collect::<BooleanArray>())
    }
}
