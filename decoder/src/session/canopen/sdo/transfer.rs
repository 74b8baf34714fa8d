//! State of one SDO transfer.

use super::block::{BlockLoss, BlockProgress, DataPart};
use super::segments::SegmentProgress;
use super::strays::SegmentCheckpoint;
use crate::event::{
    CrcCheck, DataRange, FrameRange, MisplacedResponse, SdoAbort, SdoDirection, SdoIrregularity,
    SdoIrregularityKind, SdoMode, SdoOutcome,
};
use crate::frame::Frame;
use crate::session::limits::TRANSFER_DATA_LIMIT;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::SdoSide;

/// Data bytes of a segment.
const SEGMENT: u64 = 7;

/// Max ranges of data after gaps; the bytes of further ranges are only counted.
const RANGE_LIMIT: usize = 1_024;

/// Data of a classic frame, padded, with its length.
pub(super) type FrameData = ([u8; 8], u8);

/// Message that the transfer waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TransferStage {
    /// Response to the initiate message.
    Initiate,
    /// Segments or their confirmations.
    Segments,
    /// Start message of a block upload.
    BlockStart,
    /// Segments of a block, or their acknowledgement; byte 0 of the sender is a sequence number.
    BlockSegments,
    /// End message of a block transfer.
    BlockEnd,
    /// Response to the end message.
    BlockEndAnswer,
}

/// State of one transfer.
#[derive(Debug, Clone)]
pub(super) struct SdoTransferState {
    pub(super) channel: u16,
    pub(super) direction: Option<SdoDirection>,
    pub(super) mode: Option<SdoMode>,
    pub(super) object: Option<ObjectAddress>,
    pub(super) stage: TransferStage,
    pub(super) frames: FrameRange,
    pub(super) frame_count: u64,
    pub(super) first_time: Option<i64>,
    pub(super) last_time: Option<i64>,
    /// Time of the initiate request, of the last one if it was repeated.
    pub(super) last_request: Option<i64>,
    /// Time in ns from the request to the next one, if the client did not wait for the response.
    pub(super) overlap: Option<i64>,
    /// Number of retries of the request.
    pub(super) retries: u32,
    /// A retry of a transfer that is complete.
    pub(super) is_absorbed: bool,
    /// Segments may belong to another transfer.
    pub(super) is_ambiguous: bool,
    /// The capture has frames of the client before the first frame.
    pub(super) is_client_captured: bool,
    /// A response or abort without a request.
    pub(super) is_unrequested: bool,
    /// Responses that the client did not request.
    pub(super) unrequested_responses: u64,
    /// State before responses without a segment or request of the client, until these are judged.
    pub(super) checkpoint: Option<SegmentCheckpoint>,
    /// Responses of the server since the last frame of the client.
    pub(super) responses_in_row: u32,
    /// Response on the identifier of the requests, or of another server.
    pub(super) misplaced: Option<MisplacedResponse>,
    /// Sender of the last frame.
    pub(super) last_side: Option<SdoSide>,
    /// Monotonic time at which the transfer ends without a further message.
    pub(super) deadline: Option<i64>,
    /// A frame was added since the deadline was set.
    pub(super) is_touched: bool,
    pub(super) announced: Option<u32>,
    /// Bytes transferred, captured and stored or not.
    pub(super) size: u64,
    /// Bytes that were not captured.
    pub(super) unseen: u64,
    /// Data up to the first gap.
    pub(super) data: Vec<u8>,
    /// Data after gaps.
    pub(super) later_data: Vec<DataRange>,
    /// Data bytes in `later_data`.
    pub(super) later_bytes: usize,
    pub(super) truncated: bool,
    /// The data was dropped because of the common limit; later data is not stored.
    pub(super) data_given_up: bool,
    /// Toggle bits and missing segments of a segmented transfer.
    pub(super) segments: SegmentProgress,
    /// First violation of the protocol.
    pub(super) irregularity: Option<SdoIrregularity>,
    /// The last segment was received.
    pub(super) last_seen: bool,
    pub(super) blocks: Option<Box<BlockProgress>>,
    pub(super) outcome: SdoOutcome,
    pub(super) abort: Option<SdoAbort>,
    pub(super) cut_start: bool,
    /// Frames received: of the client, of the server.
    pub(super) sides: (bool, bool),
    /// First frame, and whether the client sent it.
    pub(super) opened_by: Option<(FrameData, bool)>,
}

impl SdoTransferState {
    /// Creates the transfer that `frame` starts.
    pub(super) fn new(channel: u16, object: Option<ObjectAddress>, frame: &Frame) -> Self {
        Self {
            channel,
            direction: None,
            mode: None,
            object,
            stage: TransferStage::Initiate,
            frames: FrameRange::one(frame.number),
            frame_count: 1,
            first_time: frame.time.map(|time| time.0),
            last_time: frame.time.map(|time| time.0),
            last_request: frame.time.map(|time| time.0),
            overlap: None,
            retries: 0,
            is_absorbed: false,
            is_ambiguous: false,
            is_client_captured: false,
            is_unrequested: false,
            unrequested_responses: 0,
            checkpoint: None,
            responses_in_row: 0,
            misplaced: None,
            last_side: None,
            deadline: None,
            is_touched: true,
            announced: None,
            size: 0,
            unseen: 0,
            data: Vec::new(),
            later_data: Vec::new(),
            later_bytes: 0,
            truncated: false,
            data_given_up: false,
            segments: SegmentProgress::default(),
            irregularity: None,
            last_seen: false,
            blocks: None,
            outcome: SdoOutcome::Unfinished,
            abort: None,
            cut_start: false,
            sides: (false, false),
            opened_by: None,
        }
    }

    /// Adds a frame to the transfer.
    pub(super) fn add_frame(&mut self, frame: &Frame) {
        self.is_touched = true;
        if self.frames.last != frame.number {
            self.frames.last = frame.number;
            self.frame_count += 1;
            self.last_time = frame.time.map(|time| time.0).or(self.last_time);
        }
    }

    /// Registers a frame of client or server.
    pub(super) fn note_frame(&mut self, side: SdoSide) {
        self.last_side = Some(side);
        match side {
            SdoSide::Client => self.sides.0 = true,
            SdoSide::Server => self.sides.1 = true,
        }
    }

    /// Whether client and server both sent frames.
    pub(super) fn is_answered(&self) -> bool {
        self.sides == (true, true)
    }

    /// Time in ns that the client waited without response; 0 without timestamps, `None` if not applicable.
    pub(super) fn waiting_time(&self, end: Option<i64>) -> Option<i64> {
        let is_over = match self.outcome {
            SdoOutcome::Timeout | SdoOutcome::Superseded => true,
            SdoOutcome::Aborted => self.abort.is_some_and(|abort| abort.by_client),
            SdoOutcome::Complete | SdoOutcome::Incomplete | SdoOutcome::Unfinished => false,
        };
        let is_unanswered = is_over && !self.sides.1 && !self.cut_start && !self.is_unrequested;
        if let Some(overlap) =
            self.overlap.filter(|_| is_unanswered && self.outcome == SdoOutcome::Superseded)
        {
            return Some(overlap);
        }
        is_unanswered
            .then(|| end.zip(self.first_time).map_or(0, |(end, first)| end.saturating_sub(first).max(0)))
    }

    /// Time from the first to the last frame, in ns.
    pub(super) fn duration(&self) -> Option<i64> {
        Some(self.last_time?.saturating_sub(self.first_time?))
    }

    /// Appends data; bytes over the limit are only counted.
    pub(super) fn keep_data(&mut self, bytes: &[u8]) {
        let offset = self.size;
        self.size += bytes.len() as u64;
        let limit = if self.data_given_up { 0 } else { TRANSFER_DATA_LIMIT };
        let room = limit.saturating_sub(self.kept_bytes());
        let kept = bytes.get(..room).unwrap_or(bytes);
        self.truncated |= kept.len() < bytes.len();
        if self.unseen == 0 {
            self.data.extend_from_slice(kept);
            return;
        }
        let has_room = self.later_data.len() < RANGE_LIMIT;
        match self.later_data.last_mut() {
            Some(range) if range.end() == offset => range.data.extend_from_slice(kept),
            _ if has_room && !kept.is_empty() => {
                self.later_data.push(DataRange { offset, data: kept.to_vec() });
            }
            _ => return,
        }
        self.later_bytes += kept.len();
    }

    /// Counts bytes that were transferred, but not captured.
    pub(super) fn skip_data(&mut self, count: usize) {
        self.size += count as u64;
        self.unseen += count as u64;
        self.truncated = true;
    }

    fn keep_part(&mut self, part: DataPart<'_>) {
        match part {
            DataPart::Bytes(bytes) => self.keep_data(bytes),
            DataPart::Gap(count) => self.skip_data(count),
        }
    }

    /// Data bytes stored.
    pub(super) fn kept_bytes(&self) -> usize {
        self.data.len() + self.later_bytes
    }

    /// Drops the data; later data is only counted, because the value would lack its start.
    pub(super) fn give_up_data(&mut self) {
        self.data = Vec::new();
        self.later_data = Vec::new();
        self.later_bytes = 0;
        self.data_given_up = true;
        self.truncated = true;
    }

    /// Stores the first violation of the protocol; none for a transfer without start.
    pub(super) fn note_irregularity(&mut self, what: SdoIrregularityKind, side: SdoSide, frame: u64) {
        if !self.cut_start {
            let by_client = side == SdoSide::Client;
            self.irregularity.get_or_insert(SdoIrregularity { what, by_client, frame });
        }
    }

    /// Sets the number of segments per block, and checks its range.
    pub(super) fn block_size(&mut self, segments: u8, side: SdoSide, frame: u64) {
        let is_valid = matches!(segments, 1..=127);
        if !is_valid && !self.blocks.as_ref().is_some_and(|blocks| blocks.is_complete) {
            self.note_irregularity(SdoIrregularityKind::BlockSize, side, frame);
        }
        self.blocks_mut().size = is_valid.then_some(segments);
    }

    /// Checks that a sequence number, sent or acknowledged, does not exceed the block size.
    pub(super) fn check_sequence(&mut self, sequence: u8, side: SdoSide, frame: u64) {
        let most = self.blocks.as_ref().and_then(|blocks| blocks.size).unwrap_or(127);
        if sequence > most {
            self.note_irregularity(SdoIrregularityKind::Sequence, side, frame);
        }
    }

    /// State of the blocks, created on first use.
    pub(super) fn blocks_mut(&mut self) -> &mut BlockProgress {
        self.blocks.get_or_insert_default()
    }

    /// Adds a segment of the present block.
    pub(super) fn take_block_segment(&mut self, sequence: u8, last: bool, data: &[u8]) {
        self.with_blocks(|blocks, keep| blocks.add_segment(sequence, last, data, keep));
    }

    /// Acknowledges segments of the present block.
    pub(super) fn acknowledge_segments(&mut self, sequence: u8, frame: u64) {
        self.with_blocks(|blocks, keep| blocks.acknowledge_segments(sequence, frame, keep));
        let is_complete = self.blocks_mut().is_complete || self.has_announced_size();
        self.stage = if is_complete { TransferStage::BlockEnd } else { TransferStage::BlockSegments };
    }

    /// Whether all announced bytes were acknowledged, although the final segment is missing in the capture.
    fn has_announced_size(&self) -> bool {
        let lacks_tail = self.blocks.as_ref().is_some_and(|blocks| blocks.expects_end());
        // The final segment itself is counted at the end message.
        let is_rest = |size: u32| (1..=SEGMENT).contains(&u64::from(size).saturating_sub(self.size));
        lacks_tail && !self.cut_start && self.announced.is_some_and(is_rest)
    }

    /// Applies the end message of the sender.
    pub(super) fn end_blocks(&mut self, unused: u8, crc: u16) {
        self.blocks_mut().starts_late |= self.cut_start;
        self.with_blocks(|blocks, keep| blocks.end_block(unused, crc, keep));
        let absent = self.announced.map_or(0, |size| u64::from(size).saturating_sub(self.size));
        self.blocks_mut().lacks_bytes(absent);
        self.truncated |= self.blocks_mut().is_unreliable();
        self.stage = TransferStage::BlockEndAnswer;
    }

    /// Runs `change` on the blocks; the data that it passes on is appended.
    fn with_blocks(&mut self, change: impl FnOnce(&mut BlockProgress, &mut dyn FnMut(DataPart<'_>))) {
        let mut blocks = self.blocks.take().unwrap_or_default();
        change(&mut blocks, &mut |part| self.keep_part(part));
        self.blocks = Some(blocks);
    }

    /// Ends the transfer with `outcome`, without a response to its last message.
    pub(super) fn end_with(&mut self, outcome: SdoOutcome) {
        self.outcome = outcome;
        if self.stage == TransferStage::BlockSegments && self.blocks.is_some() {
            self.with_blocks(|blocks, keep| blocks.give_up(keep));
        }
    }

    /// Ends the transfer as complete. If the end message of a block transfer is missing in the capture, the
    /// announced size shows how much of the last segment is data.
    pub(super) fn complete_transfer(&mut self) {
        self.outcome = SdoOutcome::Complete;
        if self.mode == Some(SdoMode::Segmented) {
            self.settle_segments();
        }
        if self.blocks.is_none()
            || !matches!(self.stage, TransferStage::BlockSegments | TransferStage::BlockEnd)
        {
            return;
        }
        self.with_blocks(|blocks, keep| blocks.presume_rest(keep));
        let whole = self.size.saturating_add(SEGMENT);
        let unused = self.announced.and_then(|size| whole.checked_sub(size.into()));
        let unused = unused.filter(|unused| *unused <= SEGMENT && !self.cut_start);
        self.truncated |= unused.is_none() || self.blocks_mut().is_unreliable();
        let unused = usize::try_from(unused.unwrap_or(0)).unwrap_or(0);
        self.with_blocks(|blocks, keep| blocks.end_tail(unused, keep));
    }

    /// Segments missing in the capture, and blocks with a loss on the bus.
    pub(super) fn count_losses(&self) -> (u64, u64, Option<BlockLoss>) {
        let missing = if self.is_flood() { 0 } else { self.segments.missing };
        let of_segments = (missing, 0, None);
        self.blocks.as_ref().map_or(of_segments, |blocks| (blocks.missing, blocks.losses, blocks.first_loss))
    }

    /// Result of the CRC check; `None` without an end message.
    pub(super) fn crc_verdict(&self) -> Option<CrcCheck> {
        self.blocks.as_ref().and_then(|blocks| blocks.crc_verdict())
    }

    /// Whether the value is complete although the first frames are missing: the response of an expedited
    /// upload contains all of it.
    pub(super) fn value_is_whole(&self) -> bool {
        self.mode == Some(SdoMode::Expedited) && self.direction == Some(SdoDirection::Upload)
    }

    /// Bytes held by the transfer.
    pub(super) fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.data.capacity()
            + self.later_data.capacity() * size_of::<DataRange>()
            + self.later_data.iter().map(|range| range.data.capacity()).sum::<usize>()
            + self.blocks.as_ref().map_or(0, |blocks| size_of::<BlockProgress>() + blocks.footprint())
    }
}
