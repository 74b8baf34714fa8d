//! The data of a group or a channel: one block, or many behind one another, compressed or not.
//!
//! ```text
//! DT, SD  the bytes themselves
//! DZ      0 kind of block (2)  2 compression (1): 0 zlib, 1 zlib of columns  4 bytes of a row (4)
//!         8 bytes in all (8)  16 bytes compressed (8)  24 compressed bytes
//! DL      links: 0 next list, then blocks of data        HL  links: 0 first list
//! ```
//! Of columns, the first bytes of all rows stand first, then the second ones; what is less than a row last.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::block::Block;
use crate::capture::inflate::{Inflated, inflate};

/// Bytes before the compressed ones.
const ZIP_HEADER: usize = 24;
const ZLIB: u8 = 0;
const ZLIB_OF_COLUMNS: u8 = 1;

/// Largest content of a compressed block that is believed; the standard allows 4 MiB.
const LARGEST_CONTENT: usize = 64 * 1024 * 1024;

/// What is wrong, and where.
pub(super) type Damage = (u64, String);

/// One block of data.
#[derive(Debug, Clone, Copy)]
pub(super) struct Segment {
    /// Where the block begins.
    pub(super) at: u64,
    /// Where its bytes begin in the capture, and how many there are.
    pub(super) start: usize,
    pub(super) stored: usize,
    packing: Packing,
    /// Bytes it holds.
    length: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Packing {
    Stored,
    Zlib,
    /// Columns, of rows of so many bytes.
    Columns(usize),
    Unknown(u8),
}

impl Segment {
    /// Its bytes go on to the end of the capture, if they can.
    pub(super) fn extend(&mut self, file: &[u8]) {
        if self.packing == Packing::Stored {
            self.stored = file.len().saturating_sub(self.start);
            self.length = self.stored;
        }
    }

    fn new(file: &[u8], block: &Block<'_>) -> Option<Self> {
        let start = usize::try_from(block.data_at()).ok()?.min(file.len());
        let stored = block.data.len();
        let at = block.at;
        match &block.kind {
            b"DT" | b"SD" | b"RD" => {
                Some(Self { at, start, stored, packing: Packing::Stored, length: stored })
            }
            b"DZ" => {
                let row = usize::try_from(block.u32(4)?).ok()?;
                let length = usize::try_from(block.u64(8)?).ok()?;
                let packing = match block.u8(2)? {
                    ZLIB => Packing::Zlib,
                    ZLIB_OF_COLUMNS => Packing::Columns(row),
                    other => Packing::Unknown(other),
                };
                let stored = stored.checked_sub(ZIP_HEADER)?;
                let start = start.checked_add(ZIP_HEADER)?;
                (length <= LARGEST_CONTENT).then_some(Self { at, start, stored, packing, length })
            }
            _ => None,
        }
    }

    fn unpack(&self, file: &[u8]) -> (Vec<u8>, Option<String>) {
        let data = file.get(self.start..).unwrap_or_default();
        let data = data.get(..self.stored).unwrap_or(data);
        let mut bytes = Vec::new();
        let row = match self.packing {
            Packing::Unknown(number) => {
                return (bytes, Some(format!("a block with compression {number}, expected 0 or 1 (zlib)")));
            }
            Packing::Columns(row) => row,
            Packing::Stored | Packing::Zlib => 0,
        };
        let damage = match inflate(data, &mut bytes, self.length) {
            Inflated::Whole(_) if bytes.len() == self.length => None,
            Inflated::Whole(_) | Inflated::TooLong => {
                Some(format!("a compressed block that holds not the {} bytes it says", self.length))
            }
            Inflated::CutOff => Some("a compressed block that ends too early".into()),
            Inflated::Damaged => Some("a compressed block that is damaged".into()),
            Inflated::Unavailable => {
                let text =
                    "a compressed block, but this build leaves out the feature `gzip`: use one with it";
                Some(text.into())
            }
        };
        if row > 1 {
            // Of columns that are not whole nothing can be put together.
            bytes = if damage.is_none() { rows(&bytes, row) } else { Vec::new() };
        }
        (bytes, damage)
    }
}

/// Rows of columns.
fn rows(columns: &[u8], row: usize) -> Vec<u8> {
    let count = columns.len() / row;
    if count == 0 {
        return columns.to_vec();
    }
    let (matrix, rest) = columns.split_at(count * row);
    let mut bytes = vec![0; matrix.len()];
    for (index, column) in matrix.chunks_exact(count).enumerate() {
        let places = bytes.iter_mut().skip(index).step_by(row);
        places.zip(column).for_each(|(place, byte)| *place = *byte);
    }
    bytes.extend_from_slice(rest);
    bytes
}

/// The blocks of data behind a link, each once, in order.
pub(super) fn segments(file: &[u8], link: Option<u64>, damages: &mut Vec<Damage>) -> Vec<Segment> {
    let mut found = Vec::new();
    let mut seen = BTreeSet::new();
    let mut next = link;
    while let Some(at) = next.take() {
        if !seen.insert(at) {
            damages.push((at, "a list of data blocks that leads back to itself".into()));
            break;
        }
        let Some(block) = Block::at(file, at) else {
            damages.push((at, "no block where one with data should be".into()));
            break;
        };
        match &block.kind {
            b"HL" => next = block.link(0),
            b"DL" => {
                for link in (1..block.links()).filter_map(|index| block.link(index)) {
                    if seen.insert(link) {
                        add(file, link, &mut found, damages);
                    } else {
                        damages.push((link, "a data block that is in a list twice".into()));
                    }
                }
                next = block.link(0);
            }
            _ => add(file, at, &mut found, damages),
        }
    }
    found
}

fn add(file: &[u8], at: u64, found: &mut Vec<Segment>, damages: &mut Vec<Damage>) {
    let block = Block::at(file, at);
    let Some((block, segment)) = block.and_then(|block| Some((block, Segment::new(file, &block)?))) else {
        damages.push((at, "no block with data that can be read".into()));
        return;
    };
    if block.is_cut_off {
        let there = file.len() as u64 - at.min(file.len() as u64);
        let reason = format!("the capture ends inside a block: found {there} of {} bytes", block.length);
        damages.push((at, reason));
    }
    found.push(segment);
}

/// How reading from a stream ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// All that was asked for is there.
    Whole,
    /// The stream ends; so many bytes were left.
    End(usize),
    /// A block that holds less than it should is in between.
    Broken,
}

/// A place in the data.
#[derive(Debug, Clone)]
pub(super) struct Stream {
    segments: Arc<[Segment]>,
    index: usize,
    /// Bytes taken of the segment.
    taken: usize,
    /// Bytes before this place.
    pub(super) position: u64,
    /// Bytes in all.
    pub(super) length: u64,
    open: Open,
    /// Segments whose damage was said.
    told: usize,
    /// What is wrong with the present segment, until somebody says it.
    pub(super) damage: Option<Damage>,
}

/// What the present segment holds, if it is compressed: made again where it is missing.
#[derive(Debug, Default)]
struct Open(Option<Vec<u8>>);

impl Clone for Open {
    fn clone(&self) -> Self {
        Self(None)
    }
}

impl Stream {
    /// The beginning.
    pub(super) fn new(segments: Arc<[Segment]>) -> Self {
        let length = segments.iter().map(|segment| segment.length as u64).fold(0, u64::saturating_add);
        Self { segments, index: 0, taken: 0, position: 0, length, open: Open(None), told: 0, damage: None }
    }

    /// Byte offset of the block it is in, or was in last.
    pub(super) fn at(&self) -> u64 {
        let segment = self.segments.get(self.index).or_else(|| self.segments.last());
        segment.map_or(0, |segment| segment.at)
    }

    /// Whether it goes on to the end of the capture.
    pub(super) fn is_at_end(&self, file: &[u8]) -> bool {
        let last = self.segments.last();
        last.is_some_and(|last| last.start.saturating_add(last.stored) >= file.len())
    }

    /// Replaces the content of `bytes` by the next `count` bytes.
    pub(super) fn read(&mut self, file: &[u8], count: usize, bytes: &mut Vec<u8>) -> Outcome {
        bytes.clear();
        while bytes.len() < count {
            let Some(segment) = self.segments.get(self.index).copied() else {
                return Outcome::End(bytes.len());
            };
            self.unpack(file, &segment);
            let content = match &self.open.0 {
                Some(content) => content.as_slice(),
                None => {
                    file.get(segment.start..).and_then(|rest| rest.get(..segment.stored)).unwrap_or_default()
                }
            };
            let rest = content.get(self.taken..).unwrap_or_default();
            let part = rest.get(..count - bytes.len()).unwrap_or(rest);
            bytes.extend_from_slice(part);
            let part = part.len();
            self.advance(part);
            if bytes.len() < count {
                if self.taken < segment.length {
                    self.advance(segment.length - self.taken);
                    self.next_segment();
                    return Outcome::Broken;
                }
                self.next_segment();
            }
        }
        Outcome::Whole
    }

    /// Passes over `count` bytes.
    pub(super) fn skip(&mut self, mut count: u64) -> Outcome {
        while count > 0 {
            let Some(segment) = self.segments.get(self.index) else { return Outcome::End(0) };
            let left = segment.length.saturating_sub(self.taken);
            let part = usize::try_from(count).unwrap_or(usize::MAX).min(left);
            self.advance(part);
            count -= part as u64;
            if count > 0 {
                self.next_segment();
            }
        }
        Outcome::Whole
    }

    /// Goes back to an earlier place, if it is in the same block: no block is unpacked again.
    pub(super) fn back_to(&mut self, position: u64) {
        let back = usize::try_from(self.position.saturating_sub(position)).unwrap_or(usize::MAX);
        if back <= self.taken {
            self.taken -= back;
            self.position = position;
        }
    }

    fn advance(&mut self, count: usize) {
        self.taken = self.taken.saturating_add(count);
        self.position = self.position.saturating_add(count as u64);
    }

    fn next_segment(&mut self) {
        self.index += 1;
        self.taken = 0;
        self.open.0 = None;
    }

    fn unpack(&mut self, file: &[u8], segment: &Segment) {
        if segment.packing == Packing::Stored || self.open.0.is_some() {
            return;
        }
        let (content, damage) = segment.unpack(file);
        self.open.0 = Some(content);
        if let Some(damage) = damage
            && self.told <= self.index
        {
            self.told = self.index + 1;
            self.damage = Some((segment.at, damage));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stored(file: &[u8], parts: &[(usize, usize)]) -> Arc<[Segment]> {
        assert!(parts.iter().all(|(start, count)| start + count <= file.len()));
        let segment = |(start, stored): &(usize, usize)| Segment {
            at: *start as u64,
            start: *start,
            stored: *stored,
            packing: Packing::Stored,
            length: *stored,
        };
        parts.iter().map(segment).collect()
    }

    #[test]
    fn bytes_go_on_in_the_next_segment() {
        let file = b"abcdefgh";
        let mut stream = Stream::new(stored(file, &[(4, 3), (0, 0), (1, 2)]));
        let mut bytes = Vec::new();
        assert_eq!((stream.read(file, 2, &mut bytes), &bytes[..]), (Outcome::Whole, &b"ef"[..]));
        assert_eq!((stream.read(file, 2, &mut bytes), &bytes[..]), (Outcome::Whole, &b"gb"[..]));
        assert_eq!((stream.read(file, 2, &mut bytes), &bytes[..]), (Outcome::End(1), &b"c"[..]));
        let mut stream = Stream::new(stored(file, &[(4, 3), (1, 2)]));
        assert_eq!((stream.skip(4), stream.position), (Outcome::Whole, 4));
        assert_eq!((stream.read(file, 1, &mut bytes), &bytes[..]), (Outcome::Whole, &b"c"[..]));
        assert_eq!(stream.skip(1), Outcome::End(0));
    }

    #[test]
    fn columns_become_rows() {
        assert_eq!(rows(b"adbecfxy", 3), b"abcdefxy");
        assert_eq!(rows(b"ab", 3), b"ab");
        assert_eq!(rows(b"", 3), b"");
    }
}
