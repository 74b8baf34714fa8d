//! Records of one group out of the data of several, and values of variable length.

use std::sync::Arc;

use super::group::Size;
use super::stream::{Outcome, Stream};

/// Longest value that is read; a frame has 64 bytes.
const LONGEST_VALUE: usize = 64 * 1024;

/// How far ahead of the last value of a group the next one is looked for.
const AHEAD: u64 = 1024 * 1024;

/// A group as far as passing over it needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Known {
    pub(super) number: u64,
    pub(super) size: Size,
    /// Whether leaving out its records leaves out nothing of a frame.
    pub(super) is_other: bool,
}

/// What was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    /// A record.
    Record,
    /// The data end; so many bytes were left.
    End(usize),
    /// A block that holds less than it should is in between.
    Broken,
    /// A record of a group nobody described: where the next one begins is not known.
    Unknown(u64),
}

/// Goes through the records of one group.
#[derive(Debug, Clone)]
pub(super) struct Records {
    pub(super) stream: Stream,
    /// Bytes of the number before each record; 0 where there is only one group.
    number_size: usize,
    /// In order of their numbers.
    groups: Arc<[Known]>,
    wanted: u64,
    /// Records passed over that are no part of a frame.
    pub(super) others: u64,
}

impl Records {
    /// From the beginning of the data.
    pub(super) fn new(stream: Stream, number_size: usize, groups: Arc<[Known]>, wanted: u64) -> Self {
        Self { stream, number_size, groups, wanted, others: 0 }
    }

    /// Replaces the content of `bytes` by the next record.
    pub(super) fn next(&mut self, file: &[u8], bytes: &mut Vec<u8>) -> Next {
        loop {
            let number = match self.number(file, bytes) {
                Ok(number) => number,
                Err(next) => return next,
            };
            let known = self.groups.binary_search_by_key(&number, |known| known.number);
            let Some(known) = known.ok().and_then(|index| self.groups.get(index)).copied() else {
                return Next::Unknown(number);
            };
            let size = match known.size {
                // Of records without bytes there are as many as one likes.
                Size::Fixed(0) if self.number_size == 0 => return Next::End(0),
                Size::Fixed(size) => size,
                Size::Variable => match self.stream.read(file, 4, bytes) {
                    Outcome::Whole => u64::from(length(bytes)),
                    other => return ended(other, self.number_size),
                },
            };
            let outcome = match usize::try_from(size) {
                Ok(size) if number == self.wanted && size <= LONGEST_VALUE => {
                    self.stream.read(file, size, bytes)
                }
                _ => {
                    bytes.clear();
                    self.stream.skip(size)
                }
            };
            if outcome != Outcome::Whole {
                return ended(outcome, self.number_size);
            }
            if number == self.wanted {
                return Next::Record;
            }
            self.others += u64::from(known.is_other);
        }
    }

    fn number(&mut self, file: &[u8], bytes: &mut Vec<u8>) -> Result<u64, Next> {
        if self.number_size == 0 {
            return Ok(self.wanted);
        }
        match self.stream.read(file, self.number_size, bytes) {
            Outcome::Whole => Ok(bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte))),
            other => Err(ended(other, 0)),
        }
    }

    /// Whether records have one size, so that the next can be found behind what is missing.
    pub(super) fn align(&mut self, size: u64) -> bool {
        if self.number_size > 0 || size == 0 {
            return false;
        }
        let over = self.stream.position % size;
        over == 0 || self.stream.skip(size - over) == Outcome::Whole
    }
}

fn ended(outcome: Outcome, before: usize) -> Next {
    match outcome {
        Outcome::End(left) => Next::End(left + before),
        Outcome::Whole | Outcome::Broken => Next::Broken,
    }
}

fn length(bytes: &[u8]) -> u32 {
    bytes.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

/// Values of variable length, found by their offset. They are in the order of the records that use them.
#[derive(Debug, Clone)]
pub(super) enum Values {
    /// There are none.
    None,
    /// Behind one another in blocks of their own.
    Blocks(Stream, Last),
    /// Records of a group, whose offsets count what its records would take up in blocks.
    Records(Records, u64, Last),
}

/// The value looked at last, and its offset.
#[derive(Debug, Clone, Default)]
pub(super) struct Last {
    offset: Option<u64>,
    bytes: Vec<u8>,
}

impl Values {
    /// The value at an offset; `None` if none begins there, or it was passed over before.
    pub(super) fn get(&mut self, file: &[u8], offset: u64) -> Option<&[u8]> {
        match self {
            Self::None => None,
            Self::Blocks(stream, last) => {
                if last.offset != Some(offset) {
                    let before = stream.position;
                    last.offset = in_blocks(stream, file, offset, &mut last.bytes).map(|()| offset);
                    if last.offset.is_none() {
                        stream.back_to(before);
                    }
                }
                last.offset.map(|_| last.bytes.as_slice())
            }
            Self::Records(records, at, last) => {
                while last.offset != Some(offset) {
                    if *at > offset
                        || offset - *at > AHEAD
                        || records.next(file, &mut last.bytes) != Next::Record
                    {
                        return None;
                    }
                    last.offset = Some(*at);
                    *at = at.saturating_add(4).saturating_add(last.bytes.len() as u64);
                }
                Some(&last.bytes)
            }
        }
    }

    /// What is wrong with the blocks of their own, until somebody says it.
    pub(super) fn damage(&mut self) -> Option<super::stream::Damage> {
        match self {
            Self::Blocks(stream, _) => stream.damage.take(),
            Self::None | Self::Records(..) => None,
        }
    }
}

/// Reads the value at an offset; one that is wrong must not lead far away.
fn in_blocks(stream: &mut Stream, file: &[u8], offset: u64, bytes: &mut Vec<u8>) -> Option<()> {
    let ahead = offset.checked_sub(stream.position).filter(|_| offset < stream.length)?;
    whole(stream.skip(ahead))?;
    whole(stream.read(file, 4, bytes))?;
    let length = usize::try_from(length(bytes)).ok().filter(|length| *length <= LONGEST_VALUE)?;
    whole(stream.read(file, length, bytes))
}

fn whole(outcome: Outcome) -> Option<()> {
    (outcome == Outcome::Whole).then_some(())
}
