//! Columns of texts and bytes that rarely repeat.

use std::sync::Arc;

use arrow_array::{ArrayRef, BinaryArray, StringArray};
use arrow_buffer::{NullBuffer, NullBufferBuilder, OffsetBuffer, ScalarBuffer};
use arrow_schema::ArrowError;
use cobscope_decoder::sink::escape;

/// Texts or bytes that rarely repeat. Nulls at the end are only counted.
pub struct TextColumn {
    bytes: Vec<u8>,
    ends: Vec<i32>,
    valid: NullBufferBuilder,
    /// Nulls after the last text.
    nulls: usize,
    /// Memory of batches that consist of nulls.
    blank: Option<(OffsetBuffer<i32>, NullBuffer)>,
}

impl Default for TextColumn {
    fn default() -> Self {
        Self { bytes: Vec::new(), ends: vec![0], valid: NullBufferBuilder::new(0), nulls: 0, blank: None }
    }
}

impl TextColumn {
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

    fn take_parts(&mut self) -> (OffsetBuffer<i32>, Vec<u8>, Option<NullBuffer>) {
        if self.ends.len() == 1 && self.nulls > 0 {
            let count = std::mem::take(&mut self.nulls);
            let known = self.blank.take().filter(|(_, valid)| valid.len() >= count);
            let (ends, valid) = self.blank.insert(
                known.unwrap_or_else(|| (OffsetBuffer::new_zeroed(count), NullBuffer::new_null(count))),
            );
            return (ends.slice(0, count), Vec::new(), Some(valid.slice(0, count)));
        }
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
    pub fn take_rows(&mut self) -> Result<ArrayRef, ArrowError> {
        let (ends, bytes, valid) = self.take_parts();
        Ok(Arc::new(StringArray::try_new(ends, bytes.into(), valid)?))
    }

    /// The rows so far as bytes.
    ///
    /// # Errors
    /// If the column is inconsistent.
    pub fn take_bytes(&mut self) -> Result<ArrayRef, ArrowError> {
        let (ends, bytes, valid) = self.take_parts();
        Ok(Arc::new(BinaryArray::try_new(ends, bytes.into(), valid)?))
    }
}
