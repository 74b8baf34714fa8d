//! Columns that grow by rows and become Arrow arrays, each of one type.

use std::collections::HashMap;
use std::sync::Arc;

use arrow_array::types::Int32Type;
use arrow_array::{
    ArrayRef, BinaryArray, BooleanArray, DictionaryArray, Float64Array, Int32Array, Int64Array, StringArray,
    TimestampMicrosecondArray,
};
use arrow_buffer::{ArrowNativeType, NullBuffer, NullBufferBuilder, OffsetBuffer, ScalarBuffer};
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

/// Numbers with nulls. Nulls at the end are only counted, so that an empty column costs nothing.
pub struct Numbers<T> {
    values: Vec<T>,
    valid: NullBufferBuilder,
    /// Nulls after the last value.
    nulls: usize,
}

impl<T: Copy + Default> Numbers<T> {
    /// Adds a row.
    #[inline]
    pub fn push(&mut self, value: Option<T>) {
        self.push_times(value, 1);
    }

    /// Adds equal rows.
    #[inline]
    pub fn push_times(&mut self, value: Option<T>, count: usize) {
        let Some(value) = value else {
            self.nulls += count;
            return;
        };
        if self.nulls > 0 {
            self.end_nulls();
        }
        if count == 1 {
            self.values.push(value);
        } else {
            self.values.resize(self.values.len() + count, value);
        }
        self.valid.append_n_non_nulls(count);
    }

    #[cold]
    fn end_nulls(&mut self) {
        self.values.resize(self.values.len() + self.nulls, T::default());
        self.valid.append_n_nulls(std::mem::take(&mut self.nulls));
    }

    /// The rows so far; the next batch probably has as many.
    fn parts(&mut self) -> (ScalarBuffer<T>, Option<NullBuffer>)
    where
        T: ArrowNativeType,
    {
        if self.nulls > 0 {
            self.end_nulls();
        }
        let next = Vec::with_capacity(self.values.len());
        (ScalarBuffer::from(std::mem::replace(&mut self.values, next)), self.valid.finish())
    }
}

impl<T> Default for Numbers<T> {
    fn default() -> Self {
        Self { values: Vec::new(), valid: NullBufferBuilder::new(0), nulls: 0 }
    }
}

impl Numbers<i64> {
    /// The rows so far as integers.
    pub fn take(&mut self) -> ArrayRef {
        let (values, valid) = self.parts();
        Arc::new(Int64Array::new(values, valid))
    }

    /// The rows so far as times in microseconds.
    pub fn take_times(&mut self) -> ArrayRef {
        let (values, valid) = self.parts();
        Arc::new(TimestampMicrosecondArray::new(values, valid).with_timezone(UTC))
    }
}

impl Numbers<f64> {
    /// The rows so far.
    pub fn take(&mut self) -> ArrayRef {
        let (values, valid) = self.parts();
        Arc::new(Float64Array::new(values, valid))
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

    /// Number of different texts.
    pub fn size(&self) -> usize {
        self.texts.len()
    }

    /// Forgets all texts and their numbers; only directly after [`Self::take`].
    pub fn forget(&mut self) {
        (self.numbers, self.texts, self.array) = (HashMap::new(), Vec::new(), None);
    }

    /// Adds equal rows with a number of [`Self::key`].
    #[inline]
    pub fn push_keys(&mut self, key: Option<Key>, count: usize) {
        self.keys.push_times(key, count);
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
        let (keys, valid) = self.keys.parts();
        let keys = Int32Array::new(keys, valid);
        Ok(Arc::new(DictionaryArray::<Int32Type>::try_new(keys, values)?))
    }
}

/// Texts or bytes that rarely repeat. Nulls at the end are only counted.
pub struct Texts {
    bytes: Vec<u8>,
    ends: Vec<i32>,
    valid: NullBufferBuilder,
    /// Nulls after the last text.
    nulls: usize,
}

impl Default for Texts {
    fn default() -> Self {
        Self { bytes: Vec::new(), ends: vec![0], valid: NullBufferBuilder::new(0), nulls: 0 }
    }
}

impl Texts {
    /// Adds a row with an escaped text.
    #[inline]
    pub fn push(&mut self, text: Option<&str>) {
        match text {
            Some(text) => self.push_bytes(escape(text).as_bytes()),
            None => self.nulls += 1,
        }
    }

    /// Adds a row with bytes as they are.
    pub fn push_bytes(&mut self, bytes: &[u8]) {
        if self.nulls > 0 {
            self.end_nulls();
        }
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

    fn end_nulls(&mut self) {
        let end = self.end();
        self.ends.resize(self.ends.len() + self.nulls, end);
        self.valid.append_n_nulls(std::mem::take(&mut self.nulls));
    }

    fn parts(&mut self) -> (OffsetBuffer<i32>, Vec<u8>, Option<NullBuffer>) {
        if self.nulls > 0 {
            self.end_nulls();
        }
        let ends = std::mem::replace(&mut self.ends, vec![0]);
        (OffsetBuffer::new(ScalarBuffer::from(ends)), std::mem::take(&mut self.bytes), self.valid.finish())
    }

    /// The rows so far as texts.
    ///
    /// # Errors
    /// If a row of bytes is not a text.
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
