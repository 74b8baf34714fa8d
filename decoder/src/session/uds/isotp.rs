//! ISO-TP: combines frames to messages.

use super::reassembly::{Due, Reassembly, ReassemblyStep};
use super::transfer::{IsoTpIrregularity, Transfer};
use crate::event::{
    EventKind, EvictedState, FrameRange, Irregularity, IrregularityKind, IsoTpTransfer, MessageOutcome,
};
use crate::frame::Frame;
use crate::profile;
use crate::session::bus::{Bus, Link};
use crate::session::context::Context;
use crate::session::limits::OPEN_DATA_LIMIT;
use crate::session::machine::{Machine, Timed};
use crate::session::options::ProtocolChoice;
use crate::session::timers::Subject;
use crate::wire::Malformed;
use crate::wire::isotp::{self, IsoTp as Message};

/// Timeout in ns of a sender for flow control, and of a receiver for the next frame (N_Bs, N_Cr:
/// ISO 15765-2 §9.8).
const FRAME_TIME: i64 = 1_000_000_000;

/// A message that ended, with all its frames or with missing ones.
pub(in crate::session) struct CompleteMessage {
    /// Link of the message.
    pub(super) link: Link,
    pub(super) transfer: Box<Transfer>,
}

/// ISO-TP messages of a bus.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct IsoTp {
    reassembly: Reassembly,
}

impl Machine for IsoTp {
    type Route<'a> = Link;
    /// Message completed by the frame.
    type Product = Option<CompleteMessage>;

    fn on_frame(&mut self, link: Link, frame: &Frame, cx: &mut Context<'_>) -> Self::Product {
        if cx.bus.protocol == ProtocolChoice::None {
            cx.emit_undecoded(frame, None);
            return None;
        }
        let (address_byte, data) = match frame.data() {
            [address, rest @ ..] if cx.bus.uds_pairs.has_address_byte(link) => (Some(*address), rest),
            data => (None, data),
        };
        let message = self.parse(link, data, frame, cx)?;
        let taken = self.reassembly.take(link, &message, address_byte, frame);
        // Flow control has the opposite direction of its message.
        let of = if matches!(message, Message::FlowControl(_)) { link.back() } else { link };
        let whole = emit_results(link, of, taken, frame, cx);
        self.keep_within_limits(of, frame, cx);
        if cx.bus.clock.runs() {
            let deadline = cx.bus.clock.now().saturating_add(FRAME_TIME);
            if self.reassembly.arm(of, deadline) {
                cx.timers.add(deadline, Subject::IsoTp(of));
            }
        }
        whole
    }

    fn on_silence(&mut self, delay: i64, _: &mut Bus) {
        self.reassembly.postpone(delay);
    }

    /// Ends open messages as unfinished.
    fn on_end(&mut self, cx: &mut Context<'_>) {
        let frame = cx.last_frame();
        for (link, transfer) in self.reassembly.drain() {
            emit_message(link, &transfer, &frame, cx);
        }
    }

    fn footprint(&self) -> usize {
        self.reassembly.footprint()
    }
}

impl Timed for IsoTp {
    type Deadline = Link;

    fn on_deadline(&mut self, link: Link, now: i64, cx: &mut Context<'_>) -> Self::Product {
        match self.reassembly.due(link, now) {
            Due::Nothing => {}
            Due::Later(deadline) => cx.timers.add(deadline, Subject::IsoTp(link)),
            Due::Over(transfer, deadline) => {
                cx.open_data.isotp = self.reassembly.open_bytes();
                let mut frame = Frame { number: transfer.frames.last, ..Frame::EMPTY };
                frame.time = cx.bus.clock.stamp_of(deadline);
                emit_message(link, &transfer, &frame, cx);
            }
        }
        None
    }
}

impl IsoTp {
    /// Whether a response to requests of a link has started and is not complete.
    pub(in crate::session) fn is_answering(&self, link: Link) -> bool {
        !link.is_functional() && self.reassembly.is_open(link.back())
    }

    /// Message of a frame; a malformed one is reported.
    fn parse<'f>(
        &mut self,
        link: Link,
        data: &'f [u8],
        frame: &Frame,
        cx: &mut Context<'_>,
    ) -> Option<Message<'f>> {
        let message = isotp::parse(data, frame.data().len());
        if link.needs_evidence() && !self.reassembly.is_confirmed(link) {
            match &message {
                Ok(Message::Single { data } | Message::First { data, .. }) if is_service(data) => {
                    self.reassembly.confirm(link);
                }
                _ => {
                    cx.emit_undecoded(frame, None);
                    return None;
                }
            }
        }
        match message {
            Ok(Message::Unknown { .. }) => {
                let error = Malformed { layer: "isotp", offset: 0, needed: 0, available: frame.length };
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
    fn keep_within_limits(&mut self, link: Link, frame: &Frame, cx: &mut Context<'_>) {
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
    link: Link,
    of: Link,
    taken: ReassemblyStep,
    frame: &Frame,
    cx: &mut Context<'_>,
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

fn emit_irregularity(link: Link, what: IsoTpIrregularity, frame: &Frame, cx: &mut Context<'_>) {
    let ends = cx.bus.uds_pairs.ends(link);
    let address = |address: Option<u16>| address.and_then(|address| u8::try_from(address).ok());
    let kind = EventKind::TransportIrregularity(Box::new(Irregularity {
        source: address(ends.source),
        destination: address(ends.target),
        ..irregularity(what)
    }));
    let event = cx.uds_event(frame, FrameRange::one(frame.number), None, kind);
    cx.send(&event);
}

/// Emits a message; `frame` is the last one of the message.
fn emit_message(link: Link, transfer: &Transfer, frame: &Frame, cx: &mut Context<'_>) {
    let message = IsoTpTransfer {
        ends: cx.bus.uds_pairs.ends(link),
        id: transfer.id,
        flow_control: transfer.flow_control,
        address_byte: transfer.address_byte,
        announced: transfer.announced,
        size: transfer.size(),
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
    cx.send(&event);
}

/// Irregularity of a frame, for an event.
fn irregularity(what: IsoTpIrregularity) -> Irregularity {
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
    Irregularity {
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

/// Whether a message starts with a defined service identifier.
fn is_service(data: &[u8]) -> bool {
    const NEGATIVE: u8 = 0x7F;
    let known =
        |service: u8| profile::uds().service(service & !0x40).is_some_and(|service| !service.is_obd());
    match data {
        [NEGATIVE, service, ..] | [service, ..] => known(*service),
        [] => false,
    }
}
