//! J1939 and ISOBUS: the way of a 29-bit frame that nothing else owns.
//!
//! ```text
//! Frame ─▶ priority, group, source, destination ─▶ request, acknowledgement   told as they are
//!                                               ├▶ address claim              the table of addresses
//!                                               ├▶ TP.CM, TP.DT, ETP.…        transport: one event a transfer
//!                                               └▶ any other group            one prepared event an identifier
//!                                      DM1, DM2, commanded address            of any length: what they say
//! ```

mod belief;
mod cadence;
mod claims;
mod device;
mod dtc;
mod message;
mod transport;

pub(in crate::session) use belief::J1939Belief;
pub(in crate::session) use cadence::Cadence;
pub(in crate::session) use claims::Claims;
pub(in crate::session) use device::J1939State;
pub(in crate::session) use transport::Transports;

use crate::event::{Event, EventKind, FrameRange, J1939Acknowledgement, J1939Request};
use crate::frame::{Frame, FrameFlags};
use crate::session::{Bus, Observer};
use crate::wire::j1939::{ALL, Acknowledgement, J1939Id, NO_ADDRESS, Pgn, request};
use crate::wire::{Malformed, NodeId};

/// Control byte of an acknowledgement that says it was done (J1939-21 §5.4.4).
const DONE: u8 = 0;

impl Bus {
    /// A frame whose identifier is J1939's; `slot` is `None` where too many identifiers are kept apart.
    #[inline]
    pub(in crate::session) fn on_j1939(
        &mut self,
        slot: Option<usize>,
        id: J1939Id,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        if !self.j1939.is_believed() && !self.is_j1939_followed(id, frame, out) {
            return;
        }
        if id.pgn == Pgn::ADDRESS_CLAIMED && id.destination == ALL && id.source <= NO_ADDRESS {
            return self.on_address_claim(id, frame, out);
        }
        self.j1939_heard(id.source, frame);
        match id.pgn {
            Pgn::REQUEST => self.on_j1939_request(id, frame, out),
            Pgn::ACKNOWLEDGEMENT => self.on_acknowledgement(id, frame, out),
            Pgn::DM1 | Pgn::DM2 | Pgn::COMMANDED_ADDRESS => {
                self.on_j1939_message(slot, id, frame, out);
                if !frame.flags.contains(FrameFlags::REMOTE) {
                    self.on_j1939_payload(id, frame.data(), FrameRange::one(frame.number), frame, out);
                }
            }
            Pgn::TP_CM | Pgn::TP_DT | Pgn::ETP_CM | Pgn::ETP_DT => self.on_transport(id, frame, out),
            _ => self.on_j1939_message(slot, id, frame, out),
        }
    }

    /// The whole payload of a group that says something of addresses or faults, however it travelled:
    /// `frames` carried it, `frame` is the last of them.
    pub(in crate::session) fn on_j1939_payload(
        &mut self,
        id: J1939Id,
        payload: &[u8],
        frames: FrameRange,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        match id.pgn {
            Pgn::DM1 | Pgn::DM2 => self.on_trouble_codes(id, payload, frames, frame, out),
            Pgn::COMMANDED_ADDRESS => self.on_commanded_address(id, payload, frames, frame, out),
            _ => {}
        }
    }

    /// Without a sign of J1939 yet: whether the frame is read as such, marked as presumed.
    #[cold]
    fn is_j1939_followed(&mut self, id: J1939Id, frame: &Frame, out: &mut dyn Observer) -> bool {
        let is_plain = !frame.flags.contains(FrameFlags::REMOTE) && !frame.flags.contains(FrameFlags::FD);
        self.j1939.weigh(id, frame.data(), is_plain);
        if !is_plain || self.j1939.is_doubted() {
            self.say_j1939_doubted(frame, out);
            self.undecoded(frame, None, out);
            return false;
        }
        true
    }

    fn say_j1939_doubted(&mut self, frame: &Frame, out: &mut dyn Observer) {
        if let Some(reason) = self.j1939.take_reason() {
            let text =
                format!("29-bit frames are not taken for J1939: {reason}; --protocol j1939 decodes them");
            self.note(frame, text, out);
        }
    }

    #[inline]
    pub(super) fn j1939_heard(&mut self, source: u8, frame: &Frame) {
        if source >= NO_ADDRESS {
            return;
        }
        let now = self.clock.now();
        let Some(node) = self.node_mut(NodeId::J1939(source)) else { return };
        if node.first_frame == 0 {
            node.first_frame = frame.number;
        }
        node.last_frame = frame.number;
        node.last_seen = frame.time;
        node.last_heard = now;
    }

    fn on_j1939_request(&mut self, id: J1939Id, frame: &Frame, out: &mut dyn Observer) {
        match request(frame.data()) {
            Ok(pgn) => {
                let name = self.group_name(pgn);
                let (source, destination) = (id.source, id.destination);
                let request = J1939Request { pgn, name, source, destination };
                self.emit_j1939(frame, id, EventKind::J1939Request(request), out);
            }
            Err(error) => self.malformed_j1939(id, error, "a request has three bytes", frame, out),
        }
    }

    fn on_acknowledgement(&mut self, id: J1939Id, frame: &Frame, out: &mut dyn Observer) {
        match Acknowledgement::read(frame.data()) {
            Ok(message) => {
                let name = self.group_name(message.pgn);
                let (source, destination) = (id.source, id.destination);
                let answer = J1939Acknowledgement { message, name, source, destination };
                self.emit_j1939(frame, id, EventKind::Acknowledgement(answer), out);
                if message.control == DONE {
                    self.trouble_codes_cleared(id.source, message.pgn, frame, out);
                }
            }
            Err(error) => self.malformed_j1939(id, error, "an acknowledgement has eight bytes", frame, out),
        }
    }

    /// An event about one frame, as J1939, of the node that sent it.
    pub(in crate::session) fn j1939_event(&self, frame: &Frame, id: J1939Id, kind: EventKind) -> Event {
        let sender = NodeId::J1939(id.source);
        let mut event = self.event_of(frame, Some(sender), kind);
        event.node = Some(sender).filter(|node| node.is_valid());
        event
    }

    /// Emits an event about one frame, of the node that sent it.
    pub(in crate::session) fn emit_j1939(
        &self,
        frame: &Frame,
        id: J1939Id,
        kind: EventKind,
        out: &mut dyn Observer,
    ) {
        out.event(&self.j1939_event(frame, id, kind), self);
    }

    pub(in crate::session) fn malformed_j1939(
        &self,
        id: J1939Id,
        error: Malformed,
        reason: &'static str,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        self.emit_j1939(frame, id, EventKind::Malformed { error, reason }, out);
    }
}
