//! Spooled rows: the leading columns of each row, then its cells sorted by column.
//!
//! ```text
//! row    length of the rest (4 bytes), length (4 bytes) and bytes of the leading columns, cells
//! cell   column (2 bytes), length (4 bytes), bytes
//! ```

use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::ops::Range;

/// Buffer size for reading and writing, in bytes.
const BUFFER: usize = 64 * 1024;

/// Writer of spooled rows.
pub(super) struct RowSpool<S: Write> {
    /// `None` after `take`.
    file: Option<BufWriter<S>>,
    rows: u64,
    /// Bytes of the current row: leading columns, then cells.
    row: Vec<u8>,
    /// Column and start offset of each cell in `row`.
    cells: Vec<(u16, usize)>,
    packed: Vec<u8>,
}

/// Reader of spooled rows.
pub(super) struct SpooledRows<S> {
    file: BufReader<S>,
    left: u64,
    row: Vec<u8>,
}

/// A spooled row.
pub(super) struct SpooledRow<'a> {
    pub(super) before: &'a [u8],
    pub(super) cells: SpooledCells<'a>,
}

/// Cells of a row, sorted by column.
pub(super) struct SpooledCells<'a>(&'a [u8]);

impl<S: Read + Write + Seek> RowSpool<S> {
    pub(super) fn new(file: S) -> Self {
        let file = Some(BufWriter::with_capacity(BUFFER, file));
        Self { file, rows: 0, row: Vec::new(), cells: Vec::new(), packed: Vec::new() }
    }

    /// Starts a row; the caller appends its leading columns.
    pub(super) fn begin_row(&mut self) -> &mut Vec<u8> {
        self.row.clear();
        self.cells.clear();
        &mut self.row
    }

    /// Starts a cell of the current row; the caller appends its bytes.
    pub(super) fn begin_cell(&mut self, column: u16) -> &mut Vec<u8> {
        self.cells.push((column, self.row.len()));
        &mut self.row
    }

    /// Ends the current row; a row without cells is dropped.
    ///
    /// # Errors
    /// If the spool cannot be written.
    pub(super) fn end_row(&mut self) -> io::Result<()> {
        let Some(file) = self.file.as_mut().filter(|_| !self.cells.is_empty()) else { return Ok(()) };
        let ends = self.cells.iter().skip(1).map(|(_, start)| *start).chain([self.row.len()]);
        let mut cells: Vec<(u16, Range<usize>)> =
            self.cells.iter().zip(ends).map(|((column, start), end)| (*column, *start..end)).collect();
        cells.sort_unstable_by_key(|(column, _)| *column);
        self.packed.clear();
        let before = self.cells.first().map_or(0, |(_, start)| *start);
        push_piece(&mut self.packed, self.row.get(..before))?;
        for (column, bytes) in cells {
            self.packed.extend_from_slice(&column.to_le_bytes());
            push_piece(&mut self.packed, self.row.get(bytes))?;
        }
        file.write_all(&length_prefix(&self.packed)?)?;
        self.rows += 1;
        file.write_all(&self.packed)
    }

    /// All rows in order; `None` if they were already taken.
    ///
    /// # Errors
    /// If buffered rows cannot be written.
    pub(super) fn take_rows(&mut self) -> io::Result<Option<SpooledRows<S>>> {
        let Some(file) = self.file.take() else { return Ok(None) };
        let mut file = file.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.rewind()?;
        let file = BufReader::with_capacity(BUFFER, file);
        Ok(Some(SpooledRows { file, left: self.rows, row: Vec::new() }))
    }
}

fn push_piece(packed: &mut Vec<u8>, bytes: Option<&[u8]>) -> io::Result<()> {
    let bytes = bytes.unwrap_or_default();
    packed.extend_from_slice(&length_prefix(bytes)?);
    packed.extend_from_slice(bytes);
    Ok(())
}

fn length_prefix(bytes: &[u8]) -> io::Result<[u8; 4]> {
    let length = u32::try_from(bytes.len()).map_err(|_| io::Error::other("a row has more than 4 GiB"))?;
    Ok(length.to_le_bytes())
}

impl<S: Read> SpooledRows<S> {
    /// The next row; `None` after the last one.
    ///
    /// # Errors
    /// If the spool cannot be read.
    pub(super) fn next(&mut self) -> io::Result<Option<SpooledRow<'_>>> {
        if self.left == 0 {
            return Ok(None);
        }
        self.left -= 1;
        let mut length = [0; 4];
        self.file.read_exact(&mut length)?;
        self.row.resize(u32::from_le_bytes(length) as usize, 0);
        self.file.read_exact(&mut self.row)?;
        let mut rest = self.row.as_slice();
        let before = take_piece(&mut rest).unwrap_or_default();
        Ok(Some(SpooledRow { before, cells: SpooledCells(rest) }))
    }
}

impl<'a> Iterator for SpooledCells<'a> {
    type Item = (u16, &'a [u8]);

    fn next(&mut self) -> Option<Self::Item> {
        let (column, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some((u16::from_le_bytes(*column), take_piece(&mut self.0)?))
    }
}

fn take_piece<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let (length, behind) = rest.split_first_chunk()?;
    let (piece, behind) = behind.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    *rest = behind;
    Some(piece)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn rows_come_back_with_their_cells_by_column() {
        let mut spool = RowSpool::new(Cursor::new(Vec::new()));
        spool.begin_row().extend_from_slice(b"1.0,can0,7");
        spool.begin_cell(3).extend_from_slice(b",-2");
        spool.begin_cell(0).extend_from_slice(b",text");
        spool.end_row().unwrap();
        spool.begin_row().extend_from_slice(b"a row without cells");
        spool.end_row().unwrap();
        spool.begin_row();
        spool.begin_cell(1);
        spool.end_row().unwrap();
        let mut rows = spool.take_rows().unwrap().unwrap();
        let row = rows.next().unwrap().unwrap();
        assert_eq!(row.before, b"1.0,can0,7");
        assert_eq!(row.cells.collect::<Vec<_>>(), [(0, b",text".as_slice()), (3, b",-2")]);
        let row = rows.next().unwrap().unwrap();
        assert_eq!((row.before, row.cells.collect::<Vec<_>>()), (b"".as_slice(), vec![(1, b"".as_slice())]));
        assert!(rows.next().unwrap().is_none());
        assert!(spool.take_rows().unwrap().is_none());
    }

    #[test]
    fn a_full_spool_reports_an_error() {
        let mut place = [0; 8];
        let mut spool = RowSpool::new(Cursor::new(place.as_mut_slice()));
        spool.begin_row().extend_from_slice(b"1.0,can0,7");
        spool.begin_cell(0);
        spool.end_row().unwrap();
        assert!(spool.take_rows().is_err());
    }
}
