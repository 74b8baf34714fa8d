//! Columns of numbers and times.

use std::iter::repeat_n;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, Int64Array, TimestampMicrosecondArray};
use arrow_buffer::{ArrowNativeType, NullBuffer, NullBufferBuilder, ScalarBuffer};

use super::UTC;

/// Values of a column, and which of them are not null.
pub struct NumberParts<T: ArrowNativeType> {
    pub(super) values: ScalarBuffer<T>,
    pub(super) valid: Option<NullBuffer>,
}

impl<T: ArrowNativeType> NumberParts<T> {
    /// One value per row.
    pub fn of_rows(rows: impl Iterator<Item = Option<T>> + Clone) -> Self {
        let mut nulls = 0;
        let values = rows.clone().map(|value| {
            nulls += usize::from(value.is_none());
            value.unwrap_or_default()
        });
        let values = ScalarBuffer::from(values.collect::<Vec<T>>());
        let valid = (nulls > 0).then(|| rows.map(|value| value.is_some()).collect());
        Self { values, valid }
    }

    /// Values of `count` rows, of which each applies to some.
    pub fn of_runs(runs: impl Iterator<Item = (Option<T>, usize)>, count: usize) -> Self {
        let mut column = NumberColumn::default();
        column.values.reserve(count);
        runs.for_each(|(value, count)| column.push_times(value, count));
        column.take_parts()
    }

    fn of_nulls(count: usize) -> Self {
        Self {
            values: ScalarBuffer::from(vec![T::default(); count]),
            valid: Some(NullBuffer::new_null(count)),
        }
    }

    /// The first rows, which share the memory of all.
    pub(super) fn first_rows(&self, count: usize) -> Self {
        let valid = self.valid.as_ref().map(|valid| valid.slice(0, count));
        Self { values: self.values.slice(0, count), valid }
    }
}

impl NumberParts<i64> {
    /// The values as integers.
    pub fn into_numbers(self) -> ArrayRef {
        Arc::new(Int64Array::new(self.values, self.valid))
    }

    /// The values as times in microseconds.
    pub fn into_times(self) -> ArrayRef {
        Arc::new(TimestampMicrosecondArray::new(self.values, self.valid).with_timezone(UTC))
    }
}

/// Numbers with nulls. Nulls at the end are only counted, so that an empty column costs nothing.
pub struct NumberColumn<T: ArrowNativeType> {
    values: Vec<T>,
    valid: NullBufferBuilder,
    /// Nulls after the last value.
    nulls: usize,
    /// Memory of batches that consist of nulls.
    blank: Option<NumberParts<T>>,
}

impl<T: ArrowNativeType> NumberColumn<T> {
    /// Adds a row.
    #[inline]
    pub fn push(&mut self, value: Option<T>) {
        let Some(value) = value else {
            self.nulls += 1;
            return;
        };
        if self.nulls > 0 {
            self.end_nulls();
        }
        self.values.push(value);
        self.valid.append_non_null();
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
        self.values.extend(repeat_n(value, count));
        self.valid.append_n_non_nulls(count);
    }

    #[cold]
    fn end_nulls(&mut self) {
        self.values.resize(self.values.len() + self.nulls, T::default());
        self.valid.append_n_nulls(std::mem::take(&mut self.nulls));
    }

    /// The rows so far; the next batch probably has as many.
    pub(super) fn take_parts(&mut self) -> NumberParts<T> {
        if self.values.is_empty() && self.nulls > 0 {
            let count = std::mem::take(&mut self.nulls);
            let known = self.blank.take().filter(|known| known.values.len() >= count);
            return self
                .blank
                .insert(known.unwrap_or_else(|| NumberParts::of_nulls(count)))
                .first_rows(count);
        }
        if self.nulls > 0 {
            self.end_nulls();
        }
        let next = Vec::with_capacity(self.values.len());
        let values = ScalarBuffer::from(std::mem::replace(&mut self.values, next));
        NumberParts { values, valid: self.valid.finish() }
    }
}

impl<T: ArrowNativeType> Default for NumberColumn<T> {
    fn default() -> Self {
        Self { values: Vec::new(), valid: NullBufferBuilder::new(0), nulls: 0, blank: None }
    }
}

impl NumberColumn<i64> {
    /// The rows so far as integers.
    pub fn take_rows(&mut self) -> ArrayRef {
        self.take_parts().into_numbers()
    }

    /// The rows so far as times in microseconds.
    pub fn take_times(&mut self) -> ArrayRef {
        self.take_parts().into_times()
    }
}

impl NumberColumn<f64> {
    /// The rows so far.
    pub fn take_rows(&mut self) -> ArrayRef {
        let NumberParts { values, valid } = self.take_parts();
        Arc::new(Float64Array::new(values, valid))
    }
}
