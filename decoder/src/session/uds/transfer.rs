//! State of one ISO-TP message.

use crate::event::{FrameRange, MessageOutcome};
use crate::frame::{CanId, Frame};
use crate::session::limits::TRANSFER_DATA_LIMIT;
use crate::wire::isotp::{FlowControl, FlowStatus};

/// Irregularity of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum IsoTpIrregularity {
    /// The sequence number is higher than expected: frames are missing.
    SequenceGap { expected: u8, found: u8 },
    /// The sequence number repeats that of the previous frame.
    Duplicate { found: u8 },
    /// Consecutive frame without a first frame.
    StartNotSeen,
    /// Consecutive frame without flow control, although the receiver sends other frames on this bus.
    MissingFlowControl,
    /// Flow control without a message that waits for it.
    StrayFlowControl,
}

/// Frame that the message waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum AwaitedFrame {
    /// Flow control, after the first frame or after a block.
    FlowControl,
    /// This many consecutive frames; `None` for all remaining frames.
    Frames(Option<u8>),
}

/// State of one message.
#[derive(Debug, Clone)]
pub(super) struct MessageTransfer {
    pub(super) id: CanId,
    pub(super) flow_control: Option<CanId>,
    pub(super) address_byte: Option<u8>,
    pub(super) frames: FrameRange,
    pub(super) frame_count: u64,
    pub(super) first_time: Option<i64>,
    pub(super) last_time: Option<i64>,
    pub(super) announced: u32,
    /// Bytes transferred, stored or not, including those of missing frames.
    received: u64,
    /// Bytes of missing frames.
    missing: u64,
    pub(super) data: Vec<u8>,
    /// The data is incomplete; later data is not stored.
    pub(super) truncated: bool,
    pub(super) is_single: bool,
    pub(super) waits: u32,
    /// Expected sequence number of the next frame.
    next: u8,
    waiting: AwaitedFrame,
    /// At least one consecutive frame was received.
    has_gone_on: bool,
    /// Missing flow control was already reported.
    stated: bool,
    pub(super) outcome: MessageOutcome,
}

impl MessageTransfer {
    /// Creates a message of `announced` bytes that starts with `data`.
    pub(super) fn new(frame: &Frame, address_byte: Option<u8>, announced: u32, data: &[u8]) -> Self {
        let time = frame.time.map(|time| time.0);
        let mut transfer = Self {
            id: frame.id,
            flow_control: None,
            address_byte,
            frames: FrameRange::one(frame.number),
            frame_count: 1,
            first_time: time,
            last_time: time,
            announced,
            received: 0,
            missing: 0,
            data: Vec::new(),
            truncated: false,
            is_single: false,
            waits: 0,
            next: 1,
            waiting: AwaitedFrame::FlowControl,
            has_gone_on: false,
            stated: false,
            outcome: MessageOutcome::Unfinished,
        };
        transfer.keep_data(data);
        transfer
    }

    /// Creates a message of a single frame.
    pub(super) fn from_single_frame(frame: &Frame, address_byte: Option<u8>, data: &[u8]) -> Self {
        let announced = u32::try_from(data.len()).unwrap_or(u32::MAX);
        let mut transfer = Self::new(frame, address_byte, announced, data);
        transfer.is_single = true;
        transfer.outcome = MessageOutcome::Complete;
        transfer
    }

    /// Adds a frame to the message.
    fn add_frame(&mut self, frame: &Frame) {
        self.frames.last = frame.number;
        self.frame_count += 1;
        self.last_time = frame.time.map(|time| time.0).or(self.last_time);
    }

    /// Appends data; bytes over the limit are only counted. Padding of the last frame is removed.
    fn keep_data(&mut self, bytes: &[u8]) {
        let left = u64::from(self.announced).saturating_sub(self.received);
        let bytes = bytes.get(..usize::try_from(left).unwrap_or(usize::MAX)).unwrap_or(bytes);
        self.received += bytes.len() as u64;
        let limit = if self.truncated { 0 } else { TRANSFER_DATA_LIMIT };
        let kept = bytes.get(..limit.saturating_sub(self.data.len())).unwrap_or(bytes);
        self.truncated |= kept.len() < bytes.len();
        self.data.extend_from_slice(kept);
    }

    /// Applies a consecutive frame; returns its irregularities. `has_receiver`: frames of the receiver
    /// are in the capture, so its flow control would be, too.
    pub(super) fn apply_consecutive(
        &mut self,
        sequence: u8,
        data: &[u8],
        frame: &Frame,
        has_receiver: bool,
    ) -> [Option<IsoTpIrregularity>; 2] {
        self.add_frame(frame);
        if sequence == self.next.wrapping_sub(1) & 0x0F && self.has_gone_on {
            return [None, Some(IsoTpIrregularity::Duplicate { found: sequence })];
        }
        let unasked = self.waiting == AwaitedFrame::FlowControl && has_receiver && !self.stated;
        self.stated |= unasked;
        let lost = sequence.wrapping_sub(self.next) & 0x0F;
        let gap =
            (lost > 0).then_some(IsoTpIrregularity::SequenceGap { expected: self.next, found: sequence });
        if lost > 0 {
            // Only the number of lost frames modulo 16 is known; later data cannot be placed.
            self.truncated = true;
            let bytes = u64::from(lost) * data.len() as u64;
            let left = u64::from(self.announced).saturating_sub(self.received);
            self.received += bytes.min(left);
            self.missing += bytes.min(left);
        }
        self.keep_data(data);
        self.next = sequence.wrapping_add(1) & 0x0F;
        self.has_gone_on = true;
        self.waiting = match self.waiting {
            AwaitedFrame::Frames(Some(left)) if left <= 1 + lost => AwaitedFrame::FlowControl,
            AwaitedFrame::Frames(Some(left)) => AwaitedFrame::Frames(Some(left - 1 - lost)),
            _ if unasked => AwaitedFrame::Frames(None),
            waiting => waiting,
        };
        [unasked.then_some(IsoTpIrregularity::MissingFlowControl), gap]
    }

    /// Applies flow control of the receiver; returns its irregularity.
    pub(super) fn flow_control(&mut self, control: FlowControl, frame: &Frame) -> Option<IsoTpIrregularity> {
        self.add_frame(frame);
        self.flow_control = Some(frame.id);
        if self.waiting != AwaitedFrame::FlowControl {
            return Some(IsoTpIrregularity::StrayFlowControl);
        }
        match control.status {
            FlowStatus::Continue => {
                self.waiting = AwaitedFrame::Frames(Some(control.block_size).filter(|size| *size != 0));
            }
            FlowStatus::Wait => self.waits = self.waits.saturating_add(1),
            FlowStatus::Overflow => self.outcome = MessageOutcome::Overflow,
        }
        None
    }

    /// Whether all bytes were transferred, including those of missing frames.
    pub(super) fn is_over(&self) -> bool {
        self.received >= u64::from(self.announced)
    }

    /// Ends a message with all its bytes.
    pub(super) fn complete_message(&mut self) {
        self.outcome = if self.missing == 0 { MessageOutcome::Complete } else { MessageOutcome::Incomplete };
    }

    /// Ends a message after a timeout.
    pub(super) fn time_out(&mut self) {
        self.outcome = match self.waiting {
            AwaitedFrame::FlowControl => MessageOutcome::NoFlowControl,
            AwaitedFrame::Frames(_) => MessageOutcome::Timeout,
        };
    }

    /// Bytes received.
    pub(super) fn received_size(&self) -> u64 {
        self.received.saturating_sub(self.missing)
    }

    /// Drops the data; later data is only counted.
    pub(super) fn give_up_data(&mut self) {
        self.data = Vec::new();
        self.truncated = true;
    }

    /// Time from the first to the last frame, in ns.
    pub(super) fn duration(&self) -> Option<i64> {
        Some(self.last_time?.saturating_sub(self.first_time?))
    }

    /// Bytes held by the message.
    pub(super) fn footprint(&self) -> usize {
        size_of::<Self>() + self.data.capacity()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(number: u64) -> Frame {
        let mut frame = Frame::data_frame(CanId::from_standard(0x7E8), &[]);
        frame.number = number;
        frame
    }

    const GO_ON: FlowControl =
        FlowControl { status: FlowStatus::Continue, block_size: 0, separation_time: 0 };

    fn begun(announced: u32) -> MessageTransfer {
        MessageTransfer::new(&frame(1), None, announced, &[1, 2, 3, 4, 5, 6])
    }

    #[test]
    fn the_padding_of_the_last_frame_is_left_out() {
        let mut transfer = begun(9);
        assert_eq!(transfer.flow_control(GO_ON, &frame(2)), None);
        assert_eq!(
            transfer.apply_consecutive(1, &[7, 8, 9, 0xAA, 0xAA, 0xAA, 0xAA], &frame(3), true),
            [None; 2]
        );
        assert!(transfer.is_over());
        transfer.complete_message();
        assert_eq!(transfer.outcome, MessageOutcome::Complete);
        assert_eq!(transfer.data, [1, 2, 3, 4, 5, 6, 7, 8, 9]);
    }

    #[test]
    fn a_gap_ends_the_data_but_not_the_message() {
        let mut transfer = begun(27);
        transfer.flow_control(GO_ON, &frame(2));
        let gap = transfer.apply_consecutive(2, &[0; 7], &frame(3), true)[1];
        assert_eq!(gap, Some(IsoTpIrregularity::SequenceGap { expected: 1, found: 2 }));
        assert_eq!(transfer.apply_consecutive(3, &[0; 7], &frame(4), true), [None; 2]);
        assert!(transfer.is_over());
        transfer.complete_message();
        // Nothing precedes the first frame: 0 is a gap of fifteen.
        let mut early = begun(200);
        early.flow_control(GO_ON, &frame(2));
        let gap = early.apply_consecutive(0, &[0; 7], &frame(3), true)[1];
        assert_eq!(gap, Some(IsoTpIrregularity::SequenceGap { expected: 1, found: 0 }));
        // 6 bytes of the first frame, 7 missing, twice 7 received.
        assert_eq!((transfer.outcome, transfer.received_size()), (MessageOutcome::Incomplete, 20));
        assert_eq!((transfer.data.len(), transfer.truncated), (6, true));
    }

    #[test]
    fn a_frame_sent_twice_counts_once() {
        let mut transfer = begun(20);
        transfer.flow_control(GO_ON, &frame(2));
        assert_eq!(transfer.apply_consecutive(1, &[7; 7], &frame(3), true), [None; 2]);
        let again = transfer.apply_consecutive(1, &[7; 7], &frame(4), true)[1];
        assert_eq!(again, Some(IsoTpIrregularity::Duplicate { found: 1 }));
        assert_eq!(transfer.data.len(), 13);
        // After 15 the sequence number continues with 0.
        transfer.next = 0;
        assert_eq!(transfer.apply_consecutive(0, &[7; 7], &frame(5), true), [None; 2]);
        assert_eq!(transfer.next, 1);
    }

    #[test]
    fn a_block_waits_for_flow_control() {
        let mut transfer = begun(40);
        transfer.flow_control(FlowControl { block_size: 2, ..GO_ON }, &frame(2));
        transfer.apply_consecutive(1, &[0; 7], &frame(3), true);
        assert_eq!(transfer.flow_control(GO_ON, &frame(4)), Some(IsoTpIrregularity::StrayFlowControl));
        transfer.apply_consecutive(2, &[0; 7], &frame(5), true);
        let unasked = transfer.apply_consecutive(3, &[0; 7], &frame(6), true);
        assert_eq!(unasked, [Some(IsoTpIrregularity::MissingFlowControl), None]);
        assert_eq!(transfer.apply_consecutive(4, &[0; 7], &frame(7), true), [None; 2]);
    }

    #[test]
    fn who_is_silent_decides_how_it_times_out() {
        let mut transfer = begun(40);
        transfer.time_out();
        assert_eq!(transfer.outcome, MessageOutcome::NoFlowControl);
        let wait = FlowControl { status: FlowStatus::Wait, ..GO_ON };
        assert_eq!(transfer.flow_control(wait, &frame(2)), None);
        assert_eq!(transfer.waits, 1);
        transfer.flow_control(GO_ON, &frame(3));
        transfer.time_out();
        assert_eq!(transfer.outcome, MessageOutcome::Timeout);
    }

    #[test]
    fn what_is_announced_costs_nothing() {
        let transfer = begun(u32::MAX);
        assert!(transfer.footprint() < 1024);
        assert_eq!(transfer.received_size(), 6);
    }
}
