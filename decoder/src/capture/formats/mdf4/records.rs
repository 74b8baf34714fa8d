//! Records of one group from data shared by several groups, and values of variable length.

use std::sync::Arc;

use super::group::RecordSize;
use super::stream::{DataStream, StreamOutcome};

/// Maximum size of a value in bytes; a frame has at most 64.
const LONGEST_VALUE: usize = 64 * 1024;

/// Maximum distance from the last value of a group at which the next one is searched, in bytes.
const AHEAD: u64 = 1024 * 1024;

/// Data of a group that is needed to skip its records.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct KnownGroup {
    pub(super) number: u64,
    pub(super) size: RecordSize,
    /// Whether the group contains no part of a frame.
    pub(super) is_other: bool,
}

/// Result of reading the next record.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NextRecord {
    /// A complete record.
    Record,
    /// End of the data; number of bytes left.
    End(usize),
    /// A block before the record is shorter than declared.
    Broken,
    /// A record of an undefined group, contains its number: the start of the next record is unknown.
    Unknown(u64),
}

/// Reads the records of one group.
#[derive(Debug, Clone)]
pub(super) struct RecordReader {
    pub(super) stream: DataStream,
    /// Size of the group number before each record in bytes; 0 if there is only one group.
    number_size: usize,
    /// Groups, sorted by number.
    groups: Arc<[KnownGroup]>,
    wanted: u64,
    /// Number of skipped records that are not part of a frame.
    pub(super) others: u64,
}

impl RecordReader {
    /// Starts at the beginning of the data.
    pub(super) fn new(
        stream: DataStream,
        number_size: usize,
        groups: Arc<[KnownGroup]>,
        wanted: u64,
    ) -> Self {
        Self { stream, number_size, groups, wanted, others: 0 }
    }

    /// Replaces the content of `bytes` with the next record.
    pub(super) fn next(&mut self, file: &[u8], bytes: &mut Vec<u8>) -> NextRecord {
        loop {
            let number = match self.read_number(file, bytes) {
                Ok(number) => number,
                Err(next) => return next,
            };
            let known = self.groups.binary_search_by_key(&number, |known| known.number);
            let Some(known) = known.ok().and_then(|index| self.groups.get(index)).copied() else {
                return NextRecord::Unknown(number);
            };
            let size = match known.size {
                // The number of empty records would be unlimited.
                RecordSize::Fixed(0) if self.number_size == 0 => return NextRecord::End(0),
                RecordSize::Fixed(size) => size,
                RecordSize::Variable => match self.stream.read(file, 4, bytes) {
                    StreamOutcome::Whole => u64::from(length_prefix(bytes)),
                    other => return end_of_records(other, self.number_size),
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
            if outcome != StreamOutcome::Whole {
                return end_of_records(outcome, self.number_size);
            }
            if number == self.wanted {
                return NextRecord::Record;
            }
            self.others += u64::from(known.is_other);
        }
    }

    fn read_number(&mut self, file: &[u8], bytes: &mut Vec<u8>) -> Result<u64, NextRecord> {
        if self.number_size == 0 {
            return Ok(self.wanted);
        }
        match self.stream.read(file, self.number_size, bytes) {
            StreamOutcome::Whole => {
                Ok(bytes.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte)))
            }
            other => Err(end_of_records(other, 0)),
        }
    }

    /// Whether records have a fixed size, so that reading can continue at the next record after missing
    /// bytes.
    pub(super) fn has_fixed_size(&mut self, size: u64) -> bool {
        if self.number_size > 0 || size == 0 {
            return false;
        }
        let over = self.stream.position % size;
        over == 0 || self.stream.skip(size - over) == StreamOutcome::Whole
    }
}

fn end_of_records(outcome: StreamOutcome, before: usize) -> NextRecord {
    match outcome {
        StreamOutcome::End(left) => NextRecord::End(left + before),
        StreamOutcome::Whole | StreamOutcome::Broken => NextRecord::Broken,
    }
}

fn length_prefix(bytes: &[u8]) -> u32 {
    bytes.first_chunk().map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

/// Values of variable length, accessed by offset. They have the same order as the records that use them.
#[derive(Debug, Clone)]
pub(super) enum VariableValues {
    /// No such values.
    None,
    /// Consecutive values in separate blocks.
    Blocks(DataStream, LastVariableValue),
    /// Records of a group, whose offsets are those that the values would have in blocks.
    Records(RecordReader, u64, LastVariableValue),
}

/// The last value read, and its offset.
#[derive(Debug, Clone, Default)]
pub(super) struct LastVariableValue {
    offset: Option<u64>,
    bytes: Vec<u8>,
}

impl VariableValues {
    /// The value at an offset; `None` if no value begins there, or if reading has passed it.
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
                        || records.next(file, &mut last.bytes) != NextRecord::Record
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

    /// Takes the damage found in the blocks of values, if any.
    pub(super) fn take_damage(&mut self) -> Option<super::stream::Damage> {
        match self {
            Self::Blocks(stream, _) => stream.damage.take(),
            Self::None | Self::Records(..) => None,
        }
    }
}

/// Reads the value at an offset; invalid offsets must not advance the stream far.
fn in_blocks(stream: &mut DataStream, file: &[u8], offset: u64, bytes: &mut Vec<u8>) -> Option<()> {
    let ahead = offset.checked_sub(stream.position).filter(|_| offset < stream.length)?;
    complete_only(stream.skip(ahead))?;
    complete_only(stream.read(file, 4, bytes))?;
    let length = usize::try_from(length_prefix(bytes)).ok().filter(|length| *length <= LONGEST_VALUE)?;
    complete_only(stream.read(file, length, bytes))
}

fn complete_only(outcome: StreamOutcome) -> Option<()> {
    (outcome == StreamOutcome::Whole).then_some(())
}
