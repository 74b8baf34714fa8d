//! One SDO channel: a pair of identifiers with its open transfer.

use std::collections::VecDeque;

use super::strays::UnrequestedResponses;
use super::transfer::{FrameData, SdoTransferState, TransferStage};
use crate::event::{SdoAbort, SdoDirection, SdoIrregularityKind, SdoMode, SdoOutcome};
use crate::frame::{Frame, Timestamp, low_bits};
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{InitiateData, SdoMessage, SdoSide, TransferPhase};

/// Abort code: toggle bit not alternated (CiA 301 §7.2.4.3.17).
const TOGGLE_NOT_ALTERNATED: u32 = 0x0503_0000;

/// Open transfer of a channel, and requests that the client sent without waiting for its response.
#[derive(Debug, Clone, Default)]
pub(super) struct ChannelState {
    pub(super) transfer: Option<Box<SdoTransferState>>,
    /// Further requests, in the order in which they were sent.
    pub(super) queue: VecDeque<Box<SdoTransferState>>,
    /// A timer entry exists.
    pub(super) queued: bool,
    /// The server responded to something else than the open requests.
    pub(super) has_stray: bool,
    /// Responses without a request since the last frame of the client.
    unrequested: u32,
    /// Exchange that the last response completed, since the last frame of the client.
    answered: Option<AnsweredExchange>,
    /// Frames were seen before the open transfer.
    has_history: bool,
    /// Frames of the client were seen.
    pub(super) has_client: bool,
    /// Responses that contradict the open transfer, since the last frame of the client.
    pub(super) strays: UnrequestedResponses,
}

/// An exchange of one request and one response.
#[derive(Debug, Clone, Copy)]
struct AnsweredExchange {
    object: ObjectAddress,
    direction: SdoDirection,
    /// Time of the response, and time from request to response, in ns.
    at: Timestamp,
    latency: i64,
}

impl AnsweredExchange {
    /// Exchange of a transfer that the server ended with a response to its first request.
    fn of_transfer(transfer: &SdoTransferState, frame: &Frame) -> Option<Self> {
        Some(Self {
            object: transfer.object?,
            direction: transfer.direction?,
            at: frame.time?,
            latency: transfer.duration().filter(|_| transfer.frame_count == 2 && !transfer.cut_start)?,
        })
    }

    /// Whether a further response belongs to the same request: it follows the first one sooner than a second request and
    /// its response could, if the server responds as fast again.
    fn is_answered_again(&self, object: ObjectAddress, direction: SdoDirection, frame: &Frame) -> bool {
        let elapsed = frame.time.map(|time| time.since(self.at));
        (self.object, self.direction) == (object, direction)
            && elapsed.is_some_and(|elapsed| (0..=self.latency).contains(&elapsed))
    }
}

/// Transfers ended by one frame: superseded ones, then that of the frame.
pub(super) type EndedTransfers = Vec<Box<SdoTransferState>>;

/// Whether a frame has the form of the end message of a block transfer (CiA 301 §7.2.4.3.10): command
/// 110nnn01, the CRC, and five reserved bytes of value 0.
fn is_end_message(data: &[u8]) -> bool {
    matches!(data, [command, _, _, 0, 0, 0, 0, 0] if command & 0xE3 == 0xC1)
}

impl ChannelState {
    /// Data bytes held by the open transfers.
    pub(super) fn open_bytes(&self) -> usize {
        let present = self.transfer.as_ref().map_or(0, |transfer| transfer.kept_bytes());
        // Called twice per message; most channels have one transfer at a time.
        if self.queue.is_empty() {
            return present;
        }
        present + self.queue.iter().map(|transfer| transfer.kept_bytes()).sum::<usize>()
    }

    /// Phase of a side, in which `data` is to be read.
    pub(super) fn phase_of(&self, side: SdoSide, data: &[u8]) -> TransferPhase {
        let Some(transfer) = self.transfer.as_deref() else { return TransferPhase::Commands };
        let is_sender = matches!(
            (transfer.direction, side),
            (Some(SdoDirection::Download), SdoSide::Client) | (Some(SdoDirection::Upload), SdoSide::Server)
        );
        let is_first = matches!(data, [command, ..] if command & 0x7F == 1);
        let is_segment = is_sender
            && match transfer.stage {
                TransferStage::BlockSegments => {
                    let expects_end = transfer.blocks.as_ref().is_some_and(|blocks| blocks.expects_end());
                    !(expects_end && is_end_message(data))
                }
                // The start message of the client is missing in the capture.
                TransferStage::BlockStart => true,
                // The response of the server is missing in the capture.
                TransferStage::Initiate => transfer.mode == Some(SdoMode::Block) && is_first,
                TransferStage::Segments | TransferStage::BlockEnd | TransferStage::BlockEndAnswer => false,
            };
        if is_segment { TransferPhase::BlockSegments } else { TransferPhase::Commands }
    }

    /// Applies a message; returns the transfers that it ended.
    pub(super) fn take_message(
        &mut self,
        index: u16,
        side: SdoSide,
        message: SdoMessage<'_>,
        frame: &Frame,
    ) -> EndedTransfers {
        let mut ended = Vec::new();
        if self.block_start_not_seen(index, side, &message, frame) {
            return ended;
        }
        self.has_history |= self.transfer.is_some();
        if side == SdoSide::Client {
            self.unrequested = 0;
            self.answered = None;
            self.has_client = true;
            self.settle_strays(index, &message, &mut ended);
        }
        if let SdoMessage::Abort { object, code } = message {
            self.select_request(&message);
            ended.push(self.abort_transfer(index, side, object, code, frame));
            return ended;
        }
        if side == SdoSide::Server {
            self.select_request(&message);
            if let Some(stray) = self.stray_answer(index, &message, frame) {
                ended.push(stray);
                return ended;
            }
            if self.takes_stray(&message, frame) {
                return ended;
            }
        }
        if side == SdoSide::Client && message.starts_transfer() {
            self.drop_absorbed();
        }
        if side == SdoSide::Client && self.queue_request(&message, frame, &mut ended) {
            self.add_request(index, message, frame);
            return ended;
        }
        ended.extend(self.superseded_by(&message));
        self.apply_message(index, side, message, frame, &mut ended);
        ended
    }

    /// Appends a request to the queue: it is read as if no transfer was open.
    fn add_request(&mut self, index: u16, message: SdoMessage<'_>, frame: &Frame) {
        let open = self.transfer.take();
        self.apply_message(index, SdoSide::Client, message, frame, &mut Vec::new());
        self.queue.extend(std::mem::replace(&mut self.transfer, open));
    }

    /// Applies a message to the open transfer.
    pub(super) fn apply_message(
        &mut self,
        index: u16,
        side: SdoSide,
        message: SdoMessage<'_>,
        frame: &Frame,
        ended: &mut EndedTransfers,
    ) {
        if let Some(transfer) = &mut self.transfer {
            transfer.add_frame(frame);
            transfer.misplaced = transfer.misplaced.filter(|_| side == SdoSide::Client);
        }
        let is_over = match side {
            SdoSide::Client => self.on_client(index, message, frame),
            SdoSide::Server => self.on_server(index, message, frame),
        };
        if let Some(transfer) = &mut self.transfer {
            transfer.note_frame(side);
            if transfer.frame_count == 1 {
                transfer.opened_by = Some((first_bytes(frame), side == SdoSide::Client));
            }
        }
        if side == SdoSide::Server {
            ended.extend(self.end_interleaved());
        }
        if let Some(mut transfer) = self.transfer.take_if(|_| is_over) {
            transfer.complete_transfer();
            if transfer.cut_start && !transfer.sides.0 && self.has_client {
                self.unrequested = self.unrequested.saturating_add(1);
                transfer.is_unrequested = self.unrequested > 1;
            }
            self.answered =
                AnsweredExchange::of_transfer(&transfer, frame).filter(|_| side == SdoSide::Server);
            self.next_request(&mut transfer);
            ended.push(transfer);
        }
    }

    /// Detects a capture that starts within a block, whose segments look like commands. Two consecutive
    /// frames of one sender with ascending first bytes are segments: a sender of an SDO command waits for a
    /// response.
    fn block_start_not_seen(
        &mut self,
        index: u16,
        side: SdoSide,
        message: &SdoMessage<'_>,
        frame: &Frame,
    ) -> bool {
        let Some(transfer) = self.transfer.as_ref().filter(|open| open.frame_count == 1) else {
            return false;
        };
        let Some((before, by_client)) = transfer.opened_by else { return false };
        let own = first_bytes(frame);
        let (Some(start), Some(now)) = (segment_of(&before), segment_of(&own)) else { return false };
        // Two requests of a client that does not wait may have such commands.
        if self.has_history && message.starts_transfer() {
            return false;
        }
        let counts_up = now.0 == start.0.wrapping_add(1) && !start.1;
        let is_sender = by_client == (side == SdoSide::Client);
        if !is_sender || !counts_up || transfer.stage == TransferStage::BlockSegments {
            return false;
        }
        let mut cut = SdoTransferState::new(index, None, frame);
        cut.frames.first = transfer.frames.first;
        cut.first_time = transfer.first_time;
        cut.frame_count = 2;
        cut.cut_start = true;
        cut.truncated = true;
        cut.mode = Some(SdoMode::Block);
        cut.direction = Some(if by_client { SdoDirection::Download } else { SdoDirection::Upload });
        cut.stage = TransferStage::BlockSegments;
        cut.note_frame(side);
        cut.blocks_mut().starts_late = true;
        for (sequence, last, data) in [start, now] {
            cut.take_block_segment(sequence, last, data);
        }
        self.transfer = Some(Box::new(cut));
        true
    }

    fn abort_transfer(
        &mut self,
        index: u16,
        side: SdoSide,
        object: ObjectAddress,
        code: u32,
        frame: &Frame,
    ) -> Box<SdoTransferState> {
        let mut transfer = self.transfer.take().unwrap_or_else(|| {
            let mut lone = SdoTransferState::new(index, Some(object), frame);
            lone.is_unrequested = true;
            Box::new(lone)
        });
        transfer.add_frame(frame);
        transfer.note_frame(side);
        transfer.object.get_or_insert(object);
        if code == TOGGLE_NOT_ALTERNATED && transfer.mode == Some(SdoMode::Segmented) {
            // The other side did not accept the repeated toggle bit as a repetition.
            let other = if side == SdoSide::Client { SdoSide::Server } else { SdoSide::Client };
            transfer.note_irregularity(SdoIrregularityKind::Toggle, other, frame.number);
        }
        transfer.end_with(SdoOutcome::Aborted);
        transfer.abort = Some(SdoAbort { code, by_client: side == SdoSide::Client });
        self.next_request(&mut transfer);
        transfer
    }

    /// Ends the open transfer if the message does not belong to it: the client starts another one, or
    /// direction or object differ because frames in between are missing.
    pub(super) fn superseded_by(&mut self, message: &SdoMessage<'_>) -> Option<Box<SdoTransferState>> {
        let open = self.transfer.as_ref()?;
        let upload = open.direction.map(|direction| direction == SdoDirection::Upload);
        let other_way = matches!((upload, message.is_upload()), (Some(open), Some(this)) if open != this);
        let other_object =
            matches!((open.object, message.object()), (Some(open), Some(this)) if open != this);
        if !message.starts_transfer() && !other_way && !other_object {
            return None;
        }
        let mut transfer = self.transfer.take()?;
        transfer.end_with(SdoOutcome::Superseded);
        Some(transfer).filter(|transfer| !transfer.is_absorbed)
    }

    /// Open transfer; creates one without start if none is open.
    fn open_or_cut(
        &mut self,
        index: u16,
        direction: SdoDirection,
        mode: SdoMode,
        frame: &Frame,
    ) -> &mut SdoTransferState {
        let is_client_captured = self.has_client;
        let transfer = self.transfer.get_or_insert_with(|| {
            let mut cut = SdoTransferState::new(index, None, frame);
            cut.is_client_captured = is_client_captured;
            cut.direction = Some(direction);
            cut.mode = Some(mode);
            cut.cut_start = true;
            cut.stage = if mode == SdoMode::Segmented {
                TransferStage::Segments
            } else {
                TransferStage::BlockSegments
            };
            if mode == SdoMode::Block {
                cut.blocks_mut().starts_late = true;
            }
            cut.truncated = true;
            Box::new(cut)
        });
        transfer.direction.get_or_insert(direction);
        transfer
    }

    /// Handles a message of the client; `true` if it ends the transfer.
    fn on_client(&mut self, index: u16, message: SdoMessage<'_>, frame: &Frame) -> bool {
        match message {
            SdoMessage::InitiateDownload { object, payload } => {
                let transfer = self.begin_transfer(index, object, SdoDirection::Download, frame);
                match payload {
                    InitiateData::Expedited { data, .. } => {
                        transfer.mode = Some(SdoMode::Expedited);
                        transfer.keep_data(data);
                    }
                    InitiateData::Segmented { size } => {
                        (transfer.mode, transfer.announced) = (Some(SdoMode::Segmented), size);
                    }
                }
            }
            SdoMessage::InitiateUpload { object } => {
                self.begin_transfer(index, object, SdoDirection::Upload, frame);
            }
            SdoMessage::InitiateBlockDownload { object, crc, size } => {
                let transfer = self.begin_transfer(index, object, SdoDirection::Download, frame);
                transfer.mode = Some(SdoMode::Block);
                transfer.announced = size;
                transfer.blocks_mut().client_offers(crc);
            }
            SdoMessage::InitiateBlockUpload { object, crc, block_size, .. } => {
                let transfer = self.begin_transfer(index, object, SdoDirection::Upload, frame);
                transfer.mode = Some(SdoMode::Block);
                transfer.blocks_mut().client_offers(crc);
                transfer.block_size(block_size, SdoSide::Client, frame.number);
            }
            SdoMessage::DownloadSegment(segment) => {
                self.open_or_cut(index, SdoDirection::Download, SdoMode::Segmented, frame)
                    .take_client_segment(&segment, frame.number);
            }
            SdoMessage::RequestUploadSegment { toggle } => {
                let transfer = self.open_or_cut(index, SdoDirection::Upload, SdoMode::Segmented, frame);
                transfer.asks_segment(toggle);
            }
            SdoMessage::EndBlockDownload(end) => {
                self.open_or_cut(index, SdoDirection::Download, SdoMode::Block, frame)
                    .end_blocks(end.unused, end.crc);
            }
            SdoMessage::StartBlockUpload => {
                self.open_or_cut(index, SdoDirection::Upload, SdoMode::Block, frame).stage =
                    TransferStage::BlockSegments;
            }
            SdoMessage::BlockUploadAcknowledged { sequence, block_size } => {
                let transfer = self.open_or_cut(index, SdoDirection::Upload, SdoMode::Block, frame);
                transfer.check_sequence(sequence, SdoSide::Client, frame.number);
                transfer.acknowledge_segments(sequence, frame.number);
                transfer.block_size(block_size, SdoSide::Client, frame.number);
            }
            SdoMessage::BlockUploadEnded => {
                self.open_or_cut(index, SdoDirection::Upload, SdoMode::Block, frame);
                return true;
            }
            SdoMessage::BlockSegment { sequence, last, data } => {
                self.on_segment(sequence, last, data, SdoSide::Client, frame);
            }
            _ => {}
        }
        false
    }

    fn begin_transfer(
        &mut self,
        index: u16,
        object: ObjectAddress,
        direction: SdoDirection,
        frame: &Frame,
    ) -> &mut SdoTransferState {
        let mut transfer = SdoTransferState::new(index, Some(object), frame);
        transfer.direction = Some(direction);
        self.transfer.insert(Box::new(transfer))
    }

    fn on_segment(&mut self, sequence: u8, last: bool, data: &[u8], side: SdoSide, frame: &Frame) {
        if let Some(transfer) = &mut self.transfer {
            transfer.check_sequence(sequence, side, frame.number);
            transfer.take_block_segment(sequence, last, data);
            transfer.stage = TransferStage::BlockSegments;
        }
    }

    /// A response for another object than the open transfer, or without one: its request is missing in the
    /// capture. Expedited responses and confirmations are complete transfers.
    fn stray_answer(
        &mut self,
        index: u16,
        message: &SdoMessage<'_>,
        frame: &Frame,
    ) -> Option<Box<SdoTransferState>> {
        let (object, direction) = match message {
            SdoMessage::DownloadInitiated { object } => (*object, SdoDirection::Download),
            SdoMessage::UploadInitiated { object, payload: InitiateData::Expedited { .. } } => {
                (*object, SdoDirection::Upload)
            }
            _ => return None,
        };
        let answers = self.transfer.as_ref().is_some_and(|open| {
            open.object == Some(object)
                && open.direction == Some(direction)
                && open.stage == TransferStage::Initiate
        });
        if answers {
            return None;
        }
        self.has_stray = self.transfer.is_some();
        self.unrequested = self.unrequested.saturating_add(1);
        let mut stray = SdoTransferState::new(index, Some(object), frame);
        stray.note_frame(SdoSide::Server);
        // The first one may be the response to a request before the capture, or a late one; not if it repeats the response
        // before it.
        let is_second = self.answered.is_some_and(|first| first.is_answered_again(object, direction, frame));
        stray.is_unrequested = self.unrequested > 1 || is_second;
        stray.direction = Some(direction);
        stray.cut_start = true;
        stray.outcome = SdoOutcome::Complete;
        if let SdoMessage::UploadInitiated { payload: InitiateData::Expedited { data, .. }, .. } = message {
            stray.mode = Some(SdoMode::Expedited);
            stray.keep_data(data);
        }
        Some(Box::new(stray))
    }

    /// Handles a message of the server; `true` if it ends the transfer.
    fn on_server(&mut self, index: u16, message: SdoMessage<'_>, frame: &Frame) -> bool {
        match message {
            SdoMessage::DownloadInitiated { .. } => {
                let Some(transfer) = &mut self.transfer else { return false };
                transfer.stage = TransferStage::Segments;
                return transfer.mode == Some(SdoMode::Expedited);
            }
            SdoMessage::UploadInitiated { object, payload } => {
                return self.upload_initiated(index, object, payload, frame);
            }
            SdoMessage::DownloadSegmentAccepted { toggle } => {
                let transfer = self.open_or_cut(index, SdoDirection::Download, SdoMode::Segmented, frame);
                transfer.confirms_segment(toggle, frame.number);
                return transfer.last_seen;
            }
            SdoMessage::UploadSegment(segment) => {
                let transfer = self.open_or_cut(index, SdoDirection::Upload, SdoMode::Segmented, frame);
                transfer.answers_with_segment(&segment, frame.number);
                return transfer.last_seen;
            }
            SdoMessage::BlockDownloadInitiated { object, crc, block_size } => {
                let transfer = self.open_or_cut(index, SdoDirection::Download, SdoMode::Block, frame);
                transfer.object.get_or_insert(object);
                transfer.stage = TransferStage::BlockSegments;
                transfer.blocks_mut().server_offers(crc);
                transfer.block_size(block_size, SdoSide::Server, frame.number);
            }
            SdoMessage::BlockDownloadAcknowledged { sequence, block_size } => {
                let transfer = self.open_or_cut(index, SdoDirection::Download, SdoMode::Block, frame);
                transfer.check_sequence(sequence, SdoSide::Server, frame.number);
                transfer.acknowledge_segments(sequence, frame.number);
                transfer.block_size(block_size, SdoSide::Server, frame.number);
            }
            SdoMessage::BlockDownloadEnded => {
                self.open_or_cut(index, SdoDirection::Download, SdoMode::Block, frame);
                return true;
            }
            SdoMessage::BlockUploadInitiated { object, crc, size } => {
                let transfer = self.open_or_cut(index, SdoDirection::Upload, SdoMode::Block, frame);
                transfer.object.get_or_insert(object);
                transfer.announced = size;
                transfer.stage = TransferStage::BlockStart;
                transfer.blocks_mut().server_offers(crc);
            }
            SdoMessage::EndBlockUpload(end) => {
                self.open_or_cut(index, SdoDirection::Upload, SdoMode::Block, frame)
                    .end_blocks(end.unused, end.crc);
            }
            SdoMessage::BlockSegment { sequence, last, data } => {
                self.on_segment(sequence, last, data, SdoSide::Server, frame);
            }
            _ => {}
        }
        false
    }

    /// Data or size from the server; with it the server may also reject a block transfer.
    fn upload_initiated(
        &mut self,
        index: u16,
        object: ObjectAddress,
        payload: InitiateData<'_>,
        frame: &Frame,
    ) -> bool {
        let transfer = self.open_or_cut(index, SdoDirection::Upload, SdoMode::Segmented, frame);
        transfer.object.get_or_insert(object);
        transfer.blocks = None;
        match payload {
            InitiateData::Expedited { data, .. } => {
                transfer.mode = Some(SdoMode::Expedited);
                transfer.irregularity = None;
                transfer.keep_data(data);
                true
            }
            InitiateData::Segmented { size } => {
                transfer.mode = Some(SdoMode::Segmented);
                transfer.announced = size;
                transfer.stage = TransferStage::Segments;
                transfer.truncated = transfer.data_given_up;
                false
            }
        }
    }
}

/// Data of a frame of at most eight bytes.
pub(super) fn first_bytes(frame: &Frame) -> FrameData {
    let length = if frame.data().is_empty() { 0 } else { frame.length.min(8) };
    let word = frame.bytes.first_chunk().map_or(0, |bytes| u64::from_le_bytes(*bytes));
    ((word & low_bits(8 * u32::from(length))).to_le_bytes(), frame.length.min(8))
}

/// A frame read as a segment of a block: sequence number, whether it is the last one, and its data.
fn segment_of((bytes, length): &FrameData) -> Option<(u8, bool, &[u8])> {
    let (command, data) = bytes.get(..usize::from(*length))?.split_first()?;
    Some((command & 0x7F, command & 0x80 != 0, data))
}
