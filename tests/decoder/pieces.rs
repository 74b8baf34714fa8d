//! Files damaged like bad copies: parts of them overwrite others.

use proptest::prelude::*;
use proptest::sample::Index;

/// One of `files` with parts of it copied over others, so that the defects are not only in the first lines.
pub fn pieces_moved(files: Vec<Vec<u8>>) -> impl Strategy<Value = Vec<u8>> {
    let cuts = prop::collection::vec((any::<Index>(), any::<Index>(), 0..40_usize), 1..12);
    (prop::sample::select(files), cuts).prop_map(|(mut file, cuts)| {
        for (from, to, length) in cuts {
            let (from, to) = (from.index(file.len()), to.index(file.len()));
            let piece = file[from..(from + length).min(file.len())].to_vec();
            let end = (to + length / 2).min(file.len());
            file.splice(to..end, piece);
        }
        file
    })
}
