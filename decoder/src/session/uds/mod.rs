//! ISO-TP and UDS: frames become messages, messages become requests with their answers.
//!
//! ```text
//! Bus::on_isotp ─▶ wire::isotp ─▶ Reassembly, Transfer ─▶ isotp-transfer
//!                                        └─▶ wire::uds ─▶ Exchanges ─▶ uds-exchange
//! ```
//!
//! A [`Link`] is one way between two ends. Frames, not belief in a protocol of the bus, say that it is ISO-TP:
//! UDS stands beside CANopen and J1939.

mod exchange;
mod link;
mod reassembly;
mod talk;
mod transfer;
mod unnamed;

use std::sync::Arc;

use exchange::Exchanges;
pub(in crate::session) use link::{Link, Pairs};
use reassembly::{Due, Reassembly, Taken};
use transfer::{Oddity, Transfer};
pub(in crate::session) use unnamed::Unnamed;

use super::timers::Subject;
use super::{Bus, OPEN_DATA_LIMIT, Observer, ProtocolChoice};
use crate::event::{
    Event, EventKind, FrameRange, Irregularity, IrregularityKind, IsoTpTransfer, MessageOutcome, Protocol,
};
use crate::frame::Frame;
use crate::profile;
use crate::wire::isotp::{self, IsoTp};
use crate::wire::{Malformed, NodeId};

/// Nanoseconds a sender waits for flow control and a receiver for the next frame (N_Bs, N_Cr: ISO 15765-2
/// §9.8).
const FRAME_TIME: i64 = 1_000_000_000;

/// What is known of ISO-TP and UDS on a bus.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct UdsState {
    pairs: Arc<Pairs>,
    reassembly: Reassembly,
    exchanges: Exchanges,
    /// A new node-ID a server accepted: in force from its next boot-up on.
    accepted: Option<(NodeId, NodeId)>,
    /// A request was answered.
    is_spoken: bool,
}

impl UdsState {
    /// What the bus file says.
    pub(in crate::session) fn with(pairs: Pairs) -> Self {
        Self { pairs: Arc::new(pairs), ..Self::default() }
    }

    /// The pairs of the bus file.
    pub(in crate::session) fn pairs(&self) -> &Pairs {
        &self.pairs
    }

    /// Whether a request was answered.
    pub(in crate::session) fn is_spoken(&self) -> bool {
        self.is_spoken
    }

    /// The change of node-ID that was accepted, if it leads to `id`: from where.
    pub(in crate::session) fn take_accepted(&mut self, id: NodeId) -> Option<NodeId> {
        self.accepted.take_if(|(_, to)| *to == id).map(|(from, _)| from)
    }

    /// Moves all deadlines by `delay` nanoseconds.
    pub(in crate::session) fn postpone(&mut self, delay: i64) {
        self.reassembly.postpone(delay);
        self.exchanges.postpone(delay);
    }

    /// Data kept of messages on their way and of requests that wait, in bytes.
    pub(in crate::session) fn open_bytes(&self) -> usize {
        self.reassembly.open_bytes() + self.exchanges.open_bytes()
    }

    /// Bytes held.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.reassembly.footprint() + self.exchanges.footprint()
    }
}

impl Bus {
    /// A frame of ISO-TP.
    pub(in crate::session) fn on_isotp(&mut self, link: Link, frame: &Frame, out: &mut dyn Observer) {
        if self.options.protocol == ProtocolChoice::None {
            return self.undecoded(frame, None, out);
        }
        let (address_byte, data) = match frame.data() {
            [address, rest @ ..] if self.uds.pairs.has_address_byte(link) => (Some(*address), rest),
            data => (None, data),
        };
        let message = isotp::parse(data, frame.data().len());
        if link.needs_evidence() && !self.uds.reassembly.is_believed(link) {
            match &message {
                Ok(IsoTp::Single { data } | IsoTp::First { data, .. }) if is_service(data) => {
                    self.uds.reassembly.believe(link);
                }
                _ => return self.undecoded(frame, None, out),
            }
        }
        let message = match message {
            Ok(IsoTp::Unknown { .. }) => {
                let error = Malformed { layer: "isotp", offset: 0, needed: 0, available: frame.length };
                return self.uds_malformed(frame, error, "undefined ISO-TP control byte or size", out);
            }
            Ok(message) => message,
            Err(error) => return self.uds_malformed(frame, error, "too short for ISO-TP", out),
        };
        let taken = self.uds.reassembly.take(link, &message, address_byte, frame);
        // Flow control goes against the message it belongs to.
        let of = if matches!(message, IsoTp::FlowControl(_)) { link.back() } else { link };
        self.tell_taken(link, of, taken, frame, out);
        self.keep_within_limits(of, frame, out);
        if self.clock.runs() {
            let deadline = self.clock.now().saturating_add(FRAME_TIME);
            if self.uds.reassembly.arm(of, deadline) {
                self.timers.add(deadline, Subject::IsoTp(of));
            }
        }
    }

    /// Tells what a frame of `link` came to; it belongs to a message of the link `of`.
    fn tell_taken(&mut self, link: Link, of: Link, taken: Taken, frame: &Frame, out: &mut dyn Observer) {
        for what in taken.odd.into_iter().flatten() {
            self.odd_frame(link, what, frame, out);
        }
        if taken.is_stray {
            self.undecoded(frame, None, out);
        }
        if let Some(superseded) = taken.superseded {
            self.message_ended(of, &superseded, frame, out);
        }
        if let Some(ended) = taken.ended {
            self.message_ended(of, &ended, frame, out);
            if matches!(ended.outcome, MessageOutcome::Complete | MessageOutcome::Incomplete) {
                self.on_uds(of, ended, frame, out);
            }
        }
    }

    fn odd_frame(&self, link: Link, what: Oddity, frame: &Frame, out: &mut dyn Observer) {
        let ends = self.uds.pairs.ends(link);
        let address = |address: Option<u16>| address.and_then(|address| u8::try_from(address).ok());
        let kind = EventKind::TransportIrregularity(Box::new(Irregularity {
            source: address(ends.source),
            destination: address(ends.target),
            ..irregularity(what)
        }));
        out.event(&self.uds_event(frame, FrameRange::one(frame.number), None, kind), self);
    }

    /// Emits a message; `frame` is the one that ended it.
    fn message_ended(&self, link: Link, transfer: &Transfer, frame: &Frame, out: &mut dyn Observer) {
        let told = IsoTpTransfer {
            ends: self.uds.pairs.ends(link),
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
        let kind = EventKind::IsoTpTransfer(Box::new(told));
        let mut event = self.uds_event(frame, transfer.frames, None, kind);
        event.routine = transfer.outcome == MessageOutcome::Complete;
        out.event(&event, self);
    }

    fn uds_malformed(&self, frame: &Frame, error: Malformed, reason: &'static str, out: &mut dyn Observer) {
        let kind = EventKind::Malformed { error, reason };
        out.event(&self.uds_event(frame, FrameRange::one(frame.number), None, kind), self);
    }

    fn uds_event(&self, frame: &Frame, frames: FrameRange, node: Option<NodeId>, kind: EventKind) -> Event {
        Event {
            time: frame.time,
            bus: self.index,
            frames,
            protocol: Protocol::Uds,
            node,
            presumed: false,
            routine: false,
            kind,
        }
    }

    /// Gives data up that is too much, and says what found no room.
    fn keep_within_limits(&mut self, link: Link, frame: &Frame, out: &mut dyn Observer) {
        let mut tell = |bus: &Self, what| bus.emit_can(frame, EventKind::Evicted { what, count: 1 }, out);
        let held = self.uds.open_bytes() + self.channels.open_bytes();
        if held > OPEN_DATA_LIMIT && self.uds.reassembly.give_up_data(link) {
            tell(self, "data of open ISO-TP messages");
        }
        if self.uds.reassembly.take_refused() {
            tell(self, "open ISO-TP message");
        }
        if self.uds.exchanges.take_refused() {
            tell(self, "waiting UDS request");
        }
    }

    /// The timer entry of a message came due.
    pub(in crate::session) fn isotp_deadline(&mut self, link: Link, now: i64, out: &mut dyn Observer) {
        match self.uds.reassembly.due(link, now) {
            Due::Nothing => {}
            Due::Later(deadline) => self.timers.add(deadline, Subject::IsoTp(link)),
            Due::Over(transfer, deadline) => {
                let mut frame = Frame { number: transfer.frames.last, ..Frame::EMPTY };
                frame.time = self.clock.stamp_of(deadline);
                self.message_ended(link, &transfer, &frame, out);
            }
        }
    }

    /// The capture ends: open messages and requests are unfinished.
    pub(in crate::session) fn finish_uds(&mut self, out: &mut dyn Observer) {
        let frame = Frame { number: self.last_frame, time: self.last_time, ..Frame::EMPTY };
        for (link, transfer) in self.uds.reassembly.drain() {
            self.message_ended(link, &transfer, &frame, out);
        }
        self.finish_exchanges(&frame, out);
    }
}

/// What is wrong with a frame, for an event.
fn irregularity(what: Oddity) -> Irregularity {
    let (what, message, packet, expected) = match what {
        Oddity::SequenceGap { expected, found } => {
            (IrregularityKind::Gap, "consecutive frame", Some(found), Some(expected))
        }
        Oddity::Duplicate { found } => (IrregularityKind::Duplicate, "consecutive frame", Some(found), None),
        Oddity::StartNotSeen => {
            (IrregularityKind::Unexpected, "consecutive frame without a first one", None, None)
        }
        Oddity::MissingFlowControl => {
            (IrregularityKind::Unexpected, "consecutive frame without flow control", None, None)
        }
        Oddity::StrayFlowControl => (IrregularityKind::Unexpected, "flow control", None, None),
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

/// Whether a message begins with a service identifier there is.
fn is_service(data: &[u8]) -> bool {
    const NEGATIVE: u8 = 0x7F;
    let known = |service: u8| profile::uds().service(service & !0x40).is_some();
    match data {
        [NEGATIVE, service, ..] | [service, ..] => known(*service),
        [] => false,
    }
}

#[cfg(test)]
mod tests;
