//! MCAP: recordings of topics, as Foxglove and ROS 2 use them. <https://mcap.dev/spec>
//!
//! ```text
//! magic │ header │ chunk: schemas, channels, messages, packed │ indexes │ chunk … │ summary │ footer │ magic
//!
//! topic /can/can0        can_msgs/msg/Frame           a bus's frames, as this program writes them
//! topic /can/can0/fd     ros2_socketcan_msgs/msg/FdFrame
//! topic /log             foxglove.Log                 frames lost, links, times in which nothing came
//! ```
//! What has no place in a message stands in the metadata of its channel: a topic has a channel for frames received, one
//! for frames sent, and so on. Any other file gives the frames in messages of ROS 1 and ROS 2 that have an identifier and
//! data ([`layout`]); other topics are passed over.
//!
//! Reading is done here: the `mcap` crate panics on broken files, and its state cannot be copied. It is used for writing.

mod key;
mod layout;
mod message;
mod record;
mod records;
mod unpack;
#[cfg(feature = "mcap")]
mod write;

use record::{HEAD, Kind};
use records::Records;
use unpack::Unpacked;

use crate::capture::{Batch, BusNames, CaptureError, Format, LARGEST_RECORD, Notice, Parser, Place};
#[cfg(feature = "mcap")]
use crate::capture::{Holds, WritableFormat};

#[cfg(feature = "mcap")]
pub(crate) use write::{McapWriter, Topic};

/// Begins and ends a file.
const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Bytes of a chunk as it stands in the file, at most.
const LARGEST_CHUNK: usize = 32 * 1024 * 1024;

pub(super) const FORMAT: Format = Format {
    name: "mcap",
    title: "MCAP",
    is_text: false,
    detect: |head| head.starts_with(MAGIC),
    parser: |_| Box::new(Mcap::default()),
};

#[cfg(feature = "mcap")]
pub(super) const WRITABLE: WritableFormat = WritableFormat {
    name: FORMAT.name,
    suffix: "mcap",
    title: FORMAT.title,
    holds: Holds { negative: false, comments: false, ..Holds::ALL },
    writer: |output, options| Box::new(McapWriter::new(output, options.packing)),
};

/// Reader of MCAP.
#[derive(Default)]
struct Mcap {
    records: Records,
    /// Bytes taken so far.
    offset: u64,
    /// Bytes to pass over.
    skip: u64,
    chunk: Option<Open>,
    state: State,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum State {
    /// Nothing was taken.
    #[default]
    Start,
    Records,
    /// Behind the footer.
    Finished,
    /// All is said.
    Over,
}

/// The chunk at the front of the input, whose frames are being delivered.
#[derive(Default)]
struct Open {
    /// Bytes of its records that were dealt with.
    done: usize,
    /// Its records, if they had to be unpacked. A copy unpacks them again: a place in a capture stays small.
    unpacked: Option<Vec<u8>>,
    /// Whether its failure was told.
    is_told: bool,
}

impl Clone for Mcap {
    fn clone(&self) -> Self {
        let Self { records, offset, skip, chunk, state } = self;
        let chunk = chunk.as_ref().map(|Open { done, is_told, .. }| Open {
            done: *done,
            unpacked: None,
            is_told: *is_told,
        });
        Self { records: records.clone(), offset: *offset, skip: *skip, chunk, state: *state }
    }
}

/// What a step of the parser did.
enum Step {
    /// Took so many bytes.
    Took(usize),
    /// Nothing: more input, or a batch with room is needed.
    Wait,
}

impl Mcap {
    fn step(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> Step {
        if self.skip > 0 {
            return self.pass_over(rest);
        }
        match self.state {
            State::Start if rest.len() < MAGIC.len() && !at_end => return Step::Wait,
            State::Start => {
                self.state = State::Records;
                return Step::Took(MAGIC.len().min(rest.len()));
            }
            State::Records => {}
            State::Finished => return self.behind(at, rest, at_end, batch),
            State::Over => return if rest.is_empty() { Step::Wait } else { Step::Took(rest.len()) },
        }
        let Some((kind, length)) = record::head(rest) else {
            return if at_end { self.cut(at, rest, batch) } else { Step::Wait };
        };
        if let Kind::Unknown(kind) = kind {
            batch.push_unreadable(
                Place::Offset(at),
                format!("record of kind {kind:#04X}, which there is none of; expected 01 to 0F"),
            );
        }
        let is_needed = !matches!(kind, Kind::Other | Kind::Unknown(_) | Kind::Footer);
        let contents = rest.get(HEAD..).unwrap_or_default();
        let whole = usize::try_from(length).ok().and_then(|length| contents.get(..length));
        match whole {
            Some(contents) if is_needed => self.record(kind, at, contents, true, batch),
            _ if !is_needed => {
                if kind == Kind::Footer {
                    self.state = State::Finished;
                }
                self.skip = length;
                Step::Took(HEAD)
            }
            _ if at_end => {
                let taken = self.record(kind, at, contents, false, batch);
                if let Step::Took(_) = taken {
                    let there = contents.len();
                    cut_off(
                        format!("the capture ends inside a record: {there} bytes of {length}"),
                        at,
                        batch,
                    );
                    self.state = State::Over;
                }
                taken
            }
            None if length > self.largest_record() => {
                batch.push_unreadable(
                    Place::Offset(at),
                    format!("record of {length} bytes is too long and passed over"),
                );
                self.skip = length;
                Step::Took(HEAD)
            }
            _ => Step::Wait,
        }
    }

    #[expect(clippy::unused_self, reason = "read as a property of the reader")]
    fn largest_record(&self) -> u64 {
        LARGEST_CHUNK as u64
    }

    /// The end of the capture, where a record should begin: nothing, or a part of its head.
    fn cut(&mut self, at: u64, rest: &[u8], batch: &mut Batch) -> Step {
        if !rest.is_empty() {
            cut_off("the capture ends inside a record".into(), at, batch);
            self.state = State::Over;
        }
        Step::Took(rest.len())
    }

    fn pass_over(&mut self, rest: &[u8]) -> Step {
        let count = usize::try_from(self.skip).unwrap_or(usize::MAX).min(rest.len());
        self.skip -= count as u64;
        if count == 0 { Step::Wait } else { Step::Took(count) }
    }

    /// Behind the footer only the magic stands.
    fn behind(&mut self, at: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> Step {
        if rest.len() < MAGIC.len() && !at_end {
            return Step::Wait;
        }
        self.state = State::Over;
        if !rest.starts_with(MAGIC) {
            batch.push_unreadable(
                Place::Offset(at),
                "behind the footer: expected the magic at the file's end".into(),
            );
        }
        Step::Took(rest.len())
    }

    /// A record that is there, or the part of it that is.
    fn record(&mut self, kind: Kind, at: u64, contents: &[u8], is_whole: bool, batch: &mut Batch) -> Step {
        let taken = Step::Took(HEAD.saturating_add(contents.len()));
        match kind {
            Kind::Chunk => {
                let chunk = record::chunk(contents);
                if chunk.is_none() && is_whole {
                    batch.push_unreadable(Place::Offset(at), "chunk: too short".into());
                }
                if chunk.is_some_and(|chunk| !self.chunk(&chunk, at, is_whole, batch)) {
                    return Step::Wait;
                }
            }
            _ if is_whole => self.records.take(kind, contents, at, batch),
            _ => {}
        }
        taken
    }

    /// Delivers what is in a chunk; false when the batch is full before all is delivered.
    fn chunk(&mut self, chunk: &record::Chunk<'_>, at: u64, is_whole: bool, batch: &mut Batch) -> bool {
        let mut open = self.chunk.take().unwrap_or_default();
        let unpacked = match open.unpacked.take() {
            Some(records) => Unpacked { records: records.into(), failure: None },
            None => unpack::unpack(chunk.packing, chunk.packed, chunk.size),
        };
        if !std::mem::replace(&mut open.is_told, true) {
            tell(chunk, &unpacked, at, is_whole, batch);
        }
        let is_done = self.records.run(&unpacked.records, &mut open.done, at, batch);
        if !is_done {
            if let std::borrow::Cow::Owned(records) = unpacked.records {
                open.unpacked = Some(records);
            }
            self.chunk = Some(open);
        }
        is_done
    }

    fn end(&mut self, batch: &mut Batch) {
        match std::mem::replace(&mut self.state, State::Over) {
            State::Over => {}
            State::Finished if self.skip > 0 => {
                cut_off("the capture ends inside its footer".into(), self.offset, batch);
            }
            State::Records if self.skip > 0 => {
                let missing = self.skip;
                cut_off(
                    format!("the capture ends inside a record: {missing} bytes are missing"),
                    self.offset,
                    batch,
                );
            }
            State::Records | State::Start => {
                let text = "the recording was not finished: read to where it ends";
                batch.notice(Notice::Assumption(text.into()));
            }
            State::Finished => {
                batch.push_unreadable(
                    Place::Offset(self.offset),
                    "behind the footer: expected the magic at the file's end".into(),
                );
            }
        }
        self.records.summarise(batch);
    }
}

/// Says what is wrong with a chunk.
fn tell(chunk: &record::Chunk<'_>, unpacked: &Unpacked<'_>, at: u64, is_whole: bool, batch: &mut Batch) {
    if let Some(failure) = &unpacked.failure {
        batch.push_unreadable(Place::Offset(at), format!("chunk: {failure}"));
    } else if is_whole && (chunk.packed.len() as u64) < chunk.packed_size {
        let (there, said) = (chunk.packed.len(), chunk.packed_size);
        batch.push_unreadable(Place::Offset(at), format!("chunk: {there} bytes, expected {said}"));
    } else if is_whole && !checksum_fits(&unpacked.records, chunk.checksum) {
        batch.push_unreadable(
            Place::Offset(at),
            "chunk: its checksum is another, so its frames may be wrong".into(),
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
    batch.notice(Notice::CutOff { place: Place::Offset(at), reason });
}

impl Parser for Mcap {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = 0;
        while !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            let at = self.offset.saturating_add(taken as u64);
            match self.step(at, rest, at_end, batch) {
                Step::Took(0) | Step::Wait => break,
                Step::Took(count) => taken += count,
            }
        }
        self.offset = self.offset.saturating_add(taken as u64);
        if at_end && taken == input.len() && !batch.is_full() {
            self.end(batch);
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        &self.records.buses
    }

    fn largest(&self) -> usize {
        LARGEST_CHUNK + LARGEST_RECORD
    }

    fn clone_box(&self) -> Box<dyn Parser> {
        Box::new(self.clone())
    }
}
