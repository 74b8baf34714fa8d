//! One Parquet file. Rows are buffered by column and written in row groups.

use std::borrow::Cow;
use std::collections::HashMap;
use std::io::{self, Write};
use std::mem;
use std::sync::Arc;

use foldhash::fast::FixedState;
use parquet::basic::{Compression, Encoding, LogicalType, Repetition, TimeUnit, Type as Physical, ZstdLevel};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{ColumnPath, Type, TypePtr};

use crate::escape::escape;

/// Maximum number of rows in a group. Memory is bounded to one group plus some hundred bytes per finished
/// group.
const MOST_ROWS: usize = 64 * 1024;

/// Maximum buffered size of a group, in bytes.
const MOST_BYTES: usize = 8 * 1024 * 1024;

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ColumnType {
    /// Time in µs since 1970, UTC: what every engine reads as a time.
    Time,
    /// Signed integers, mostly rising.
    Rising,
    /// Signed integers.
    Number,
    /// Floating-point numbers.
    Real,
    /// Booleans.
    Truth,
    /// Texts that repeat often.
    Name,
    /// Texts that rarely repeat.
    Text,
    /// JSON as text, not escaped; all other texts are escaped.
    Json,
}

/// Description of a column.
#[derive(Debug, Clone)]
pub(super) struct ColumnHeading {
    pub(super) name: Cow<'static, str>,
    pub(super) kind: ColumnType,
    /// Whether the column can contain [`RowCell::Null`].
    pub(super) is_optional: bool,
}

/// A column with a value in every row.
pub(super) const fn required_column(name: &'static str, kind: ColumnType) -> ColumnHeading {
    ColumnHeading { name: Cow::Borrowed(name), kind, is_optional: false }
}

/// A column with optional values.
pub(super) const fn optional_column(name: &'static str, kind: ColumnType) -> ColumnHeading {
    ColumnHeading { name: Cow::Borrowed(name), kind, is_optional: true }
}

/// A value of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum RowCell<'a> {
    Null,
    Number(i64),
    Real(f64),
    Truth(bool),
    Text(&'a str),
}

impl<'a> RowCell<'a> {
    /// [`RowCell::Null`] for `None`.
    pub(super) fn text_or_null(text: Option<&'a str>) -> Self {
        text.map_or(Self::Null, Self::Text)
    }
}

/// Writer for one table.
pub(super) struct TableWriter<W: Write + Send> {
    file: SerializedFileWriter<W>,
    columns: Vec<ColumnValues>,
    /// Values of the last columns, which are the same in every row.
    constants: Vec<ByteArray>,
    rows: usize,
    bytes: usize,
    most_bytes: usize,
}

impl<W: Write + Send> TableWriter<W> {
    /// Starts a file with these columns, followed by columns with the same text in every row.
    ///
    /// # Errors
    /// If the header cannot be written.
    pub(super) fn new(
        output: W,
        headings: &[ColumnHeading],
        constants: &[(&'static str, &str)],
    ) -> io::Result<Self> {
        Self::with_limit(output, headings, constants, MOST_BYTES)
    }

    /// Like [`Self::new`], with another maximum size of a buffered group in bytes.
    ///
    /// # Errors
    /// If the header cannot be written.
    pub(super) fn with_limit(
        output: W,
        headings: &[ColumnHeading],
        constants: &[(&'static str, &str)],
        most_bytes: usize,
    ) -> io::Result<Self> {
        let further = constants.iter().map(|(name, _)| required_column(name, ColumnType::Name));
        let all: Vec<_> = headings.iter().cloned().chain(further).collect();
        let begun = table_schema(&all)
            .and_then(|schema| SerializedFileWriter::new(output, schema, Arc::new(writer_properties(&all)?)));
        let columns = headings.iter().map(ColumnValues::new).collect();
        let constants = constants.iter().map(|(_, text)| ByteArray::from(&*escape(text))).collect();
        Ok(Self { file: begun.map_err(io_error)?, columns, constants, rows: 0, bytes: 0, most_bytes })
    }

    /// Adds a row, with the cells in the order of the headings.
    ///
    /// # Errors
    /// If a full row group cannot be written.
    pub(super) fn push(&mut self, cells: &[RowCell<'_>]) -> io::Result<()> {
        for (column, cell) in self.columns.iter_mut().zip(cells) {
            self.bytes = self.bytes.saturating_add(column.push(*cell));
        }
        self.rows += 1;
        if self.rows >= MOST_ROWS || self.bytes >= self.most_bytes {
            return self.end_group();
        }
        Ok(())
    }

    fn end_group(&mut self) -> io::Result<()> {
        let rows = mem::take(&mut self.rows);
        if rows == 0 {
            return Ok(());
        }
        self.bytes = 0;
        self.write_group(rows).map_err(io_error)
    }

    fn write_group(&mut self, rows: usize) -> Result<(), ParquetError> {
        let mut group = self.file.next_row_group()?;
        for column in &mut self.columns {
            column.write_column(&mut group)?;
        }
        for text in &self.constants {
            let Some(mut writer) = group.next_column()? else { break };
            writer.typed::<ByteArrayType>().write_batch(&vec![text.clone(); rows], None, None)?;
            writer.close()?;
        }
        group.close()?;
        Ok(())
    }

    /// Writes the remaining rows and the file index, without which the file is unreadable.
    ///
    /// # Errors
    /// If they cannot be written.
    pub(super) fn finish_table(&mut self) -> io::Result<()> {
        self.end_group()?;
        self.file.finish().map_err(io_error)?;
        Ok(())
    }

    /// As [`Self::finish_table`]; returns the output.
    ///
    /// # Errors
    /// If they cannot be written.
    pub(super) fn into_inner(mut self) -> io::Result<W> {
        self.end_group()?;
        self.file.into_inner().map_err(io_error)
    }
}

/// Values of a column in the current row group.
struct ColumnValues {
    is_optional: bool,
    escapes: bool,
    /// Definition level of each row: 1 with a value, 0 without.
    levels: Vec<i16>,
    values: ColumnBuffer,
}

enum ColumnBuffer {
    Numbers(Vec<i64>),
    Reals(Vec<f64>),
    Truths(Vec<bool>),
    Names(DistinctTexts),
    Texts(ConcatenatedTexts),
}

impl ColumnValues {
    fn new(heading: &ColumnHeading) -> Self {
        let values = match heading.kind {
            ColumnType::Time | ColumnType::Rising | ColumnType::Number => ColumnBuffer::Numbers(Vec::new()),
            ColumnType::Real => ColumnBuffer::Reals(Vec::new()),
            ColumnType::Truth => ColumnBuffer::Truths(Vec::new()),
            ColumnType::Name => ColumnBuffer::Names(DistinctTexts::default()),
            ColumnType::Text | ColumnType::Json => ColumnBuffer::Texts(ConcatenatedTexts::default()),
        };
        let escapes = heading.kind != ColumnType::Json;
        Self { is_optional: heading.is_optional, escapes, levels: Vec::new(), values }
    }

    /// Adds a value, or null for a value of the wrong type. Returns the number of bytes used.
    fn push(&mut self, cell: RowCell<'_>) -> usize {
        let taken = match (&mut self.values, cell) {
            (ColumnBuffer::Numbers(values), RowCell::Number(value)) => {
                values.push(value);
                Some(size_of::<i64>())
            }
            (ColumnBuffer::Reals(values), RowCell::Real(value)) => {
                values.push(value);
                Some(size_of::<f64>())
            }
            (ColumnBuffer::Truths(values), RowCell::Truth(value)) => {
                values.push(value);
                Some(size_of::<bool>())
            }
            (ColumnBuffer::Names(names), RowCell::Text(text)) => Some(names.push(&escape(text))),
            (ColumnBuffer::Texts(texts), RowCell::Text(text)) if self.escapes => {
                Some(texts.push(&escape(text)))
            }
            (ColumnBuffer::Texts(texts), RowCell::Text(text)) => Some(texts.push(text)),
            _ => None,
        };
        self.levels.push(i16::from(taken.is_some()));
        taken.unwrap_or(0) + size_of::<i16>()
    }

    /// Writes all values as the next column of a row group and clears the buffer.
    fn write_column<W: Write + Send>(
        &mut self,
        group: &mut SerializedRowGroupWriter<'_, W>,
    ) -> Result<(), ParquetError> {
        let Some(mut writer) = group.next_column()? else { return Ok(()) };
        let levels = self.is_optional.then_some(self.levels.as_slice());
        match &mut self.values {
            ColumnBuffer::Numbers(values) => {
                writer.typed::<Int64Type>().write_batch(values, levels, None)?;
                values.clear();
            }
            ColumnBuffer::Reals(values) => {
                writer.typed::<DoubleType>().write_batch(values, levels, None)?;
                values.clear();
            }
            ColumnBuffer::Truths(values) => {
                writer.typed::<BoolType>().write_batch(values, levels, None)?;
                values.clear();
            }
            ColumnBuffer::Names(names) => {
                writer.typed::<ByteArrayType>().write_batch(&names.take_texts(), levels, None)?;
            }
            ColumnBuffer::Texts(texts) => {
                writer.typed::<ByteArrayType>().write_batch(&texts.take_texts(), levels, None)?;
            }
        }
        self.levels.clear();
        writer.close()
    }
}

/// Repeated texts; each distinct text is stored once.
#[derive(Default)]
struct DistinctTexts {
    numbers: HashMap<Box<str>, usize, FixedState>,
    distinct: Vec<ByteArray>,
    rows: Vec<usize>,
}

impl DistinctTexts {
    fn push(&mut self, text: &str) -> usize {
        if let Some(number) = self.numbers.get(text) {
            self.rows.push(*number);
            return size_of::<usize>();
        }
        self.rows.push(self.distinct.len());
        self.numbers.insert(text.into(), self.distinct.len());
        self.distinct.push(ByteArray::from(text));
        // The text is stored as a key and as a value.
        size_of::<usize>() + 2 * (text.len() + size_of::<ByteArray>())
    }

    fn take_texts(&mut self) -> Vec<ByteArray> {
        let all = self.rows.iter().filter_map(|number| self.distinct.get(*number).cloned()).collect();
        self.numbers.clear();
        self.distinct.clear();
        self.rows.clear();
        all
    }
}

/// Concatenated texts.
#[derive(Default)]
struct ConcatenatedTexts {
    bytes: Vec<u8>,
    lengths: Vec<usize>,
}

impl ConcatenatedTexts {
    fn push(&mut self, text: &str) -> usize {
        self.bytes.extend_from_slice(text.as_bytes());
        self.lengths.push(text.len());
        text.len() + size_of::<usize>()
    }

    fn take_texts(&mut self) -> Vec<ByteArray> {
        let bytes = ByteArray::from(mem::take(&mut self.bytes));
        let mut start = 0;
        let piece = |length| {
            let piece = bytes.slice(start, length);
            start += length;
            piece
        };
        self.lengths.drain(..).map(piece).collect()
    }
}

fn table_schema(headings: &[ColumnHeading]) -> Result<TypePtr, ParquetError> {
    let fields = headings.iter().map(|heading| {
        let (physical, logical) = match heading.kind {
            // Spark reads no nanoseconds.
            ColumnType::Time => (Physical::INT64, Some(LogicalType::timestamp(true, TimeUnit::MICROS))),
            ColumnType::Rising | ColumnType::Number => (Physical::INT64, None),
            ColumnType::Real => (Physical::DOUBLE, None),
            ColumnType::Truth => (Physical::BOOLEAN, None),
            // Polars reads the logical type of JSON as bytes.
            ColumnType::Name | ColumnType::Text | ColumnType::Json => {
                (Physical::BYTE_ARRAY, Some(LogicalType::String))
            }
        };
        let repetition = if heading.is_optional { Repetition::OPTIONAL } else { Repetition::REQUIRED };
        let name = escape(&heading.name);
        let field = Type::primitive_type_builder(&name, physical);
        field.with_repetition(repetition).with_logical_type(logical).build().map(Arc::new)
    });
    let fields = fields.collect::<Result<Vec<_>, _>>()?;
    Ok(Arc::new(Type::group_type_builder("cobscope").with_fields(fields).build()?))
}

fn writer_properties(headings: &[ColumnHeading]) -> Result<WriterProperties, ParquetError> {
    let version = env!("CARGO_PKG_VERSION");
    let mut properties = WriterProperties::builder()
        .set_created_by(format!("cobscope version {version}"))
        .set_key_value_metadata(Some(vec![KeyValue::new("cobscope.version".to_owned(), version.to_owned())]))
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(3)?))
        // Statistics per page would stay in memory until the end.
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_offset_index_disabled(true);
    for heading in headings {
        let path = ColumnPath::from(vec![escape(&heading.name).into_owned()]);
        properties = match heading.kind {
            ColumnType::Time | ColumnType::Rising => properties
                .set_column_dictionary_enabled(path.clone(), false)
                .set_column_encoding(path, Encoding::DELTA_BINARY_PACKED),
            ColumnType::Text | ColumnType::Json => properties.set_column_dictionary_enabled(path, false),
            _ => properties,
        };
    }
    Ok(properties.build())
}

/// The underlying I/O error, if there is one.
fn io_error(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(inner) => match inner.downcast::<io::Error>() {
            Ok(error) => *error,
            Err(other) => io::Error::other(other),
        },
        other => io::Error::other(other),
    }
}

#[cfg(test)]
mod tests {
    use parquet::file::metadata::RowGroupMetaData;
    use parquet::file::reader::{FileReader as _, SerializedFileReader};

    use super::*;

    const HEADINGS: &[ColumnHeading] = &[
        optional_column("n", ColumnType::Number),
        optional_column("x", ColumnType::Real),
        optional_column("b", ColumnType::Truth),
        required_column("s", ColumnType::Name),
        optional_column("t", ColumnType::Text),
        optional_column("j", ColumnType::Json),
    ];

    /// A table that alternates between rows with and without optional values.
    fn written(rows: usize, text: &str) -> SerializedFileReader<bytes::Bytes> {
        let mut out = Vec::new();
        let mut table = TableWriter::new(&mut out, HEADINGS, &[]).unwrap();
        for row in 0..rows {
            let all = [RowCell::Number(-7), RowCell::Real(0.5), RowCell::Truth(true), RowCell::Text("a\x1b")];
            let little = [RowCell::Null, RowCell::Null, RowCell::Null, RowCell::Text("b")];
            let (row, end) = if row % 2 == 0 { (all, RowCell::Text(text)) } else { (little, RowCell::Null) };
            table.push(&[&row[..], &[end, end]].concat()).unwrap();
        }
        table.finish_table().unwrap();
        drop(table);
        SerializedFileReader::new(out.into()).unwrap()
    }

    #[test]
    fn texts_are_escaped_except_json() {
        let rows: Vec<_> =
            written(3, "\"\x07\"").get_row_iter(None).unwrap().map(|row| row.unwrap().to_string()).collect();
        let all = r#"{n: -7, x: 0.5, b: true, s: "a\u{1b}", t: ""\u{7}"", j: ""#.to_owned() + "\"\x07\"\"}";
        let little = r#"{n: null, x: null, b: null, s: "b", t: null, j: null}"#.to_owned();
        assert_eq!(rows, [all.clone(), little, all]);
    }

    #[test]
    fn groups_of_rows_are_bounded_by_rows_and_bytes() {
        let rows = |reader: SerializedFileReader<bytes::Bytes>| -> Vec<i64> {
            reader.metadata().row_groups().iter().map(RowGroupMetaData::num_rows).collect()
        };
        assert_eq!(rows(written(MOST_ROWS + 1, "{}")), [65_536, 1]);
        // Every second row contains two texts of 1 MiB, so the eighth MiB ends the group.
        assert_eq!(rows(written(14, &"x".repeat(1024 * 1024))), [7, 7]);
        assert_eq!(rows(written(0, "")), [0_i64; 0]);
    }

    #[test]
    fn the_first_write_error_is_the_error_of_the_output() {
        let mut place = [0; 64];
        let mut table =
            TableWriter::new(place.as_mut_slice(), &[required_column("n", ColumnType::Number)], &[]).unwrap();
        table.push(&[RowCell::Number(1)]).unwrap();
        assert_eq!(table.finish_table().unwrap_err().kind(), io::ErrorKind::WriteZero);
    }
}
