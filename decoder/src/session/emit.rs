//! How a bus makes events, and whether it makes any of a frame.

use super::belief::Standing;
use super::{Bus, Observer};
use crate::event::{Event, EventKind, FrameRange, Protocol, Undecoded};
use crate::frame::{CanId, Frame};
use crate::wire::Malformed;
use crate::wire::NodeId;

impl Bus {
    /// A frame no service is decoded of.
    pub(super) fn undecoded(&mut self, frame: &Frame, name: Option<&'static str>, out: &mut dyn Observer) {
        let name = name.filter(|_| self.belief.is_believed());
        let (count, extended) = &mut self.undecoded;
        *count += 1;
        *extended += u64::from(matches!(frame.id, CanId::Extended(_)));
        let kind = EventKind::Frame(Undecoded { frame: *frame, name });
        let mut event = self.event(frame, kind);
        event.protocol = Protocol::Can;
        event.presumed = false;
        event.routine = true;
        out.event(&event, self);
    }

    /// Whether a frame on a CANopen identifier is decoded; else it is passed on undecoded. Says once
    /// when events are only presumed.
    pub(super) fn is_decoded(&mut self, frame: &Frame, out: &mut dyn Observer) -> bool {
        if self.belief.standing() == Standing::Presumed && !std::mem::replace(&mut self.said.presumed, true) {
            let text = "no sign of CANopen yet: read by the predefined identifiers, marked ?";
            self.note(frame, text.into(), out);
        }
        self.is_followed(frame, out)
    }

    /// The same for frames that make no event by themselves.
    pub(super) fn is_followed(&mut self, frame: &Frame, out: &mut dyn Observer) -> bool {
        if self.belief.standing() != Standing::Doubted {
            return true;
        }
        if self.options.protocol != super::ProtocolChoice::None
            && !std::mem::replace(&mut self.said.doubted, true)
        {
            let reason = self.belief.reason();
            let text = format!(
                "not taken for CANopen: {reason}; frames stay undecoded, --protocol canopen decodes them"
            );
            self.note(frame, text, out);
        }
        self.undecoded(frame, None, out);
        false
    }

    /// An event about one frame, as CANopen.
    #[inline]
    pub(super) fn event(&self, frame: &Frame, kind: EventKind) -> Event {
        Event {
            time: frame.time,
            bus: self.index,
            frames: FrameRange::one(frame.number),
            protocol: Protocol::Canopen,
            node: None,
            presumed: !self.belief.is_believed(),
            routine: false,
            kind,
        }
    }

    /// Emits an event about one frame and a node.
    pub(super) fn emit(
        &self,
        frame: &Frame,
        node: impl Into<Option<NodeId>>,
        routine: bool,
        kind: EventKind,
        out: &mut dyn Observer,
    ) {
        let mut event = self.event_of(frame, node.into(), kind);
        event.routine = routine;
        out.event(&event, self);
    }

    /// An event about one frame and a node, as the protocol the node speaks.
    pub(super) fn event_of(&self, frame: &Frame, node: Option<NodeId>, kind: EventKind) -> Event {
        let mut event = self.event(frame, kind);
        event.node = node;
        if let Some(NodeId::J1939(_)) = node {
            event.protocol = Protocol::J1939;
            event.presumed = !self.j1939.is_believed();
        }
        event
    }

    /// Emits an event about the bus itself.
    pub(super) fn emit_can(&self, frame: &Frame, kind: EventKind, out: &mut dyn Observer) {
        let mut event = self.event(frame, kind);
        event.protocol = Protocol::Can;
        event.presumed = false;
        out.event(&event, self);
    }

    /// Says something about the bus.
    pub(super) fn note(&self, frame: &Frame, text: String, out: &mut dyn Observer) {
        self.emit_can(frame, EventKind::Note { text }, out);
    }

    /// Reports bytes that are too few for their service.
    pub(super) fn malformed(
        &self,
        frame: &Frame,
        node: impl Into<Option<NodeId>>,
        error: Malformed,
        reason: &'static str,
        out: &mut dyn Observer,
    ) {
        self.emit(frame, node, false, EventKind::Malformed { error, reason }, out);
    }
}
