//! How a bus makes events, and whether it makes any of a frame.

use std::sync::Arc;

use super::belief::Standing;
use super::{Bus, Observer};
use crate::event::{Event, EventKind, FrameRange, Protocol, Undecoded};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA};
use crate::profile::dbc::DatabaseMessage;
use crate::wire::Malformed;
use crate::wire::NodeId;

/// Bytes of a frame that is not CAN FD.
const CLASSIC_DATA: usize = 8;

impl Bus {
    /// A frame no service is decoded of. One a database describes is told as often as it changes.
    pub(super) fn undecoded(&mut self, frame: &Frame, name: Option<&'static str>, out: &mut dyn Observer) {
        let name = name.filter(|_| self.belief.is_believed());
        let is_data = !frame.flags.contains(FrameFlags::REMOTE);
        let message = self.described(frame).filter(|_| is_data).cloned();
        if message.is_none() {
            let (count, extended) = &mut self.undecoded;
            *count += 1;
            match frame.id {
                CanId::Extended(_) => *extended += 1,
                CanId::Standard(_) if is_data => self.unnamed.take(frame),
                CanId::Standard(_) => {}
            }
        }
        let is_known = message.is_some();
        let kind = EventKind::Frame(Undecoded { frame: *frame, name, message });
        let mut event = self.event(frame, kind);
        event.protocol = Protocol::Can;
        event.presumed = false;
        event.routine = !is_known || self.repeats(frame);
        out.event(&event, self);
    }

    /// What the user's databases tell of a frame. A longer message than such a frame carries comes in several,
    /// by a transport protocol nobody knows here.
    pub(super) fn described(&self, frame: &Frame) -> Option<&Arc<DatabaseMessage>> {
        let most = if frame.flags.contains(FrameFlags::FD) { MAX_DATA } else { CLASSIC_DATA };
        let message = self.database.frame(frame.id)?;
        message.length.is_some_and(|length| usize::from(length) <= most).then_some(message)
    }

    /// Whether a frame has the data of the one before it with its identifier. Those of the 29-bit ones that are
    /// not kept apart never have.
    fn repeats(&mut self, frame: &Frame) -> bool {
        let slot = self.routes.find(frame.id);
        let Some(entry) = slot.and_then(|slot| self.routes.slot_mut(slot)) else { return false };
        let Some(before) = &mut entry.described else {
            entry.described = Some(Box::new(*frame));
            return false;
        };
        let repeats = before.data() == frame.data();
        **before = *frame;
        repeats
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::BusIndex;
    use crate::profile::dbc::{Database, parse};
    use crate::session::SessionOptions;

    const DBC: &str = "BO_ 291 SHORT: 2 N\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" N\n\
                       BO_ 292 LONG: 16 N\n SG_ B : 0|8@1+ (1,0) [0|0] \"\" N\n\
                       BO_ 389 PROCESS: 8 N\n SG_ C : 0|16@1+ (1,0) [0|0] \"\" N\n";

    fn bus(names: &[&str]) -> Bus {
        let mut database = Database::default();
        database.add(parse(DBC.as_bytes()).unwrap());
        let bus_databases =
            names.iter().map(|name| ((*name).to_owned(), Arc::new(database.clone()))).collect();
        let options = SessionOptions { bus_databases, ..SessionOptions::default() };
        Bus::new(BusIndex(0), "can0", Arc::new(options))
    }

    fn push(bus: &mut Bus, frame: &Frame) -> Vec<Event> {
        let mut events = Vec::new();
        bus.push(frame, &mut |event: &Event, _: &Bus| events.push(event.clone()));
        events.retain(|event| matches!(event.kind, EventKind::Frame(_) | EventKind::Pdo(_)));
        events
    }

    /// Name of the message a frame is laid out by, and whether it is routine.
    fn seen(bus: &mut Bus, frame: &Frame) -> (Option<String>, bool) {
        let events = push(bus, frame);
        let EventKind::Frame(undecoded) = &events[0].kind else { panic!("{events:?}") };
        (undecoded.message.as_ref().map(|message| message.name.clone()), events[0].routine)
    }

    #[test]
    fn a_described_frame_is_routine_when_it_repeats() {
        let mut bus = bus(&["can0"]);
        let frame = |data: &[u8]| Frame::data_frame(CanId::Standard(291), data);
        let short = Some("SHORT".to_owned());
        assert_eq!(seen(&mut bus, &frame(&[1, 2])), (short.clone(), false));
        assert_eq!(seen(&mut bus, &frame(&[1, 2])), (short.clone(), true));
        assert_eq!(seen(&mut bus, &frame(&[1])), (short, false));
        let mut remote = frame(&[]);
        remote.flags = FrameFlags::REMOTE;
        assert_eq!(seen(&mut bus, &remote), (None, true));
        assert_eq!(bus.undecoded, (1, 0));
        // What holds on one bus does not on another.
        assert_eq!(seen(&mut self::bus(&["can1"]), &frame(&[1, 2])), (None, true));
    }

    #[test]
    fn a_message_longer_than_its_frame_could_be_is_not_laid_over_it() {
        let mut bus = bus(&["can0"]);
        let mut frame = Frame::data_frame(CanId::Standard(292), &[1; 8]);
        assert_eq!(seen(&mut bus, &frame), (None, true));
        frame.flags = FrameFlags::FD;
        assert_eq!(seen(&mut bus, &frame), (Some("LONG".to_owned()), false));
    }

    #[test]
    fn a_pdo_nobody_mapped_is_laid_out_by_the_database() {
        let mut bus = bus(&["can0"]);
        push(&mut bus, &Frame::data_frame(CanId::Standard(0x705), &[5]));
        let events = push(&mut bus, &Frame::data_frame(CanId::Standard(0x185), &[1, 2]));
        let EventKind::Pdo(pdo) = &events[0].kind else { panic!("{events:?}") };
        assert_eq!(pdo.layout.as_ref().map(|layout| layout.origin), Some("dbc"));
        let events = push(&mut bus, &Frame::data_frame(CanId::Standard(0x285), &[1, 2]));
        let EventKind::Pdo(pdo) = &events[0].kind else { panic!("{events:?}") };
        assert!(pdo.layout.is_none());
    }
}
