//! Columns that grow by rows and become Arrow arrays, each of one type.

mod names;
mod numbers;
mod texts;

use std::sync::Arc;

use arrow_array::{ArrayRef, BooleanArray};
use arrow_schema::{DataType, Field, Schema, SchemaRef, TimeUnit};

pub use names::{Key, Names, dictionary};
pub use numbers::{Numbers, Parts};
pub use texts::Texts;

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
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
pub fn schema(columns: &[(&str, Kind)]) -> SchemaRef {
    let field = |(name, kind): &(&str, Kind)| {
        let data_type = match kind {
            Kind::Time => DataType::Timestamp(TimeUnit::Microsecond, Some(UTC.into())),
            Kind::Number => DataType::Int64,
            Kind::Real => DataType::Float64,
            Kind::Truth => DataType::Boolean,
            Kind::Name => DataType::Dictionary(DataType::Int32.into(), DataType::Utf8.into()),
            Kind::Text => DataType::Utf8,
            Kind::Bytes => DataType::Binary,
        };
        Field::new(*name, data_type, true)
    };
    Arc::new(Schema::new(columns.iter().map(field).collect::<Vec<_>>()))
}

const UTC: &str = "UTC";

/// Booleans with nulls.
#[derive(Default)]
pub struct Truths(Vec<Option<bool>>);

impl Truths {
    /// Adds a row.
    pub fn push(&mut self, value: Option<bool>) {
        self.0.push(value);
    }

    /// The rows so far.
    pub fn take(&mut self) -> ArrayRef {
        Arc::new(std::mem::take(&mut self.0).into_iter().collect::<BooleanArray>())
    }
}
