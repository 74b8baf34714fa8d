//! Rows by identifier and remote flag, found without a search.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::frame::{CanId, Frame, FrameFlags};

/// Number of 11-bit identifiers, each with and without remote flag.
const STANDARD: usize = 2 * 2048;

/// Marks an identifier without a row.
const NONE: u16 = u16::MAX;

/// Row numbers by identifier and remote flag, on one bus.
#[derive(Debug, Clone, Default)]
pub(super) struct IdentifierIndex {
    /// Empty until the first 11-bit identifier.
    standard: Vec<u16>,
    extended: HashMap<u32, u16, FixedState>,
}

impl IdentifierIndex {
    /// Row number of the identifier of a frame: `rows`, the number of all rows, if it is new. None for a new
    /// identifier if there are `most` rows.
    #[inline]
    pub(super) fn row_of(&mut self, frame: &Frame, rows: usize, most: usize) -> Option<usize> {
        if let CanId::Standard(id) = frame.id
            && let Some(found) = self.standard.get(standard_key(id, frame))
            && *found != NONE
        {
            return Some(usize::from(*found));
        }
        self.place_of_other(frame, rows, most)
    }

    /// The same for a 29-bit identifier or a new one.
    #[inline(never)]
    fn place_of_other(&mut self, frame: &Frame, rows: usize, most: usize) -> Option<usize> {
        let is_remote = frame.flags.contains(FrameFlags::REMOTE);
        let found = match frame.id {
            CanId::Standard(id) => {
                if self.standard.is_empty() {
                    self.standard = vec![NONE; STANDARD];
                }
                self.standard.get_mut(standard_key(id, frame))?
            }
            CanId::Extended(id) => {
                let key = id << 1 | u32::from(is_remote);
                if rows >= most {
                    self.extended.get_mut(&key)?
                } else {
                    self.extended.entry(key).or_insert(NONE)
                }
            }
        };
        if *found == NONE {
            if rows >= most {
                return None;
            }
            *found = u16::try_from(rows).ok()?;
        }
        Some(usize::from(*found))
    }

    /// Memory in use, in bytes.
    pub(super) fn footprint(&self) -> usize {
        self.standard.len() * size_of::<u16>() + self.extended.capacity() * size_of::<(u32, u16)>()
    }
}

/// Index of an 11-bit identifier in [`IdentifierIndex::standard`].
#[inline]
fn standard_key(id: u16, frame: &Frame) -> usize {
    usize::from(id) << 1 | usize::from(frame.flags.contains(FrameFlags::REMOTE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_have_the_number_of_their_first_appearance() {
        let mut index = IdentifierIndex::default();
        let short = Frame::data_frame(CanId::from_standard(0x705), &[]);
        let long = Frame::data_frame(CanId::from_extended(0x705), &[]);
        let of_remote = |frame| Frame { flags: FrameFlags::REMOTE, ..frame };
        let frames = [short, of_remote(short), long, of_remote(long)];
        for (row, frame) in frames.iter().enumerate() {
            assert_eq!(index.row_of(frame, row, 4), Some(row));
        }
        assert_eq!(frames.map(|frame| index.row_of(&frame, 4, 4)), [0, 1, 2, 3].map(Some));
        for id in [CanId::from_standard(1), CanId::from_extended(1)] {
            assert_eq!(index.row_of(&Frame::data_frame(id, &[]), 4, 4), None, "{id}");
        }
    }
}
