//! Columns that grow by rows and become Arrow arrays, each of one type.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::types::Int32Type;
use arrow_array::{
    ArrayRef, BinaryArray, BooleanArray, DictionaryArray, Float64Array, Int32Array, Int64Array, StringArray,
    TimestampMicrosecondArray,
};
use arrow_buffer::{NullBuffer, NullBufferBuilder, OffsetBuffer, ScalarBuffer};
use arrow_schema::{ArrowError, DataType, Field, Schema, SchemaRef, TimeUnit};
use cobscope_decoder::sink::escape;

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

/// Numbers with nulls.
pub struct Numbers<T> {
    values: Vec<T>,
    valid: NullBufferBuilder,
}

impl<T: Copy + Default> Numbers<T> {
    /// Adds a row.
    #[inline]
    pub fn push(&mut self, value: Option<T>) {
        match value {
            Some(value) => self.push_value(value),
            None => {
                self.values.push(T::default());
                self.valid.append_null();
            }
        }
    }

    /// Adds a row with a value.
    #[inline]
    pub fn push_value(&mut self, value: T) {
        self.values.push(value);
        self.valid.append_non_null();
    }
}

impl<T> Default for Numbers<T> {
    fn default() -> Self {
        Self { values: Vec::new(), valid: NullBufferBuilder::new(0) }
    }
}

impl Numbers<i64> {
    /// The rows so far as integers.
    pub fn take(&mut self) -> ArrayRef {
        Arc::new(Int64Array::new(ScalarBuffer::from(std::mem::take(&mut self.values)), self.valid.finish()))
    }

    /// The rows so far as times in microseconds.
    pub fn take_times(&mut self) -> ArrayRef {
        let values = ScalarBuffer::from(std::mem::take(&mut self.values));
        Arc::new(TimestampMicrosecondArray::new(values, self.valid.finish()).with_timezone(UTC))
    }
}

impl Numbers<f64> {
    /// The rows so far.
    pub fn take(&mut self) -> ArrayRef {
        Arc::new(Float64Array::new(ScalarBuffer::from(std::mem::take(&mut self.values)), self.valid.finish()))
    }
}

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

/// Number of a text in [`Names`].
pub type Key = i32;

/// Texts that repeat. All batches of a table share one dictionary, which grows.
#[derive(Default)]
pub struct Names {
    keys: Numbers<Key>,
    numbers: HashMap<Box<str>, Key>,
    texts: Vec<Box<str>>,
    array: Option<ArrayRef>,
}

impl Names {
    /// Number of a text, which is escaped.
    pub fn key(&mut self, text: &str) -> Key {
        if let Some(key) = self.numbers.get(text) {
            return *key;
        }
        let key = Key::try_from(self.texts.len()).unwrap_or(Key::MAX);
        self.numbers.insert(text.into(), key);
        self.texts.push(escape(text).into());
        self.array = None;
        key
    }

    /// Adds a row with a number of [`Self::key`].
    #[inline]
    pub fn push_key(&mut self, key: Option<Key>) {
        self.keys.push(key);
    }

    /// Adds a row.
    pub fn push(&mut self, text: Option<&str>) {
        let key = text.map(|text| self.key(text));
        self.keys.push(key);
    }

    /// The rows so far.
    ///
    /// # Errors
    /// If there are more texts than numbers for them.
    pub fn take(&mut self) -> Result<ArrayRef, ArrowError> {
        let texts = &self.texts;
        let values = self.array.get_or_insert_with(|| Arc::new(StringArray::from_iter_values(texts)));
        let values = Arc::clone(values);
        let keys = std::mem::take(&mut self.keys.values);
        let keys = Int32Array::new(ScalarBuffer::from(keys), self.keys.valid.finish());
        Ok(Arc::new(DictionaryArray::<Int32Type>::try_new(keys, values)?))
    }
}

/// Texts or bytes that rarely repeat.
pub struct Texts {
    bytes: Vec<u8>,
    ends: Vec<i32>,
    valid: NullBufferBuilder,
}

impl Default for Texts {
    fn default() -> Self {
        Self { bytes: Vec::new(), ends: vec![0], valid: NullBufferBuilder::new(0) }
    }
}

impl Texts {
    /// Adds a row with an escaped text.
    pub fn push(&mut self, text: Option<&str>) {
        match text {
            Some(text) => self.push_bytes(escape(text).as_bytes()),
            None => {
                self.ends.push(self.end());
                self.valid.append_null();
            }
        }
    }

    /// Adds a row with bytes as they are.
    pub fn push_bytes(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
        self.ends.push(self.end());
        self.valid.append_non_null();
    }

    /// Number of bytes since the last array; a batch ends long before the limit of the offsets.
    pub fn size(&self) -> usize {
        self.bytes.len()
    }

    fn end(&self) -> i32 {
        i32::try_from(self.bytes.len()).unwrap_or(i32::MAX)
    }

    fn parts(&mut self) -> (OffsetBuffer<i32>, Vec<u8>, Option<NullBuffer>) {
        let ends = std::mem::replace(&mut self.ends, vec![0]);
        (OffsetBuffer::new(ScalarBuffer::from(ends)), std::mem::take(&mut self.bytes), self.valid.finish())
    }

    /// The rows so far as texts.
    ///
    /// # Errors
    /// If a row of bytes is no text.
    pub fn take(&mut self) -> Result<ArrayRef, ArrowError> {
        let (ends, bytes, valid) = self.parts();
        Ok(Arc::new(StringArray::try_new(ends, bytes.into(), valid)?))
    }

    /// The rows so far as bytes.
    ///
    /// # Errors
    /// If the column is inconsistent.
    pub fn take_bytes(&mut self) -> Result<ArrayRef, ArrowError> {
        let (ends, bytes, valid) = self.parts();
        Ok(Arc::new(BinaryArray::try_new(ends, bytes.into(), valid)?))
    }
}
