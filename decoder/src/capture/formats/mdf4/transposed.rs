//! Conversion of transposed data to rows.

/// Bytes that are converted together, in each direction.
const SIDE: usize = 8;

/// Replaces the content of `rows` by the rows of transposed data, of `row` bytes each; bytes after the last row remain.
pub(super) fn to_rows(columns: &[u8], row: usize, rows: &mut Vec<u8>) {
    let count = columns.len() / row;
    let (matrix, rest) = columns.split_at(count * row);
    // Bytes of an earlier content are replaced one by one: they need no zeros.
    rows.resize(columns.len(), 0);
    let (converted, end) = rows.split_at_mut(matrix.len());
    end.copy_from_slice(rest);
    // A row is at most 4 GiB long, which times 8 exceeds the addresses of WebAssembly.
    for (block, rows) in converted.chunks_mut(row.saturating_mul(SIDE)).enumerate() {
        for (group, columns) in matrix.chunks(count.saturating_mul(SIDE)).enumerate() {
            let place = SquarePlace { row: block * SIDE, column: group * SIDE };
            if !convert_square(columns, count, rows, row, place) {
                convert_bytes(columns, count, rows, row, place);
            }
        }
    }
}

/// The first row and column of some bytes.
#[derive(Clone, Copy)]
struct SquarePlace {
    row: usize,
    column: usize,
}

/// Converts eight bytes of eight columns; `false` if there are fewer.
fn convert_square(columns: &[u8], count: usize, rows: &mut [u8], row: usize, at: SquarePlace) -> bool {
    let mut square = [0; SIDE];
    let mut columns = columns.chunks_exact(count);
    for word in &mut square {
        let column = columns.next().and_then(|column| column.get(at.row..)).and_then(<[u8]>::first_chunk);
        let Some(bytes) = column else { return false };
        *word = u64::from_le_bytes(*bytes);
    }
    for (word, row) in transpose(square).iter().zip(rows.chunks_exact_mut(row)) {
        if let Some(place) = row.get_mut(at.column..).and_then(<[u8]>::first_chunk_mut) {
            *place = word.to_le_bytes();
        }
    }
    true
}

/// Converts single bytes at the edges.
fn convert_bytes(columns: &[u8], count: usize, rows: &mut [u8], row: usize, at: SquarePlace) {
    for (index, column) in columns.chunks_exact(count).enumerate() {
        let column = column.get(at.row..).unwrap_or_default();
        let places = rows.iter_mut().skip(at.column + index).step_by(row);
        places.zip(column).for_each(|(place, byte)| *place = *byte);
    }
}

/// Byte `n` of word `m` becomes byte `m` of word `n`.
fn transpose(mut square: [u64; SIDE]) -> [u64; SIDE] {
    for (distance, bits, low) in
        [(4, 32, 0x0000_0000_FFFF_FFFF_u64), (2, 16, 0x0000_FFFF_0000_FFFF), (1, 8, 0x00FF_00FF_00FF_00FF)]
    {
        for pair in square.chunks_exact_mut(2 * distance) {
            let (upper, lower) = pair.split_at_mut(distance);
            for (a, b) in upper.iter_mut().zip(lower) {
                (*a, *b) = (*a & low | (*b & low) << bits, (*a >> bits) & low | *b & !low);
            }
        }
    }
    square
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn rows(columns: &[u8], row: usize) -> Vec<u8> {
        let mut rows = b"earlier".to_vec();
        to_rows(columns, row, &mut rows);
        rows
    }

    #[test]
    fn columns_become_rows() {
        assert_eq!(rows(b"adbecfxy", 3), b"abcdefxy");
        assert_eq!(rows(b"ab", 3), b"ab");
        assert_eq!(rows(b"", 3), b"");
        assert_eq!(rows(b"ab", usize::MAX / 2), b"ab");
    }

    proptest! {
        #[test]
        fn each_byte_is_in_its_row(row in 2_usize..40, count in 0_usize..40, rest in 0_usize..40) {
            let (whole, rest) = (row * count, rest % row);
            let columns: Vec<u8> = (0..whole + rest).map(|place| (place * 7 + place / 256).to_le_bytes()[0]).collect();
            let rows = rows(&columns, row);
            prop_assert_eq!(rows.len(), columns.len());
            for (place, byte) in rows.iter().enumerate() {
                // Byte n of row m is in place n * count + m.
                let from = if place < whole { place % row * count + place / row } else { place };
                prop_assert_eq!(*byte, columns[from]);
            }
        }
    }
}
