//! ISO-TP: combines frames to messages.

use super::reassembly::{LinkTimeout, MessageReassembly, ReassemblyStep};
use super::transfer::{IsoTpIrregularity, MessageTransfer};
use crate::event::{
    EventKind, EvictedState, FrameRange, IrregularityKind, IsoTpTransfer, MessageOutcome,
    TransferIrregularity,
};
use crate::frame::Frame;
use crate::session::bus::{Bus, UdsLink};
use crate::session::context::MachineContext;
use crate::session::limits::OPEN_DATA_LIMIT;
use crate::session::machine::{ProtocolMachine, TimedMachine};
use crate::session::options::ProtocolChoice;
use crate::session::timers::DeadlineSubject;
use crate::wire::MalformedPayload;
use crate::wire::isotp::{self, IsoTpFrame as Message};

/// Timeout in ns of a sender for flow control, and of a receiver for the next frame (N_Bs, N_Cr:
/// ISO 15765-2 §9.8).
const FRAME_TIME: i64 = 1_000_000_000;

/// A message that ended, with all its frames or with missing ones.
pub(in crate::session) struct CompleteMessage {
    /// Link of the message.
    pub(super) link: UdsLink,
    pub(super) transfer: Box<MessageTransfer>,
}

/// ISO-TP messages of a bus.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct IsoTpMachine {
    reassembly: MessageReassembly,
}

impl ProtocolMachine for IsoTpMachine {
    type Route<'a> = UdsLink;
    /// Message completed by the frame.
    type Product = Option<CompleteMessage>;

    fn on_frame(&mut self, link: UdsLink, frame: &Frame, cx: &mut MachineContext<'_>) -> Self::Product {
        if cx.bus.protocols.choice == ProtocolChoice::None {
            cx.emit_undecoded(frame, None);
            return None;
        }
        let (address_byte, data) = match frame.data() {
            [address, rest @ ..] if cx.bus.uds_pairs.has_address_byte(link) => (Some(*address), rest),
            data => (None, data),
        };
        let message = Self::parse_frame(data, frame, cx)?;
        let taken = self.reassembly.take_frame(link, &message, address_byte, frame);
        // Flow control has the opposite direction of its message.
        let of = if matches!(message, Message::FlowControl(_)) { link.opposite_link() } else { link };
        let whole = emit_results(link, of, taken, frame, cx);
        self.keep_within_limits(of, frame, cx);
        if cx.bus.clock.has_timestamps() {
            let deadline = cx.bus.clock.now().saturating_add(FRAME_TIME);
            if self.reassembly.set_deadline(of, deadline) {
                cx.timers.add_deadline(deadline, DeadlineSubject::IsoTp(of));
            }
        }
        whole
    }

    fn on_silence(&mut self, delay: i64, _: &mut Bus) {
        self.reassembly.postpone_deadlines(delay);
    }

    /// Ends open messages as unfinished.
    fn on_end(&mut self, cx: &mut MachineContext<'_>) {
        let frame = cx.last_frame();
        for (link, transfer) in self.reassembly.drain_messages() {
            emit_message(link, &transfer, &frame, cx);
        }
    }

    fn memory_size(&self) -> usize {
        self.reassembly.footprint()
    }
}

impl TimedMachine for IsoTpMachine {
    type Deadline = UdsLink;

    fn on_deadline(&mut self, link: UdsLink, now: i64, cx: &mut MachineContext<'_>) -> Self::Product {
        match self.reassembly.evaluate_timer(link, now) {
            LinkTimeout::Nothing => {}
            LinkTimeout::Later(deadline) => cx.timers.add_deadline(deadline, DeadlineSubject::IsoTp(link)),
            LinkTimeout::Over(transfer, deadline) => {
                cx.open_data.isotp = self.reassembly.open_bytes();
                let mut frame = Frame { number: transfer.frames.last, ..Frame::EMPTY };
                frame.time = cx.bus.clock.stamp_of(deadline);
                emit_message(link, &transfer, &frame, cx);
            }
        }
        None
    }
}

impl IsoTpMachine {
    /// Whether a response to requests of a link has started and is not complete.
    pub(in crate::session) fn is_answering(&self, link: UdsLink) -> bool {
        !link.is_functional() && self.reassembly.is_open(link.opposite_link())
    }

    /// Message of a frame; a malformed one is reported.
    fn parse_frame<'f>(data: &'f [u8], frame: &Frame, cx: &mut MachineContext<'_>) -> Option<Message<'f>> {
        let message = isotp::parse(data, frame.data().len());
        match message {
            Ok(Message::Unknown { .. }) => {
                let error =
                    MalformedPayload { layer: "isotp", offset: 0, needed: 0, available: frame.length };
                cx.emit_malformed_uds(frame, error, "undefined ISO-TP control byte or size");
                None
            }
            Ok(message) => Some(message),
            Err(error) => {
                cx.emit_malformed_uds(frame, error, "too short for ISO-TP");
                None
            }
        }
    }

    /// Drops data over the limit, and reports evicted data and messages.
    fn keep_within_limits(&mut self, link: UdsLink, frame: &Frame, cx: &mut MachineContext<'_>) {
        let held = self.reassembly.open_bytes() + cx.open_data.uds + cx.open_data.sdo;
        if held > OPEN_DATA_LIMIT && self.reassembly.give_up_data(link) {
            cx.emit_can(frame, EventKind::Evicted { what: EvictedState::IsoTpData, count: 1 });
        }
        cx.open_data.isotp = self.reassembly.open_bytes();
        if self.reassembly.take_refused() {
            cx.emit_can(frame, EventKind::Evicted { what: EvictedState::IsoTpMessage, count: 1 });
        }
    }
}

/// Emits the results of a frame of `link`; it belongs to a message of the link `of`.
fn emit_results(
    link: UdsLink,
    of: UdsLink,
    taken: ReassemblyStep,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) -> Option<CompleteMessage> {
    for what in taken.odd.into_iter().flatten() {
        emit_irregularity(link, what, frame, cx);
    }
    if taken.is_stray {
        cx.emit_undecoded(frame, None);
    }
    if let Some(superseded) = taken.superseded {
        emit_message(of, &superseded, frame, cx);
    }
    let ended = taken.ended?;
    emit_message(of, &ended, frame, cx);
    let is_whole = matches!(ended.outcome, MessageOutcome::Complete | MessageOutcome::Incomplete);
    is_whole.then_some(CompleteMessage { link: of, transfer: ended })
}

fn emit_irregularity(link: UdsLink, what: IsoTpIrregularity, frame: &Frame, cx: &mut MachineContext<'_>) {
    let ends = cx.bus.uds_pairs.link_endpoints(link);
    let address = |address: Option<u16>| address.and_then(|address| u8::try_from(address).ok());
    let kind = EventKind::TransportIrregularity(Box::new(TransferIrregularity {
        source: address(ends.source),
        destination: address(ends.target),
        ..to_irregularity(what)
    }));
    let event = cx.uds_event(frame, FrameRange::one(frame.number), None, kind);
    cx.send_event(&event);
}

/// Emits a message; `frame` is the last one of the message.
fn emit_message(link: UdsLink, transfer: &MessageTransfer, frame: &Frame, cx: &mut MachineContext<'_>) {
    let message = IsoTpTransfer {
        ends: cx.bus.uds_pairs.link_endpoints(link),
        id: transfer.id,
        flow_control: transfer.flow_control,
        address_byte: transfer.address_byte,
        announced: transfer.announced,
        size: transfer.received_size(),
        data: transfer.data.clone(),
        truncated: transfer.truncated,
        is_single: transfer.is_single,
        waits: transfer.waits,
        frame_count: transfer.frame_count,
        duration: transfer.duration(),
        outcome: transfer.outcome,
    };
    let kind = EventKind::IsoTpTransfer(Box::new(message));
    let mut event = cx.uds_event(frame, transfer.frames, None, kind);
    event.routine = transfer.outcome == MessageOutcome::Complete;
    cx.send_event(&event);
}

/// Irregularity of a frame, for an event.
fn to_irregularity(what: IsoTpIrregularity) -> TransferIrregularity {
    let (what, message, packet, expected) = match what {
        IsoTpIrregularity::SequenceGap { expected, found } => {
            (IrregularityKind::Gap, "consecutive frame", Some(found), Some(expected))
        }
        IsoTpIrregularity::Duplicate { found } => {
            (IrregularityKind::Duplicate, "consecutive frame", Some(found), None)
        }
        IsoTpIrregularity::StartNotSeen => {
            (IrregularityKind::Unexpected, "consecutive frame without a first one", None, None)
        }
        IsoTpIrregularity::MissingFlowControl => {
            (IrregularityKind::Unexpected, "consecutive frame without flow control", None, None)
        }
        IsoTpIrregularity::StrayFlowControl => (IrregularityKind::Unexpected, "flow control", None, None),
    };
    TransferIrregularity {
        what,
        message,
        pgn: None,
        source: None,
        destination: None,
        packet: packet.map(u32::from),
        expected: expected.map(u32::from),
        timer: None,
        delay: None,
    }
}
