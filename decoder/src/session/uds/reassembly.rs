//! Open ISO-TP messages, by sender and receiver.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use super::transfer::{IsoTpIrregularity, MessageTransfer};
use crate::event::MessageOutcome;
use crate::frame::Frame;
use crate::session::bus::UdsLink;
use crate::session::limits::TRANSPORT_LIMIT;
use crate::wire::isotp::{FlowStatus, IsoTpFrame};

/// State of one link.
#[derive(Debug, Clone, Default)]
struct LinkTransferState {
    /// A frame of the link was received.
    is_active: bool,
    /// Consecutive frames without a first frame were already reported, since the last first frame.
    stated_start: bool,
    /// Flow control without a message was already reported, since the last first frame.
    stated_control: bool,
    transfer: Option<Box<MessageTransfer>>,
    deadline: Option<i64>,
    /// The deadline is in the timer queue.
    queued: bool,
}

/// Result of one frame.
#[derive(Debug, Default)]
pub(super) struct ReassemblyStep {
    /// Open message that was superseded by the start of another one.
    pub(super) superseded: Option<Box<MessageTransfer>>,
    /// Message that the frame ended.
    pub(super) ended: Option<Box<MessageTransfer>>,
    /// Irregularities of the frame.
    pub(super) odd: [Option<IsoTpIrregularity>; 2],
    /// The frame belongs to no open message.
    pub(super) is_stray: bool,
}

/// Result of the timer entry of a link.
pub(super) enum LinkTimeout {
    /// No open message.
    Nothing,
    /// The deadline moved to this time.
    Later(i64),
    /// Message without a further frame until this deadline.
    Over(Box<MessageTransfer>, i64),
}

/// Open messages of a bus. The number of states is bounded by the number of identifiers that have their own
/// state.
#[derive(Debug, Clone, Default)]
pub(super) struct MessageReassembly {
    states: HashMap<UdsLink, LinkTransferState, FixedState>,
    open: usize,
    open_bytes: usize,
    refused: bool,
}

impl MessageReassembly {
    /// Applies a frame of a link.
    pub(super) fn take_frame(
        &mut self,
        link: UdsLink,
        message: &IsoTpFrame<'_>,
        address_byte: Option<u8>,
        frame: &Frame,
    ) -> ReassemblyStep {
        self.states.entry(link).or_default().is_active = true;
        match message {
            IsoTpFrame::Single { data } => {
                let superseded = self.begin_message(link);
                let single = Box::new(MessageTransfer::from_single_frame(frame, address_byte, data));
                ReassemblyStep { superseded, ended: Some(single), ..ReassemblyStep::default() }
            }
            IsoTpFrame::First { size, data } => {
                let superseded = self.begin_message(link);
                self.open_message(link, MessageTransfer::new(frame, address_byte, *size, data));
                ReassemblyStep { superseded, ..ReassemblyStep::default() }
            }
            IsoTpFrame::Consecutive { sequence, data } => self.take_consecutive(link, *sequence, data, frame),
            IsoTpFrame::FlowControl(control) => {
                let sender = self.states.entry(link.opposite_link()).or_default();
                let Some(transfer) = &mut sender.transfer else {
                    let odd = !std::mem::replace(&mut sender.stated_control, true);
                    let odd = [odd.then_some(IsoTpIrregularity::StrayFlowControl), None];
                    return ReassemblyStep { odd, is_stray: true, ..ReassemblyStep::default() };
                };
                let odd = [transfer.flow_control(*control, frame), None];
                let refused = control.status == FlowStatus::Overflow && odd[0].is_none();
                let ended = if refused { self.close_message(link.opposite_link()) } else { None };
                ReassemblyStep { ended, odd, ..ReassemblyStep::default() }
            }
            IsoTpFrame::Unknown { .. } => ReassemblyStep { is_stray: true, ..ReassemblyStep::default() },
        }
    }

    fn take_consecutive(
        &mut self,
        link: UdsLink,
        sequence: u8,
        data: &[u8],
        frame: &Frame,
    ) -> ReassemblyStep {
        let receiver_is_active = self.states.get(&link.opposite_link()).is_some_and(|state| state.is_active);
        let state = self.states.entry(link).or_default();
        let Some(transfer) = &mut state.transfer else {
            let odd = !std::mem::replace(&mut state.stated_start, true);
            let odd = [odd.then_some(IsoTpIrregularity::StartNotSeen), None];
            return ReassemblyStep { odd, is_stray: true, ..ReassemblyStep::default() };
        };
        let before = transfer.data.len();
        let odd = transfer.apply_consecutive(sequence, data, frame, receiver_is_active);
        self.open_bytes += transfer.data.len().saturating_sub(before);
        if !transfer.is_over() {
            return ReassemblyStep { odd, ..ReassemblyStep::default() };
        }
        transfer.complete_message();
        ReassemblyStep { odd, ended: self.close_message(link), ..ReassemblyStep::default() }
    }

    /// Prepares the link for a new message; returns the open one.
    fn begin_message(&mut self, link: UdsLink) -> Option<Box<MessageTransfer>> {
        let state = self.states.entry(link).or_default();
        (state.stated_start, state.stated_control) = (false, false);
        let mut superseded = self.close_message(link)?;
        superseded.outcome = MessageOutcome::Superseded;
        Some(superseded)
    }

    fn open_message(&mut self, link: UdsLink, transfer: MessageTransfer) {
        let state = self.states.entry(link).or_default();
        if self.open >= TRANSPORT_LIMIT {
            self.refused = true;
            // Its consecutive frames must not be reported as frames without a first one.
            state.stated_start = true;
            state.stated_control = true;
            return;
        }
        self.open += 1;
        self.open_bytes += transfer.data.len();
        state.transfer = Some(Box::new(transfer));
    }

    fn close_message(&mut self, link: UdsLink) -> Option<Box<MessageTransfer>> {
        let state = self.states.get_mut(&link)?;
        let transfer = state.transfer.take()?;
        state.deadline = None;
        self.open = self.open.saturating_sub(1);
        self.open_bytes = self.open_bytes.saturating_sub(transfer.data.len());
        Some(transfer)
    }

    /// Whether a message is open.
    pub(super) fn is_open(&self, link: UdsLink) -> bool {
        self.states.get(&link).is_some_and(|state| state.transfer.is_some())
    }

    /// Sets the deadline of an open message; `true` if it must go into the timer queue.
    pub(super) fn set_deadline(&mut self, link: UdsLink, deadline: i64) -> bool {
        let Some(state) = self.states.get_mut(&link).filter(|state| state.transfer.is_some()) else {
            return false;
        };
        state.deadline = Some(deadline);
        !std::mem::replace(&mut state.queued, true)
    }

    /// Evaluates the timer entry of a link that is due.
    pub(super) fn evaluate_timer(&mut self, link: UdsLink, now: i64) -> LinkTimeout {
        let Some(state) = self.states.get_mut(&link) else { return LinkTimeout::Nothing };
        state.queued = false;
        match state.deadline {
            None => LinkTimeout::Nothing,
            Some(deadline) if deadline >= now => {
                state.queued = true;
                LinkTimeout::Later(deadline)
            }
            Some(deadline) => match self.close_message(link) {
                Some(mut transfer) => {
                    transfer.time_out();
                    LinkTimeout::Over(transfer, deadline)
                }
                None => LinkTimeout::Nothing,
            },
        }
    }

    /// Postpones all deadlines by `delay` ns.
    pub(super) fn postpone_deadlines(&mut self, delay: i64) {
        for state in self.states.values_mut() {
            state.deadline = state.deadline.map(|deadline| deadline.saturating_add(delay));
        }
    }

    /// Removes and returns all open messages in the order of their start.
    pub(super) fn drain_messages(&mut self) -> Vec<(UdsLink, Box<MessageTransfer>)> {
        (self.open, self.open_bytes) = (0, 0);
        let open = self.states.iter_mut().filter_map(|(link, state)| Some((*link, state.transfer.take()?)));
        let mut open: Vec<_> = open.collect();
        open.sort_by_key(|(_, transfer)| transfer.frames.first);
        open
    }

    /// Bytes of all open messages.
    pub(super) fn open_bytes(&self) -> usize {
        self.open_bytes
    }

    /// Drops the data of an open message; `true` if there was any.
    pub(super) fn give_up_data(&mut self, link: UdsLink) -> bool {
        let Some(transfer) = self.states.get_mut(&link).and_then(|state| state.transfer.as_mut()) else {
            return false;
        };
        let held = transfer.data.len();
        self.open_bytes = self.open_bytes.saturating_sub(held);
        transfer.give_up_data();
        held > 0
    }

    /// Whether a message was rejected, because the limit is reached, since the last call.
    pub(super) fn take_refused(&mut self) -> bool {
        std::mem::take(&mut self.refused)
    }

    /// Bytes held by the table.
    pub(super) fn footprint(&self) -> usize {
        let open = self.states.values().filter_map(|state| state.transfer.as_ref());
        self.states.capacity() * size_of::<(UdsLink, LinkTransferState)>()
            + open.map(|transfer| transfer.footprint()).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;
    use crate::wire::isotp::parse;

    const THERE: u32 = 0x18DA_20F1;
    const BACK: u32 = 0x18DA_F120;

    fn push(all: &mut MessageReassembly, id: u32, data: &[u8]) -> ReassemblyStep {
        let frame = Frame::data_frame(CanId::from_extended(id), data);
        let link = UdsLink::link_of(frame.id).unwrap();
        all.take_frame(link, &parse(data, data.len()).unwrap(), None, &frame)
    }

    #[test]
    fn messages_of_both_ways_do_not_mix() {
        let mut all = MessageReassembly::default();
        let first = |byte| [0x10, 10, byte, byte, byte, byte, byte, byte];
        let rest = |byte| [0x21, byte, byte, byte, byte, 0, 0, 0];
        push(&mut all, THERE, &first(1));
        push(&mut all, BACK, &first(2));
        push(&mut all, BACK, &[0x30, 0, 0]);
        push(&mut all, THERE, &[0x30, 0, 0]);
        let ended = push(&mut all, THERE, &rest(1)).ended.unwrap();
        assert_eq!((ended.data.clone(), ended.outcome), (vec![1; 10], MessageOutcome::Complete));
        assert_eq!(push(&mut all, BACK, &rest(2)).ended.unwrap().data, vec![2; 10]);
        assert_eq!((all.open, all.open_bytes), (0, 0));
    }

    #[test]
    fn a_beginning_ends_what_was_open() {
        let mut all = MessageReassembly::default();
        push(&mut all, THERE, &[0x10, 10, 1, 1, 1, 1, 1, 1]);
        let taken = push(&mut all, THERE, &[0x02, 0x3E, 0x00]);
        assert_eq!(taken.superseded.unwrap().outcome, MessageOutcome::Superseded);
        assert_eq!(taken.ended.unwrap().data, [0x3E, 0]);
    }

    #[test]
    fn stray_frames_are_reported_once_per_run() {
        let mut all = MessageReassembly::default();
        let stray = |taken: ReassemblyStep| (taken.odd[0], taken.is_stray);
        assert_eq!(stray(push(&mut all, THERE, &[0x22, 1])), (Some(IsoTpIrregularity::StartNotSeen), true));
        assert_eq!(stray(push(&mut all, THERE, &[0x23, 1])), (None, true));
        push(&mut all, THERE, &[0x02, 0x3E, 0x00]);
        assert_eq!(stray(push(&mut all, THERE, &[0x24, 1])), (Some(IsoTpIrregularity::StartNotSeen), true));
        assert_eq!(
            stray(push(&mut all, BACK, &[0x30, 0, 0])),
            (Some(IsoTpIrregularity::StrayFlowControl), true)
        );
        assert_eq!(stray(push(&mut all, BACK, &[0x30, 0, 0])), (None, true));
    }

    #[test]
    fn flow_control_is_missed_only_where_the_receiver_is_active() {
        let mut all = MessageReassembly::default();
        let first = [0x10, 30, 1, 1, 1, 1, 1, 1];
        push(&mut all, THERE, &first);
        assert_eq!(push(&mut all, THERE, &[0x21, 1, 1, 1, 1, 1, 1, 1]).odd, [None; 2]);
        push(&mut all, BACK, &[0x02, 0x3E, 0x00]);
        push(&mut all, THERE, &first);
        let odd = push(&mut all, THERE, &[0x21, 1, 1, 1, 1, 1, 1, 1]).odd;
        assert_eq!(odd, [Some(IsoTpIrregularity::MissingFlowControl), None]);
    }

    #[test]
    fn overflow_and_silence_end_a_message() {
        let mut all = MessageReassembly::default();
        push(&mut all, THERE, &[0x1F, 0xFF, 1, 1, 1, 1, 1, 1]);
        let ended = push(&mut all, BACK, &[0x32, 0, 0]).ended.unwrap();
        assert_eq!(ended.outcome, MessageOutcome::Overflow);
        push(&mut all, THERE, &[0x1F, 0xFF, 1, 1, 1, 1, 1, 1]);
        let link = UdsLink::link_of(CanId::from_extended(THERE)).unwrap();
        assert!(all.set_deadline(link, 10) && !all.set_deadline(link, 20), "one entry in the queue");
        assert!(matches!(all.evaluate_timer(link, 15), LinkTimeout::Later(20)));
        let LinkTimeout::Over(transfer, 20) = all.evaluate_timer(link, 21) else {
            panic!("its time is over")
        };
        assert_eq!(transfer.outcome, MessageOutcome::NoFlowControl);
        assert!(!all.is_open(link));
    }

    #[test]
    fn as_many_are_open_as_the_limit_allows() {
        let mut all = MessageReassembly::default();
        let limit = u32::try_from(TRANSPORT_LIMIT).unwrap();
        for number in 0..=limit {
            assert!(!all.take_refused());
            let id = 0x18DA_0000 | number << 8 & 0xFF00 | if number < 256 { 0xF1 } else { 0xF2 };
            push(&mut all, id, &[0x10, 10, 1, 1, 1, 1, 1, 1]);
        }
        assert!(all.take_refused());
        assert_eq!(all.open, TRANSPORT_LIMIT);
        assert_eq!(all.drain_messages().len(), TRANSPORT_LIMIT);
    }
}
