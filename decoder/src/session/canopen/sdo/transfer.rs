//! One SDO transfer: what was asked, what came, what comes next.

use super::block::Blocks;
use crate::event::{Abort, Crc, Direction, FrameRange, Mode, Outcome, SdoIrregularity, SdoIrregularityKind};
use crate::frame::Frame;
use crate::session::limits::TRANSFER_DATA_LIMIT;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{Segment, Side};

/// What the transfer waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// The server's answer to the initiate message.
    Initiate,
    /// Segments, or their confirmations.
    Segments,
    /// A block upload's start message.
    BlockStart,
    /// Segments of a block, or their acknowledgement: the sender's bytes are sequence numbers.
    BlockSegments,
    /// The end message.
    BlockEnd,
    /// The answer to the end message.
    BlockEndAnswer,
}

/// One transfer.
#[derive(Debug, Clone)]
pub(super) struct Transfer {
    pub(super) channel: u16,
    pub(super) direction: Option<Direction>,
    pub(super) mode: Option<Mode>,
    pub(super) object: Option<ObjectAddress>,
    pub(super) stage: Stage,
    pub(super) frames: FrameRange,
    pub(super) frame_count: u64,
    first_time: Option<i64>,
    last_time: Option<i64>,
    pub(super) announced: Option<u32>,
    /// Bytes counted, kept or not.
    pub(super) size: u64,
    pub(super) data: Vec<u8>,
    pub(super) truncated: bool,
    /// The data was dropped for others; none is kept from then on.
    pub(super) data_given_up: bool,
    /// Toggle bit the next segment should have.
    toggle: bool,
    /// Toggle bit of the last segment sent or asked for by the client.
    asked: Option<bool>,
    /// The first thing in it that is against the protocol.
    pub(super) irregularity: Option<SdoIrregularity>,
    /// The last segment was seen.
    pub(super) last_seen: bool,
    pub(super) blocks: Option<Box<Blocks>>,
    pub(super) outcome: Outcome,
    pub(super) abort: Option<Abort>,
    pub(super) cut_start: bool,
    /// Frames of the client and of the server were seen.
    pub(super) sides: (bool, bool),
    /// First byte of the frame that opened it, and whether the client sent it.
    pub(super) opened_by: (u8, bool),
}

impl Transfer {
    /// A transfer that `frame` begins.
    pub(super) fn new(channel: u16, object: Option<ObjectAddress>, frame: &Frame) -> Self {
        Self {
            channel,
            direction: None,
            mode: None,
            object,
            stage: Stage::Initiate,
            frames: FrameRange::one(frame.number),
            frame_count: 1,
            first_time: frame.time.map(|time| time.0),
            last_time: frame.time.map(|time| time.0),
            announced: None,
            size: 0,
            data: Vec::new(),
            truncated: false,
            data_given_up: false,
            toggle: false,
            asked: None,
            irregularity: None,
            last_seen: false,
            blocks: None,
            outcome: Outcome::Unfinished,
            abort: None,
            cut_start: false,
            sides: (false, false),
            opened_by: (0, false),
        }
    }

    /// Another frame belongs to it.
    pub(super) fn add_frame(&mut self, frame: &Frame) {
        if self.frames.last != frame.number {
            self.frames.last = frame.number;
            self.frame_count += 1;
            self.last_time = frame.time.map(|time| time.0).or(self.last_time);
        }
    }

    /// A side sent one of its frames.
    pub(super) fn saw(&mut self, side: Side) {
        match side {
            Side::Client => self.sides.0 = true,
            Side::Server => self.sides.1 = true,
        }
    }

    /// Whether both sides took part.
    pub(super) fn is_answered(&self) -> bool {
        self.sides == (true, true)
    }

    /// Nanoseconds a server that sent nothing was given up to its end; 0 without stamps.
    pub(super) fn waited(&self, end: Option<i64>) -> Option<i64> {
        let is_over = match self.outcome {
            Outcome::Timeout | Outcome::Superseded => true,
            Outcome::Aborted => self.abort.is_some_and(|abort| abort.by_client),
            Outcome::Complete | Outcome::Incomplete | Outcome::Unfinished => false,
        };
        let is_unanswered = is_over && !self.sides.1 && !self.cut_start;
        is_unanswered
            .then(|| end.zip(self.first_time).map_or(0, |(end, first)| end.saturating_sub(first).max(0)))
    }

    /// Nanoseconds from first to last frame.
    pub(super) fn duration(&self) -> Option<i64> {
        Some(self.last_time?.saturating_sub(self.first_time?))
    }

    /// Takes data; what is over the limit is counted only.
    pub(super) fn keep(&mut self, bytes: &[u8]) {
        self.size += bytes.len() as u64;
        let limit = if self.data_given_up { 0 } else { TRANSFER_DATA_LIMIT };
        let room = limit.saturating_sub(self.data.len());
        let kept = bytes.get(..room).unwrap_or(bytes);
        self.truncated |= kept.len() < bytes.len();
        self.data.extend_from_slice(kept);
    }

    /// Drops the data: what comes is counted only, so that no middle part passes for a beginning.
    pub(super) fn give_up_data(&mut self) {
        self.data = Vec::new();
        self.data_given_up = true;
        self.truncated = true;
    }

    /// Takes a segment. One that repeats the toggle bit of the one before is the same again.
    pub(super) fn take_segment(&mut self, segment: &Segment<'_>) {
        if self.last_seen {
            return;
        }
        let is_first = self.size == 0 && self.cut_start;
        if segment.toggle != self.toggle && !is_first {
            return;
        }
        self.toggle = !segment.toggle;
        self.keep(segment.data);
        self.last_seen = segment.last;
    }

    /// Something is against the protocol; the first counts. Nothing is said of a transfer not seen whole.
    pub(super) fn irregular(&mut self, what: SdoIrregularityKind, side: Side, frame: u64) {
        if !self.cut_start {
            let by_client = side == Side::Client;
            self.irregularity.get_or_insert(SdoIrregularity { what, by_client, frame });
        }
    }

    /// The client asks for a segment or sends one. A toggle bit that was there before may be the same again, so
    /// only the first one is judged.
    pub(super) fn asks_segment(&mut self, toggle: bool, frame: u64) {
        if toggle && self.asked.is_none() {
            self.irregular(SdoIrregularityKind::Toggle, Side::Client, frame);
        }
        self.asked = Some(toggle);
    }

    /// Takes a segment of a download.
    pub(super) fn take_client_segment(&mut self, segment: &Segment<'_>, frame: u64) {
        self.asks_segment(segment.toggle, frame);
        self.take_segment(segment);
    }

    /// The server answers that, with the same toggle bit.
    pub(super) fn answers_segment(&mut self, toggle: bool, frame: u64) {
        if self.asked.take().is_some_and(|asked| asked != toggle) {
            self.irregular(SdoIrregularityKind::Toggle, Side::Server, frame);
        }
        self.asked.get_or_insert(toggle);
    }

    /// A side says how many segments a block has.
    pub(super) fn block_size(&mut self, segments: u8, side: Side, frame: u64) {
        let is_valid = matches!(segments, 1..=127);
        if !is_valid && !self.blocks.as_ref().is_some_and(|blocks| blocks.is_complete) {
            self.irregular(SdoIrregularityKind::BlockSize, side, frame);
        }
        self.blocks_mut().size = is_valid.then_some(segments);
    }

    /// A side sends a segment, or acknowledges those up to it: of more than a block has there are none.
    pub(super) fn sequence(&mut self, sequence: u8, side: Side, frame: u64) {
        let most = self.blocks.as_ref().and_then(|blocks| blocks.size).unwrap_or(127);
        if sequence > most {
            self.irregular(SdoIrregularityKind::Sequence, side, frame);
        }
    }

    /// The blocks, begun if they were not.
    pub(super) fn blocks_mut(&mut self) -> &mut Blocks {
        self.blocks.get_or_insert_default()
    }

    /// The receiver acknowledged segments of the present block.
    pub(super) fn acknowledge(&mut self, sequence: u8) {
        let mut blocks = self.blocks.take().unwrap_or_default();
        blocks.acknowledge(sequence, |bytes| self.keep(bytes));
        self.truncated |= blocks.has_gap;
        self.stage = if blocks.is_complete { Stage::BlockEnd } else { Stage::BlockSegments };
        self.blocks = Some(blocks);
    }

    /// The sender's end message.
    pub(super) fn end_blocks(&mut self, unused: u8, crc: u16) {
        let mut blocks = self.blocks.take().unwrap_or_default();
        blocks.end(unused, crc, self.cut_start, |bytes| self.keep(bytes));
        self.blocks = Some(blocks);
        self.stage = Stage::BlockEndAnswer;
    }

    /// It ends as `outcome`.
    pub(super) fn end(&mut self, outcome: Outcome) {
        self.outcome = outcome;
        if outcome != Outcome::Complete
            && self.stage == Stage::BlockSegments
            && let Some(mut blocks) = self.blocks.take()
        {
            blocks.give_up(|bytes| self.keep(bytes));
            self.blocks = Some(blocks);
        }
    }

    /// CRC verdict of a block transfer that came to its end message.
    pub(super) fn crc(&self) -> Option<Crc> {
        self.blocks.as_ref().and_then(|blocks| blocks.verdict())
    }

    /// Whether the data is all of the value although the transfer's first frames are missing: an
    /// expedited answer holds it whole.
    pub(super) fn value_is_whole(&self) -> bool {
        self.mode == Some(Mode::Expedited) && self.direction == Some(Direction::Upload)
    }

    /// Bytes held.
    pub(super) fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.data.capacity()
            + self.blocks.as_ref().map_or(0, |blocks| size_of::<Blocks>() + blocks.footprint())
    }
}
