//! MCAP: captures of topics, as used by Foxglove and ROS 2. <https://mcap.dev/spec>
//!
//! ```text
//! magic │ header │ chunk (compressed): schemas, channels, messages │ indexes │ … │ summary │ footer │ magic
//!
//! topic /can/can0        can_msgs/msg/Frame           frames of a bus, as written by cobscope
//! topic /can/can0/fd     ros2_socketcan_msgs/msg/FdFrame
//! topic /log             foxglove.Log                 lost frames, link changes, quiet periods
//! ```
//! Data without a field in the message is stored in the metadata of the channel: a topic has one channel for
//! received frames, one for transmitted frames, and so on. In files of other programs, messages of ROS 1 and
//! ROS 2 that have an identifier and data are read as frames ([`layout`]); other topics are skipped.
//!
//! The `mcap` crate is only used for writing: it panics on invalid files, and the state of its reader cannot
//! be cloned.

mod key;
mod layout;
mod message;
mod record;
mod records;
mod unpack;
#[cfg(feature = "mcap")]
mod write;

use record::{HEAD, RecordType};
use records::TopicRecords;
use unpack::ChunkRecords;

use crate::capture::{
    Batch, BusNames, CaptureError, CaptureFormat, CapturePlace, FormatParser, LARGEST_RECORD, Notice,
};
#[cfg(feature = "mcap")]
use crate::capture::{FormatCapabilities, WritableFormat};

#[cfg(feature = "mcap")]
pub(crate) use write::{McapWriter, WrittenTopic};

/// Magic bytes at the start and the end of a file.
const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Maximum size of a chunk in the file, in bytes.
const LARGEST_CHUNK: usize = 32 * 1024 * 1024;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "mcap",
    title: "MCAP",
    is_text: false,
    is_packed: true,
    detect: |head| head.starts_with(MAGIC),
    parser: |_| Box::new(McapParser::default()),
};

#[cfg(feature = "mcap")]
pub(super) const WRITABLE: WritableFormat = WritableFormat {
    name: FORMAT.name,
    suffix: "mcap",
    title: FORMAT.title,
    holds: FormatCapabilities { negative: false, comments: false, ..FormatCapabilities::ALL },
    writer: |output, options| Box::new(McapWriter::new(output, options.packing)),
};

/// Parser of MCAP.
#[derive(Default)]
struct McapParser {
    records: TopicRecords,
    /// Bytes used so far.
    offset: u64,
    /// Bytes left to skip.
    skip: u64,
    chunk: Option<OpenChunk>,
    state: McapState,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum McapState {
    /// Nothing was read.
    #[default]
    Start,
    Records,
    /// After the footer.
    Finished,
    /// The end was reported.
    Over,
}

/// The chunk at the start of the input, whose frames are being emitted.
#[derive(Default)]
struct OpenChunk {
    /// Bytes of its records already parsed.
    done: usize,
    /// The decompressed records, if the chunk is compressed. A clone decompresses them again, so that stored
    /// positions are small.
    unpacked: Option<Vec<u8>>,
    /// Whether its failure was reported.
    is_reported: bool,
}

impl Clone for McapParser {
    fn clone(&self) -> Self {
        let Self { records, offset, skip, chunk, state } = self;
        let chunk = chunk.as_ref().map(|OpenChunk { done, is_reported, .. }| OpenChunk {
            done: *done,
            unpacked: None,
            is_reported: *is_reported,
        });
        Self { records: records.clone(), offset: *offset, skip: *skip, chunk, state: *state }
    }
}

/// Result of one step of the parser.
enum McapStep {
    /// Number of bytes used.
    Took(usize),
    /// Nothing used: more input, or a batch with room, is needed.
    Wait,
}

impl McapParser {
    fn parse_step(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> McapStep {
        if self.skip > 0 {
            return self.pass_over(rest);
        }
        match self.state {
            McapState::Start if rest.len() < MAGIC.len() && !at_end => return McapStep::Wait,
            McapState::Start => {
                self.state = McapState::Records;
                return McapStep::Took(MAGIC.len().min(rest.len()));
            }
            McapState::Records => {}
            McapState::Finished => return self.check_after_footer(at, rest, at_end, batch),
            McapState::Over => {
                return if rest.is_empty() { McapStep::Wait } else { McapStep::Took(rest.len()) };
            }
        }
        let Some((kind, length)) = record::parse_head(rest) else {
            return if at_end { self.end_in_record(at, rest, batch) } else { McapStep::Wait };
        };
        if let RecordType::Unknown(kind) = kind {
            batch.push_unreadable(
                CapturePlace::Offset(at),
                format!("unknown record type {kind:#04X}; expected 01 to 0F"),
            );
        }
        let is_needed = !matches!(kind, RecordType::Other | RecordType::Unknown(_) | RecordType::Footer);
        let contents = rest.get(HEAD..).unwrap_or_default();
        let whole = usize::try_from(length).ok().and_then(|length| contents.get(..length));
        match whole {
            Some(contents) if is_needed => self.on_record(kind, at, contents, true, batch),
            _ if !is_needed => {
                if kind == RecordType::Footer {
                    self.state = McapState::Finished;
                }
                self.skip = length;
                McapStep::Took(HEAD)
            }
            _ if at_end => {
                let taken = self.on_record(kind, at, contents, false, batch);
                if let McapStep::Took(_) = taken {
                    let there = contents.len();
                    cut_off(
                        format!("the capture ends inside a record: {there} bytes of {length}"),
                        at,
                        batch,
                    );
                    self.state = McapState::Over;
                }
                taken
            }
            None if length > self.largest_record() => {
                batch.push_unreadable(
                    CapturePlace::Offset(at),
                    format!("record of {length} bytes too long: skipped"),
                );
                self.skip = length;
                McapStep::Took(HEAD)
            }
            _ => McapStep::Wait,
        }
    }

    #[expect(clippy::unused_self, reason = "used as a property of the reader")]
    fn largest_record(&self) -> u64 {
        LARGEST_CHUNK as u64
    }

    /// Handles the end of the capture at the start of a record: no bytes, or an incomplete record head.
    fn end_in_record(&mut self, at: u64, rest: &[u8], batch: &mut Batch) -> McapStep {
        if !rest.is_empty() {
            cut_off("the capture ends inside a record".into(), at, batch);
            self.state = McapState::Over;
        }
        McapStep::Took(rest.len())
    }

    fn pass_over(&mut self, rest: &[u8]) -> McapStep {
        let count = usize::try_from(self.skip).unwrap_or(usize::MAX).min(rest.len());
        self.skip -= count as u64;
        if count == 0 { McapStep::Wait } else { McapStep::Took(count) }
    }

    /// Checks that only the magic bytes follow the footer.
    fn check_after_footer(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> McapStep {
        if rest.len() < MAGIC.len() && !at_end {
            return McapStep::Wait;
        }
        self.state = McapState::Over;
        if !rest.starts_with(MAGIC) {
            batch.push_unreadable(
                CapturePlace::Offset(at),
                "after the footer: expected the magic bytes at the end of the file".into(),
            );
        }
        McapStep::Took(rest.len())
    }

    /// Handles a complete record, or the available part of an incomplete one.
    fn on_record(
        &mut self,
        kind: RecordType,
        at: u64,
        contents: &[u8],
        is_whole: bool,
        batch: &mut Batch,
    ) -> McapStep {
        let taken = McapStep::Took(HEAD.saturating_add(contents.len()));
        match kind {
            RecordType::Chunk => {
                let chunk = record::parse_chunk(contents);
                if chunk.is_none() && is_whole {
                    batch.push_unreadable(CapturePlace::Offset(at), "chunk: too short".into());
                }
                if chunk.is_some_and(|chunk| !self.emit_chunk(&chunk, at, is_whole, batch)) {
                    return McapStep::Wait;
                }
            }
            _ if is_whole => self.records.on_record(kind, contents, at, batch),
            _ => {}
        }
        taken
    }

    /// Emits the frames in a chunk; `false` if the batch is full before the end.
    fn emit_chunk(
        &mut self,
        chunk: &record::RecordChunk<'_>,
        at: u64,
        is_whole: bool,
        batch: &mut Batch,
    ) -> bool {
        let mut open = self.chunk.take().unwrap_or_default();
        let unpacked = match open.unpacked.take() {
            Some(records) => ChunkRecords { records: records.into(), failure: None },
            None => unpack::unpack_chunk(chunk.packing, chunk.packed, chunk.size),
        };
        if !std::mem::replace(&mut open.is_reported, true) {
            report_chunk(chunk, &unpacked, at, is_whole, batch);
        }
        let is_done = self.records.run_chunk(&unpacked.records, &mut open.done, at, batch);
        if !is_done {
            if let std::borrow::Cow::Owned(records) = unpacked.records {
                open.unpacked = Some(records);
            }
            self.chunk = Some(open);
        }
        is_done
    }

    fn end_capture(&mut self, batch: &mut Batch) {
        match std::mem::replace(&mut self.state, McapState::Over) {
            McapState::Over => {}
            McapState::Finished if self.skip > 0 => {
                cut_off("the capture ends inside its footer".into(), self.offset, batch);
            }
            McapState::Records if self.skip > 0 => {
                let missing = self.skip;
                cut_off(
                    format!("the capture ends inside a record: {missing} bytes are missing"),
                    self.offset,
                    batch,
                );
            }
            McapState::Records | McapState::Start => {
                let text = "the capture was not finished: read up to its end";
                batch.add_notice(Notice::Assumption(text.into()));
            }
            McapState::Finished => {
                batch.push_unreadable(
                    CapturePlace::Offset(self.offset),
                    "after the footer: expected the magic bytes at the end of the file".into(),
                );
            }
        }
        self.records.report_skipped(batch);
    }
}

/// Reports a damaged chunk.
fn report_chunk(
    chunk: &record::RecordChunk<'_>,
    unpacked: &ChunkRecords<'_>,
    at: u64,
    is_whole: bool,
    batch: &mut Batch,
) {
    if let Some(failure) = &unpacked.failure {
        batch.push_unreadable(CapturePlace::Offset(at), format!("chunk: {failure}"));
    } else if is_whole && (chunk.packed.len() as u64) < chunk.packed_size {
        let (found, declared) = (chunk.packed.len(), chunk.packed_size);
        batch.push_unreadable(
            CapturePlace::Offset(at),
            format!("chunk: found {found} bytes; expected {declared}"),
        );
    } else if is_whole && !checksum_fits(&unpacked.records, chunk.checksum) {
        batch.push_unreadable(
            CapturePlace::Offset(at),
            "chunk: checksum mismatch, its frames may be wrong".into(),
        );
    }
}

#[cfg(feature = "mcap")]
fn checksum_fits(records: &[u8], checksum: u32) -> bool {
    checksum == 0 || crc32fast::hash(records) == checksum
}

#[cfg(not(feature = "mcap"))]
fn checksum_fits(_records: &[u8], _checksum: u32) -> bool {
    true
}

fn cut_off(reason: String, at: u64, batch: &mut Batch) {
    batch.add_notice(Notice::CutOff { place: CapturePlace::Offset(at), reason });
}

impl FormatParser for McapParser {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            let at = self.offset.saturating_add(taken as u64);
            match self.parse_step(at, rest, at_end, batch) {
                McapStep::Took(0) | McapStep::Wait => break,
                McapStep::Took(count) => taken += count,
            }
        }
        self.offset = self.offset.saturating_add(taken as u64);
        if at_end && taken == input.len() && !batch.is_full() {
            self.end_capture(batch);
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        &self.records.buses
    }

    fn largest_input(&self) -> usize {
        LARGEST_CHUNK + LARGEST_RECORD
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}
