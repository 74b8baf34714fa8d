//! Blocks of an MDF4 capture.
//!
//! ```text
//! 0 ## and two letters   8 length with header (8)   16 number of links (8)   24 links (8 each), then data
//! ```
//! A link is a byte offset in the capture, 0 for none. Numbers are little-endian.

use crate::capture::byte_order::ByteOrder::Little;

/// Title of the format.
pub(super) const TITLE: &str = "ASAM MDF";

/// Size of the header before the links, in bytes.
const HEADER: usize = 24;

/// A block of a capture.
#[derive(Debug, Clone, Copy)]
pub(super) struct MdfBlock<'a> {
    /// Block type: the two letters after `##`.
    pub(super) kind: [u8; 2],
    /// Byte offset in the capture.
    pub(super) at: u64,
    links: &'a [u8],
    /// Data after the links.
    pub(super) data: &'a [u8],
    /// Declared length in bytes, and whether the capture ends before it.
    pub(super) length: u64,
    pub(super) is_cut_off: bool,
}

impl<'a> MdfBlock<'a> {
    /// Parses the block at a byte offset; `None` if there is none.
    pub(super) fn parse_at(file: &'a [u8], at: u64) -> Option<Self> {
        let rest = file.get(usize::try_from(at).ok()?..)?;
        let [b'#', b'#', first, second] = *rest.first_chunk()? else { return None };
        let length = Little.u64(rest, 8)?;
        let links = usize::try_from(Little.u64(rest, 16)?).ok()?.checked_mul(8)?;
        let whole = usize::try_from(length).unwrap_or(usize::MAX);
        let block = rest.get(..whole).unwrap_or(rest);
        let links = block.get(HEADER..)?.get(..links)?;
        let data = block.get(HEADER + links.len()..)?;
        Some(Self { kind: [first, second], at, links, data, length, is_cut_off: block.len() < whole })
    }

    /// Parses the block at a byte offset; `None` if it does not have this type.
    pub(super) fn parse_kind_at(file: &'a [u8], at: u64, kind: [u8; 2]) -> Option<Self> {
        Self::parse_at(file, at).filter(|block| block.kind == kind)
    }

    /// Target of a link; `None` if the block has no such link or the link is 0.
    pub(super) fn link_target(&self, index: usize) -> Option<u64> {
        Little.u64(self.links, index.checked_mul(8)?).filter(|link| *link != 0)
    }

    /// Number of links.
    pub(super) fn link_count(&self) -> usize {
        self.links.len() / 8
    }

    /// Byte offset of the data in the capture.
    pub(super) fn data_at(&self) -> u64 {
        self.at.saturating_add((HEADER + self.links.len()) as u64)
    }

    /// One byte of the data at an offset.
    pub(super) fn u8(&self, at: usize) -> Option<u8> {
        self.data.get(at).copied()
    }

    /// Two bytes of the data at an offset.
    pub(super) fn u16(&self, at: usize) -> Option<u16> {
        Little.u16(self.data, at)
    }

    /// Four bytes of the data at an offset.
    pub(super) fn u32(&self, at: usize) -> Option<u32> {
        Little.u32(self.data, at)
    }

    /// Eight bytes of the data at an offset.
    pub(super) fn u64(&self, at: usize) -> Option<u64> {
        Little.u64(self.data, at)
    }
}

/// Whether the capture ends within the block at this byte offset.
pub(super) fn is_cut_off(file: &[u8], at: u64) -> bool {
    let rest = usize::try_from(at).ok().and_then(|at| file.get(at..)).unwrap_or_default();
    Little.u64(rest, 8).is_none_or(|length| rest.starts_with(b"##") && length > rest.len() as u64)
}

/// Text of a text block, without the zeros at its end.
pub(super) fn text_at(file: &[u8], at: Option<u64>) -> Option<&[u8]> {
    let block = MdfBlock::parse_kind_at(file, at?, *b"TX")?;
    block.data.split(|byte| *byte == 0).next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_is_read_as_far_as_the_capture_goes() {
        let mut file = vec![0; 8];
        file.extend(b"##TX\0\0\0\0");
        file.extend([34_u64, 1, 8].iter().flat_map(|number| number.to_le_bytes()));
        file.extend(b"a\0");
        let block = MdfBlock::parse_at(&file, 8).unwrap();
        assert_eq!(
            (block.kind, block.link_target(0), block.link_target(1), block.data_at()),
            (*b"TX", Some(8), None, 40)
        );
        assert_eq!((block.data, block.is_cut_off), (&b"a\0"[..], false));
        assert_eq!(text_at(&file, Some(8)), Some(&b"a"[..]));
        assert!(MdfBlock::parse_at(&file[..41], 8).unwrap().is_cut_off);
        assert!(is_cut_off(&file[..41], 8) && is_cut_off(&file[..12], 8) && is_cut_off(&file, 42));
        assert!(!is_cut_off(&file, 8) && !is_cut_off(&file, 0), "none is there");
        assert!(MdfBlock::parse_at(&file, 7).is_none() && MdfBlock::parse_at(&file, u64::MAX).is_none());
    }

    #[test]
    fn more_links_than_there_is_room_for_are_none() {
        let mut file = b"##DG\0\0\0\0".to_vec();
        file.extend([32_u64, 2, 0].iter().flat_map(|number| number.to_le_bytes()));
        assert!(MdfBlock::parse_at(&file, 0).is_none());
        file[16..24].copy_from_slice(&u64::MAX.to_le_bytes());
        assert!(MdfBlock::parse_at(&file, 0).is_none());
    }
}
