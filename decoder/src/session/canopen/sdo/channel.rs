//! One SDO channel: a pair of identifiers with its open transfer.

use std::collections::VecDeque;

use super::transfer::{FrameData, Stage, Transfer};
use crate::event::{Abort, Direction, Mode, Outcome, SdoIrregularityKind};
use crate::frame::{Frame, low_bits};
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{Payload, Phase, Sdo, Side};

/// Abort code: toggle bit not alternated (CiA 301 §7.2.4.3.17).
const TOGGLE_NOT_ALTERNATED: u32 = 0x0503_0000;

/// Open transfer of a channel, and requests that the client sent without waiting for its response.
#[derive(Debug, Clone, Default)]
pub(super) struct Channel {
    pub(super) transfer: Option<Box<Transfer>>,
    /// Further requests, in the order in which they were sent.
    pub(super) queue: VecDeque<Box<Transfer>>,
    /// A timer entry exists.
    pub(super) queued: bool,
    /// The server responded to something else than the open requests.
    pub(super) has_stray: bool,
    /// Responses without a request since the last frame of the client.
    unrequested: u32,
    /// Frames were seen before the open transfer.
    has_history: bool,
}

/// Transfers ended by one frame: superseded ones, then that of the frame.
pub(super) type EndedTransfers = Vec<Box<Transfer>>;

/// Whether a frame has the form of the end message of a block transfer (CiA 301 §7.2.4.3.10): command
/// 110nnn01, the CRC, and five reserved bytes of value 0.
fn is_end_message(data: &[u8]) -> bool {
    matches!(data, [command, _, _, 0, 0, 0, 0, 0] if command & 0xE3 == 0xC1)
}

impl Channel {
    /// Data bytes held by the open transfers.
    pub(super) fn open_bytes(&self) -> usize {
        self.transfer.iter().chain(&self.queue).map(|transfer| transfer.kept_bytes()).sum()
    }

    /// Phase of a side, in which `data` is to be read.
    pub(super) fn phase(&self, side: Side, data: &[u8]) -> Phase {
        let Some(transfer) = self.transfer.as_deref() else { return Phase::Commands };
        let is_sender = matches!(
            (transfer.direction, side),
            (Some(Direction::Download), Side::Client) | (Some(Direction::Upload), Side::Server)
        );
        let is_first = matches!(data, [command, ..] if command & 0x7F == 1);
        let is_segment = is_sender
            && match transfer.stage {
                Stage::BlockSegments => {
                    let expects_end = transfer.blocks.as_ref().is_some_and(|blocks| blocks.expects_end());
                    !(expects_end && is_end_message(data))
                }
                // The start message of the client is missing in the capture.
                Stage::BlockStart => true,
                // The response of the server is missing in the capture.
                Stage::Initiate => transfer.mode == Some(Mode::Block) && is_first,
                Stage::Segments | Stage::BlockEnd | Stage::BlockEndAnswer => false,
            };
        if is_segment { Phase::BlockSegments } else { Phase::Commands }
    }

    /// Applies a message; returns the transfers that it ended.
    pub(super) fn take(&mut self, index: u16, side: Side, message: Sdo<'_>, frame: &Frame) -> EndedTransfers {
        let mut ended = Vec::new();
        if self.block_start_not_seen(index, side, &message, frame) {
            return ended;
        }
        self.has_history |= self.transfer.is_some();
        if side == Side::Client {
            self.unrequested = 0;
        }
        if let Sdo::Abort { object, code } = message {
            self.select(&message);
            ended.push(self.abort(index, side, object, code, frame));
            return ended;
        }
        if side == Side::Server {
            self.select(&message);
            if let Some(stray) = self.stray_answer(index, &message, frame) {
                ended.push(stray);
                return ended;
            }
        }
        if side == Side::Client && message.begins() {
            self.drop_absorbed();
        }
        if side == Side::Client && self.queue_request(&message, frame, &mut ended) {
            self.add_request(index, message, frame);
            return ended;
        }
        ended.extend(self.superseded_by(&message));
        self.apply(index, side, message, frame, &mut ended);
        ended
    }

    /// Appends a request to the queue: it is read as if no transfer was open.
    fn add_request(&mut self, index: u16, message: Sdo<'_>, frame: &Frame) {
        let open = self.transfer.take();
        self.apply(index, Side::Client, message, frame, &mut Vec::new());
        self.queue.extend(std::mem::replace(&mut self.transfer, open));
    }

    /// Applies a message to the open transfer.
    fn apply(&mut self, index: u16, side: Side, message: Sdo<'_>, frame: &Frame, ended: &mut EndedTransfers) {
        if let Some(transfer) = &mut self.transfer {
            transfer.add_frame(frame);
        }
        let is_over = match side {
            Side::Client => self.client(index, message, frame),
            Side::Server => self.server(index, message, frame),
        };
        if let Some(transfer) = &mut self.transfer {
            transfer.saw(side);
            if transfer.frame_count == 1 {
                transfer.opened_by = Some((first_bytes(frame), side == Side::Client));
            }
        }
        if side == Side::Server {
            ended.extend(self.end_interleaved());
        }
        if let Some(mut transfer) = self.transfer.take_if(|_| is_over) {
            transfer.complete();
            self.next_request(&mut transfer);
            ended.push(transfer);
        }
    }

    /// Detects a capture that starts within a block, whose segments look like commands. Two consecutive
    /// frames of one sender with ascending first bytes are segments: a sender of an SDO command waits for a
    /// response.
    fn block_start_not_seen(&mut self, index: u16, side: Side, message: &Sdo<'_>, frame: &Frame) -> bool {
        let Some(transfer) = self.transfer.as_ref().filter(|open| open.frame_count == 1) else {
            return false;
        };
        let Some((before, by_client)) = transfer.opened_by else { return false };
        let own = first_bytes(frame);
        let (Some(start), Some(now)) = (segment_of(&before), segment_of(&own)) else { return false };
        // Two requests of a client that does not wait may have such commands.
        if self.has_history && message.begins() {
            return false;
        }
        let counts_up = now.0 == start.0.wrapping_add(1) && !start.1;
        let is_sender = by_client == (side == Side::Client);
        if !is_sender || !counts_up || transfer.stage == Stage::BlockSegments {
            return false;
        }
        let mut cut = Transfer::new(index, None, frame);
        cut.frames.first = transfer.frames.first;
        cut.first_time = transfer.first_time;
        cut.frame_count = 2;
        cut.cut_start = true;
        cut.truncated = true;
        cut.mode = Some(Mode::Block);
        cut.direction = Some(if by_client { Direction::Download } else { Direction::Upload });
        cut.stage = Stage::BlockSegments;
        cut.saw(side);
        cut.blocks_mut().starts_late = true;
        for (sequence, last, data) in [start, now] {
            cut.take_block_segment(sequence, last, data);
        }
        self.transfer = Some(Box::new(cut));
        true
    }

    fn abort(
        &mut self,
        index: u16,
        side: Side,
        object: ObjectAddress,
        code: u32,
        frame: &Frame,
    ) -> Box<Transfer> {
        let mut transfer = self.transfer.take().unwrap_or_else(|| {
            let mut lone = Transfer::new(index, Some(object), frame);
            lone.is_unrequested = true;
            Box::new(lone)
        });
        transfer.add_frame(frame);
        transfer.saw(side);
        transfer.object.get_or_insert(object);
        if code == TOGGLE_NOT_ALTERNATED && transfer.mode == Some(Mode::Segmented) {
            // The other side did not accept the repeated toggle bit as a repetition.
            let other = if side == Side::Client { Side::Server } else { Side::Client };
            transfer.irregular(SdoIrregularityKind::Toggle, other, frame.number);
        }
        transfer.end(Outcome::Aborted);
        transfer.abort = Some(Abort { code, by_client: side == Side::Client });
        self.next_request(&mut transfer);
        transfer
    }

    /// Ends the open transfer if the message does not belong to it: the client starts another one, or
    /// direction or object differ because frames in between are missing.
    fn superseded_by(&mut self, message: &Sdo<'_>) -> Option<Box<Transfer>> {
        let open = self.transfer.as_ref()?;
        let upload = open.direction.map(|direction| direction == Direction::Upload);
        let other_way = matches!((upload, message.is_upload()), (Some(open), Some(this)) if open != this);
        let other_object =
            matches!((open.object, message.object()), (Some(open), Some(this)) if open != this);
        if !message.begins() && !other_way && !other_object {
            return None;
        }
        let mut transfer = self.transfer.take()?;
        transfer.end(Outcome::Superseded);
        Some(transfer).filter(|transfer| !transfer.is_absorbed)
    }

    /// Open transfer; creates one without start if none is open.
    fn open_or_cut(&mut self, index: u16, direction: Direction, mode: Mode, frame: &Frame) -> &mut Transfer {
        let transfer = self.transfer.get_or_insert_with(|| {
            let mut cut = Transfer::new(index, None, frame);
            cut.direction = Some(direction);
            cut.mode = Some(mode);
            cut.cut_start = true;
            cut.stage = if mode == Mode::Segmented { Stage::Segments } else { Stage::BlockSegments };
            if mode == Mode::Block {
                cut.blocks_mut().starts_late = true;
            }
            cut.truncated = true;
            Box::new(cut)
        });
        transfer.direction.get_or_insert(direction);
        transfer
    }

    /// Handles a message of the client; `true` if it ends the transfer.
    fn client(&mut self, index: u16, message: Sdo<'_>, frame: &Frame) -> bool {
        match message {
            Sdo::InitiateDownload { object, payload } => {
                let transfer = self.begin(index, object, Direction::Download, frame);
                match payload {
                    Payload::Expedited { data, .. } => {
                        transfer.mode = Some(Mode::Expedited);
                        transfer.keep(data);
                    }
                    Payload::Segmented { size } => {
                        transfer.mode = Some(Mode::Segmented);
                        transfer.announced = size;
                    }
                }
            }
            Sdo::InitiateUpload { object } => {
                self.begin(index, object, Direction::Upload, frame);
            }
            Sdo::InitiateBlockDownload { object, crc, size } => {
                let transfer = self.begin(index, object, Direction::Download, frame);
                transfer.mode = Some(Mode::Block);
                transfer.announced = size;
                transfer.blocks_mut().client_offers(crc);
            }
            Sdo::InitiateBlockUpload { object, crc, block_size, .. } => {
                let transfer = self.begin(index, object, Direction::Upload, frame);
                transfer.mode = Some(Mode::Block);
                transfer.blocks_mut().client_offers(crc);
                transfer.block_size(block_size, Side::Client, frame.number);
            }
            Sdo::DownloadSegment(segment) => {
                self.open_or_cut(index, Direction::Download, Mode::Segmented, frame)
                    .take_client_segment(&segment, frame.number);
            }
            Sdo::RequestUploadSegment { toggle } => {
                let transfer = self.open_or_cut(index, Direction::Upload, Mode::Segmented, frame);
                transfer.asks_segment(toggle);
            }
            Sdo::EndBlockDownload(end) => {
                self.open_or_cut(index, Direction::Download, Mode::Block, frame)
                    .end_blocks(end.unused, end.crc);
            }
            Sdo::StartBlockUpload => {
                self.open_or_cut(index, Direction::Upload, Mode::Block, frame).stage = Stage::BlockSegments;
            }
            Sdo::BlockUploadAcknowledged { sequence, block_size } => {
                let transfer = self.open_or_cut(index, Direction::Upload, Mode::Block, frame);
                transfer.sequence(sequence, Side::Client, frame.number);
                transfer.acknowledge(sequence, frame.number);
                transfer.block_size(block_size, Side::Client, frame.number);
            }
            Sdo::BlockUploadEnded => {
                self.open_or_cut(index, Direction::Upload, Mode::Block, frame);
                return true;
            }
            Sdo::BlockSegment { sequence, last, data } => {
                self.segment(sequence, last, data, Side::Client, frame);
            }
            _ => {}
        }
        false
    }

    fn begin(
        &mut self,
        index: u16,
        object: ObjectAddress,
        direction: Direction,
        frame: &Frame,
    ) -> &mut Transfer {
        let mut transfer = Transfer::new(index, Some(object), frame);
        transfer.direction = Some(direction);
        self.transfer.insert(Box::new(transfer))
    }

    fn segment(&mut self, sequence: u8, last: bool, data: &[u8], side: Side, frame: &Frame) {
        if let Some(transfer) = &mut self.transfer {
            transfer.sequence(sequence, side, frame.number);
            transfer.take_block_segment(sequence, last, data);
            transfer.stage = Stage::BlockSegments;
        }
    }

    /// A response for another object than the open transfer, or without one: its request is missing in the
    /// capture. Expedited responses and confirmations are complete transfers.
    fn stray_answer(&mut self, index: u16, message: &Sdo<'_>, frame: &Frame) -> Option<Box<Transfer>> {
        let (object, direction) = match message {
            Sdo::DownloadInitiated { object } => (*object, Direction::Download),
            Sdo::UploadInitiated { object, payload: Payload::Expedited { .. } } => {
                (*object, Direction::Upload)
            }
            _ => return None,
        };
        let answers = self.transfer.as_ref().is_some_and(|open| {
            open.object == Some(object) && open.direction == Some(direction) && open.stage == Stage::Initiate
        });
        if answers {
            return None;
        }
        self.has_stray = self.transfer.is_some();
        self.unrequested = self.unrequested.saturating_add(1);
        let mut stray = Transfer::new(index, Some(object), frame);
        stray.saw(Side::Server);
        // The first one may be the response to a request before the capture, or a late one.
        stray.is_unrequested = self.unrequested > 1;
        stray.direction = Some(direction);
        stray.cut_start = true;
        stray.outcome = Outcome::Complete;
        if let Sdo::UploadInitiated { payload: Payload::Expedited { data, .. }, .. } = message {
            stray.mode = Some(Mode::Expedited);
            stray.keep(data);
        }
        Some(Box::new(stray))
    }

    /// Handles a message of the server; `true` if it ends the transfer.
    fn server(&mut self, index: u16, message: Sdo<'_>, frame: &Frame) -> bool {
        match message {
            Sdo::DownloadInitiated { .. } => {
                let Some(transfer) = &mut self.transfer else { return false };
                transfer.stage = Stage::Segments;
                return transfer.mode == Some(Mode::Expedited);
            }
            Sdo::UploadInitiated { object, payload } => {
                return self.upload_initiated(index, object, payload, frame);
            }
            Sdo::DownloadSegmentAccepted { toggle } => {
                let transfer = self.open_or_cut(index, Direction::Download, Mode::Segmented, frame);
                transfer.confirms_segment(toggle, frame.number);
                return transfer.last_seen;
            }
            Sdo::UploadSegment(segment) => {
                let transfer = self.open_or_cut(index, Direction::Upload, Mode::Segmented, frame);
                transfer.answers_with_segment(&segment, frame.number);
                return transfer.last_seen;
            }
            Sdo::BlockDownloadInitiated { object, crc, block_size } => {
                let transfer = self.open_or_cut(index, Direction::Download, Mode::Block, frame);
                transfer.object.get_or_insert(object);
                transfer.stage = Stage::BlockSegments;
                transfer.blocks_mut().server_offers(crc);
                transfer.block_size(block_size, Side::Server, frame.number);
            }
            Sdo::BlockDownloadAcknowledged { sequence, block_size } => {
                let transfer = self.open_or_cut(index, Direction::Download, Mode::Block, frame);
                transfer.sequence(sequence, Side::Server, frame.number);
                transfer.acknowledge(sequence, frame.number);
                transfer.block_size(block_size, Side::Server, frame.number);
            }
            Sdo::BlockDownloadEnded => {
                self.open_or_cut(index, Direction::Download, Mode::Block, frame);
                return true;
            }
            Sdo::BlockUploadInitiated { object, crc, size } => {
                let transfer = self.open_or_cut(index, Direction::Upload, Mode::Block, frame);
                transfer.object.get_or_insert(object);
                transfer.announced = size;
                transfer.stage = Stage::BlockStart;
                transfer.blocks_mut().server_offers(crc);
            }
            Sdo::EndBlockUpload(end) => {
                self.open_or_cut(index, Direction::Upload, Mode::Block, frame)
                    .end_blocks(end.unused, end.crc);
            }
            Sdo::BlockSegment { sequence, last, data } => {
                self.segment(sequence, last, data, Side::Server, frame);
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
        payload: Payload<'_>,
        frame: &Frame,
    ) -> bool {
        let transfer = self.open_or_cut(index, Direction::Upload, Mode::Segmented, frame);
        transfer.object.get_or_insert(object);
        transfer.blocks = None;
        match payload {
            Payload::Expedited { data, .. } => {
                transfer.mode = Some(Mode::Expedited);
                transfer.irregularity = None;
                transfer.keep(data);
                true
            }
            Payload::Segmented { size } => {
                transfer.mode = Some(Mode::Segmented);
                transfer.announced = size;
                transfer.stage = Stage::Segments;
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
