//! One SDO channel: a pair of identifiers, and the one transfer that can be open on it.

use super::transfer::{Stage, Transfer};
use crate::event::{Abort, Direction, Mode, Outcome, SdoIrregularityKind};
use crate::frame::Frame;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::{Payload, Sdo, Side};

/// Abort code: toggle bit not alternated (CiA 301 §7.2.4.3.17).
const TOGGLE_NOT_ALTERNATED: u32 = 0x0503_0000;

/// The open transfer of a channel.
#[derive(Debug, Clone, Default)]
pub(super) struct Channel {
    pub(super) transfer: Option<Box<Transfer>>,
    pub(super) deadline: Option<i64>,
    pub(super) queued: bool,
}

/// Transfers that one frame ended: the one it superseded, and its own.
pub(super) type Finished = [Option<Box<Transfer>>; 2];

impl Channel {
    /// Bytes of the value its open transfer holds.
    pub(super) fn open_bytes(&self) -> usize {
        self.transfer.as_ref().map_or(0, |transfer| transfer.data.len())
    }

    /// Takes a message; gives the transfers it ended.
    pub(super) fn take(
        &mut self,
        index: u16,
        side: Side,
        message: Sdo<'_>,
        command: u8,
        frame: &Frame,
    ) -> Finished {
        if let Some(finished) = self.block_start_not_seen(index, side, command, frame) {
            return finished;
        }
        if let Sdo::Abort { object, code } = message {
            return [None, Some(self.abort(index, side, object, code, frame))];
        }
        if side == Side::Server
            && let Some(stray) = self.stray_answer(index, &message, frame)
        {
            return [None, Some(stray)];
        }
        let superseded = self.superseded_by(&message);
        if let Some(transfer) = &mut self.transfer {
            transfer.add_frame(frame);
        }
        let is_over = match side {
            Side::Client => self.client(index, message, frame),
            Side::Server => self.server(index, message, frame),
        };
        if let Some(transfer) = &mut self.transfer {
            transfer.saw(side);
        }
        if let Some(transfer) = &mut self.transfer
            && transfer.frame_count == 1
        {
            transfer.opened_by = (command, side == Side::Client);
        }
        let own = if is_over { self.transfer.take() } else { None };
        [
            superseded,
            own.map(|mut transfer| {
                transfer.outcome = Outcome::Complete;
                transfer
            }),
        ]
    }

    /// A capture that begins within a block shows bytes that read as commands. Two frames of one side in
    /// a row whose first bytes count up are segments: SDO commands never follow each other unanswered.
    fn block_start_not_seen(
        &mut self,
        index: u16,
        side: Side,
        command: u8,
        frame: &Frame,
    ) -> Option<Finished> {
        let transfer = self.transfer.as_mut()?;
        let (before, by_client) = transfer.opened_by;
        let counts_up = command & 0x7F == (before & 0x7F).wrapping_add(1) && before < 0x80;
        let is_sender = by_client == (side == Side::Client);
        if transfer.frame_count != 1 || !is_sender || !counts_up || transfer.stage == Stage::BlockSegments {
            return None;
        }
        let mut cut = Transfer::new(index, None, frame);
        cut.frames.first = transfer.frames.first;
        cut.frame_count = 2;
        cut.cut_start = true;
        cut.truncated = true;
        cut.mode = Some(Mode::Block);
        cut.direction = Some(if by_client { Direction::Download } else { Direction::Upload });
        cut.stage = Stage::BlockSegments;
        cut.saw(side);
        let data = frame.data().get(1..).unwrap_or_default();
        cut.blocks_mut().segment(command & 0x7F, command & 0x80 != 0, data);
        self.transfer = Some(Box::new(cut));
        Some([None, None])
    }

    fn abort(
        &mut self,
        index: u16,
        side: Side,
        object: ObjectAddress,
        code: u32,
        frame: &Frame,
    ) -> Box<Transfer> {
        let mut transfer =
            self.transfer.take().unwrap_or_else(|| Box::new(Transfer::new(index, Some(object), frame)));
        transfer.add_frame(frame);
        transfer.object.get_or_insert(object);
        if code == TOGGLE_NOT_ALTERNATED {
            // What looked like the same segment again was none, for the other side at least.
            let other = if side == Side::Client { Side::Server } else { Side::Client };
            transfer.irregular(SdoIrregularityKind::Toggle, other, frame.number);
        }
        transfer.end(Outcome::Aborted);
        transfer.abort = Some(Abort { code, by_client: side == Side::Client });
        transfer
    }

    /// The open transfer if this message ends it by being no part of it: the client begins anew, or the
    /// message runs the other way or names another object, so what came between was not seen.
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
        Some(transfer)
    }

    /// The open transfer, else one whose beginning was not seen.
    fn open_or_cut(&mut self, index: u16, direction: Direction, mode: Mode, frame: &Frame) -> &mut Transfer {
        let transfer = self.transfer.get_or_insert_with(|| {
            let mut cut = Transfer::new(index, None, frame);
            cut.direction = Some(direction);
            cut.mode = Some(mode);
            cut.cut_start = true;
            cut.stage = if mode == Mode::Segmented { Stage::Segments } else { Stage::BlockSegments };
            cut.truncated = true;
            Box::new(cut)
        });
        transfer.direction.get_or_insert(direction);
        transfer
    }

    /// Handles a client's message; `true` if it ends the transfer.
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
                transfer.asks_segment(toggle, frame.number);
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
                transfer.acknowledge(sequence);
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
            transfer.blocks_mut().segment(sequence, last, data);
        }
    }

    /// An answer that names another object than the open transfer, or one without any open: its request
    /// was not seen. Expedited answers and confirmations are whole transfers by themselves.
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
        let mut stray = Transfer::new(index, Some(object), frame);
        stray.direction = Some(direction);
        stray.cut_start = true;
        stray.outcome = Outcome::Complete;
        if let Sdo::UploadInitiated { payload: Payload::Expedited { data, .. }, .. } = message {
            stray.mode = Some(Mode::Expedited);
            stray.keep(data);
        }
        Some(Box::new(stray))
    }

    /// Handles a server's message; `true` if it ends the transfer.
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
                transfer.answers_segment(toggle, frame.number);
                return transfer.last_seen;
            }
            Sdo::UploadSegment(segment) => {
                let transfer = self.open_or_cut(index, Direction::Upload, Mode::Segmented, frame);
                transfer.answers_segment(segment.toggle, frame.number);
                transfer.take_segment(&segment);
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
                transfer.acknowledge(sequence);
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

    /// The server's data or the size of what follows; also its choice not to send blocks.
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
