//! Data of a group or a channel: one block, or a list of blocks, compressed or not.
//!
//! ```text
//! DT, SD  uncompressed data; DV the same from 4.2 on
//! DZ      0 original block type (2)  4 row size (4)
//!         2 compression (1): 0 zlib, 2 zstd, 4 LZ4 (from 4.3 on); 1, 3, 5 the same, transposed
//!         8 uncompressed size (8)  16 compressed size (8)  24 compressed bytes
//! DL      links: 0 next list, then data blocks           HL  links: 0 first list
//! LD      links: 0 next list, then data blocks, then blocks of invalidation bits if bit 31 of the flags is set
//!         0 flags (4)  4 number of data blocks (4)
//! ```
//! Transposed data contain the first bytes of all rows, then the second bytes, and so on; an incomplete row
//! is last ([`super::transposed`]).

use std::collections::BTreeSet;
use std::sync::Arc;

use super::block::MdfBlock;
use super::transposed::to_rows;
use crate::capture::inflate::{Codec, Decompression};

/// Number of bytes before the compressed data.
const ZIP_HEADER: usize = 24;
/// Compressions; an odd number means that the content is transposed.
const CODECS: &[(u8, Codec)] = &[(0, Codec::Zlib), (2, Codec::Zstd), (4, Codec::Lz4)];
const TRANSPOSED: u8 = 1;
/// Flag of an LD block.
const SEPARATE_VALIDITY: u32 = 1 << 31;

/// Maximum accepted content of a compressed block in bytes; the standard allows 4 MiB.
const LARGEST_CONTENT: usize = 64 * 1024 * 1024;

/// Byte offset and description of a damage.
pub(super) type Damage = (u64, String);

/// One block of data.
#[derive(Debug, Clone, Copy)]
pub(super) struct DataSegment {
    /// Byte offset of the block.
    pub(super) at: u64,
    /// Byte offset and size of the stored data.
    pub(super) start: usize,
    pub(super) stored: usize,
    packing: SegmentCompression,
    /// Size of the content in bytes.
    length: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SegmentCompression {
    Stored,
    /// Compressed; transposed if the row size in bytes is above 1.
    Packed(Codec, usize),
    Unknown(u8),
}

impl DataSegment {
    /// Extends an uncompressed block to the end of the capture.
    pub(super) fn extend_to_end(&mut self, file: &[u8]) {
        if self.packing == SegmentCompression::Stored {
            self.stored = file.len().saturating_sub(self.start);
            self.length = self.stored;
        }
    }

    fn new(file: &[u8], block: &MdfBlock<'_>) -> Option<Self> {
        let start = usize::try_from(block.data_at()).ok()?.min(file.len());
        let stored = block.data.len();
        let at = block.at;
        match &block.kind {
            b"DT" | b"DV" | b"SD" | b"RD" => {
                Some(Self { at, start, stored, packing: SegmentCompression::Stored, length: stored })
            }
            b"DZ" => {
                let row = usize::try_from(block.u32(4)?).ok()?;
                let length = usize::try_from(block.u64(8)?).ok()?;
                let number = block.u8(2)?;
                let codec = CODECS.iter().find(|(known, _)| *known == number & !TRANSPOSED);
                let row = if number & TRANSPOSED == 0 { 0 } else { row };
                let packing = codec.map_or(SegmentCompression::Unknown(number), |(_, codec)| {
                    SegmentCompression::Packed(*codec, row)
                });
                let stored = stored.checked_sub(ZIP_HEADER)?;
                let start = start.checked_add(ZIP_HEADER)?;
                (length <= LARGEST_CONTENT).then_some(Self { at, start, stored, packing, length })
            }
            _ => None,
        }
    }

    /// Replaces the content of `bytes`; returns the damage. `columns` is memory for transposed data.
    fn unpack_segment(&self, file: &[u8], bytes: &mut Vec<u8>, columns: &mut Vec<u8>) -> Option<String> {
        let data = file.get(self.start..).unwrap_or_default();
        let data = data.get(..self.stored).unwrap_or(data);
        let (codec, row) = match self.packing {
            SegmentCompression::Unknown(number) => {
                bytes.clear();
                let known = "expected 0 to 5 (zlib, zstd, LZ4)";
                return Some(format!("block compression {number}; {known}"));
            }
            SegmentCompression::Packed(codec, row) => (codec, row),
            SegmentCompression::Stored => (Codec::Zlib, 0),
        };
        let content = if row > 1 { &mut *columns } else { &mut *bytes };
        content.clear();
        let damage = match codec.decompress(data, content, self.length) {
            Decompression::Whole(_) if content.len() == self.length => None,
            Decompression::Whole(_) | Decompression::TooLong => {
                Some(format!("compressed block: size differs from the declared {} bytes", self.length))
            }
            Decompression::CutOff => Some("compressed block ends early".into()),
            Decompression::Damaged => Some("compressed block damaged".into()),
            Decompression::Unavailable => Some(format!(
                "compressed block: this build lacks the feature `{}`; use a build with it",
                codec.required_feature()
            )),
        };
        // Incomplete transposed data cannot be converted to rows.
        if row > 1 && damage.is_none() {
            to_rows(columns, row, bytes);
        } else if row > 1 {
            bytes.clear();
        }
        damage
    }
}

/// Data blocks of a link in order, each at most once.
pub(super) fn collect_segments(
    file: &[u8],
    link: Option<u64>,
    damages: &mut Vec<Damage>,
) -> Vec<DataSegment> {
    let mut found = Vec::new();
    let mut seen = BTreeSet::new();
    let mut next = link;
    while let Some(at) = next.take() {
        if !seen.insert(at) {
            damages.push((at, "loop in the list of data blocks".into()));
            break;
        }
        let Some(block) = MdfBlock::parse_at(file, at) else {
            damages.push((at, "data block missing".into()));
            break;
        };
        match &block.kind {
            b"HL" => next = block.link_target(0),
            b"DL" | b"LD" => {
                for link in (1..=data_links(&block)).filter_map(|index| block.link_target(index)) {
                    if seen.insert(link) {
                        add_segment(file, link, &mut found, damages);
                    } else {
                        damages.push((link, "data block linked twice".into()));
                    }
                }
                next = block.link_target(0);
            }
            _ => add_segment(file, at, &mut found, damages),
        }
    }
    found
}

/// Number of links to data blocks in a list.
fn data_links(list: &MdfBlock<'_>) -> usize {
    let links = list.link_count().saturating_sub(1);
    let stated = (list.kind == *b"LD").then(|| list.u32(4)).flatten();
    stated.and_then(|count| usize::try_from(count).ok()).map_or(links, |count| count.min(links))
}

/// Whether the invalidation bits of records are in blocks of their own (MDF 4.2, LD block, flag bit 31).
pub(super) fn has_separate_validity(file: &[u8], link: Option<u64>) -> bool {
    let list = link.and_then(|at| MdfBlock::parse_kind_at(file, at, *b"LD"));
    list.and_then(|list| list.u32(0)).is_some_and(|flags| flags & SEPARATE_VALIDITY != 0)
}

fn add_segment(file: &[u8], at: u64, found: &mut Vec<DataSegment>, damages: &mut Vec<Damage>) {
    let block = MdfBlock::parse_at(file, at);
    let Some((block, segment)) = block.and_then(|block| Some((block, DataSegment::new(file, &block)?)))
    else {
        damages.push((at, "invalid data block".into()));
        return;
    };
    if block.is_cut_off {
        let there = file.len() as u64 - at.min(file.len() as u64);
        let reason = format!("the capture ends inside a block: found {there} of {} bytes", block.length);
        damages.push((at, reason));
    }
    found.push(segment);
}

/// Result of reading from a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StreamOutcome {
    /// All requested bytes were read.
    Whole,
    /// The stream ended; number of bytes read.
    End(usize),
    /// A block shorter than declared precedes the end of the requested bytes.
    Broken,
}

/// A position in the data.
#[derive(Debug, Clone)]
pub(super) struct DataStream {
    segments: Arc<[DataSegment]>,
    index: usize,
    /// Bytes used of the current segment.
    taken: usize,
    /// Number of bytes before the position.
    pub(super) position: u64,
    /// Total number of bytes.
    pub(super) length: u64,
    open: OpenSegment,
    /// Number of segments whose damage was reported.
    reported: usize,
    /// Damage of the current segment, until it is reported.
    pub(super) damage: Option<Damage>,
}

/// Content of the current segment if it is compressed; rebuilt if missing. All segments use the same memory.
#[derive(Debug, Default)]
struct OpenSegment {
    is_unpacked: bool,
    content: Vec<u8>,
    columns: Vec<u8>,
}

impl Clone for OpenSegment {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl DataStream {
    /// Starts at the first byte.
    pub(super) fn new(segments: Arc<[DataSegment]>) -> Self {
        let length = segments.iter().map(|segment| segment.length as u64).fold(0, u64::saturating_add);
        Self {
            segments,
            index: 0,
            taken: 0,
            position: 0,
            length,
            open: OpenSegment::default(),
            reported: 0,
            damage: None,
        }
    }

    /// Byte offset of the current or last block.
    pub(super) fn block_offset(&self) -> u64 {
        let segment = self.segments.get(self.index).or_else(|| self.segments.last());
        segment.map_or(0, |segment| segment.at)
    }

    /// Whether the data extend to the end of the capture.
    pub(super) fn is_at_end(&self, file: &[u8]) -> bool {
        let last = self.segments.last();
        last.is_some_and(|last| last.start.saturating_add(last.stored) >= file.len())
    }

    /// Replaces the content of `bytes` with the next `count` bytes.
    pub(super) fn read(&mut self, file: &[u8], count: usize, bytes: &mut Vec<u8>) -> StreamOutcome {
        bytes.clear();
        while bytes.len() < count {
            let Some(segment) = self.segments.get(self.index).copied() else {
                return StreamOutcome::End(bytes.len());
            };
            self.unpack_segment(file, &segment);
            let content = if self.open.is_unpacked {
                self.open.content.as_slice()
            } else {
                file.get(segment.start..).and_then(|rest| rest.get(..segment.stored)).unwrap_or_default()
            };
            let rest = content.get(self.taken..).unwrap_or_default();
            let part = rest.get(..count - bytes.len()).unwrap_or(rest);
            bytes.extend_from_slice(part);
            let part = part.len();
            self.advance_by(part);
            if bytes.len() < count {
                if self.taken < segment.length {
                    self.advance_by(segment.length - self.taken);
                    self.next_segment();
                    return StreamOutcome::Broken;
                }
                self.next_segment();
            }
        }
        StreamOutcome::Whole
    }

    /// Skips `count` bytes.
    pub(super) fn skip(&mut self, mut count: u64) -> StreamOutcome {
        while count > 0 {
            let Some(segment) = self.segments.get(self.index) else { return StreamOutcome::End(0) };
            let left = segment.length.saturating_sub(self.taken);
            let part = usize::try_from(count).unwrap_or(usize::MAX).min(left);
            self.advance_by(part);
            count -= part as u64;
            if count > 0 {
                self.next_segment();
            }
        }
        StreamOutcome::Whole
    }

    /// Returns to an earlier position within the same block, so that no block is decompressed again.
    pub(super) fn back_to(&mut self, position: u64) {
        let back = usize::try_from(self.position.saturating_sub(position)).unwrap_or(usize::MAX);
        if back <= self.taken {
            self.taken -= back;
            self.position = position;
        }
    }

    fn advance_by(&mut self, count: usize) {
        self.taken = self.taken.saturating_add(count);
        self.position = self.position.saturating_add(count as u64);
    }

    fn next_segment(&mut self) {
        self.index += 1;
        self.taken = 0;
        self.open.is_unpacked = false;
    }

    fn unpack_segment(&mut self, file: &[u8], segment: &DataSegment) {
        if segment.packing == SegmentCompression::Stored || self.open.is_unpacked {
            return;
        }
        let OpenSegment { is_unpacked, content, columns } = &mut self.open;
        *is_unpacked = true;
        if let Some(damage) = segment.unpack_segment(file, content, columns)
            && self.reported <= self.index
        {
            self.reported = self.index + 1;
            self.damage = Some((segment.at, damage));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored(file: &[u8], parts: &[(usize, usize)]) -> Arc<[DataSegment]> {
        assert!(parts.iter().all(|(start, count)| start + count <= file.len()));
        let segment = |(start, stored): &(usize, usize)| DataSegment {
            at: *start as u64,
            start: *start,
            stored: *stored,
            packing: SegmentCompression::Stored,
            length: *stored,
        };
        parts.iter().map(segment).collect()
    }

    #[test]
    fn bytes_go_on_in_the_next_segment() {
        let file = b"abcdefgh";
        let mut stream = DataStream::new(stored(file, &[(4, 3), (0, 0), (1, 2)]));
        let mut bytes = Vec::new();
        assert_eq!((stream.read(file, 2, &mut bytes), &bytes[..]), (StreamOutcome::Whole, &b"ef"[..]));
        assert_eq!((stream.read(file, 2, &mut bytes), &bytes[..]), (StreamOutcome::Whole, &b"gb"[..]));
        assert_eq!((stream.read(file, 2, &mut bytes), &bytes[..]), (StreamOutcome::End(1), &b"c"[..]));
        let mut stream = DataStream::new(stored(file, &[(4, 3), (1, 2)]));
        assert_eq!((stream.skip(4), stream.position), (StreamOutcome::Whole, 4));
        assert_eq!((stream.read(file, 1, &mut bytes), &bytes[..]), (StreamOutcome::Whole, &b"c"[..]));
        assert_eq!(stream.skip(1), StreamOutcome::End(0));
    }

    #[test]
    fn a_damaged_block_has_no_content_of_an_earlier_one() {
        for packing in [
            SegmentCompression::Unknown(7),
            SegmentCompression::Packed(Codec::Zlib, 0),
            SegmentCompression::Packed(Codec::Zlib, 2),
        ] {
            let segment = DataSegment { at: 0, start: 0, stored: 4, packing, length: 4 };
            let (mut bytes, mut columns) = (b"earlier".to_vec(), b"earlier".to_vec());
            assert!(segment.unpack_segment(b"none", &mut bytes, &mut columns).is_some());
            assert_eq!(bytes, b"", "{packing:?}");
        }
    }
}
