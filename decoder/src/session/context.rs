//! What machines work with: the bus, the timers, and the way of events to the observer.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use crate::event::{Event, EventKind, FrameRange, Protocol, Undecoded};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA};
use crate::profile::dbc::DatabaseMessage;
use crate::session::bus::Bus;
use crate::session::detection::ProtocolStatus;
use crate::session::observer::Observer;
use crate::session::options::ProtocolChoice;
use crate::session::timers::Timers;
use crate::wire::j1939::J1939Id;
use crate::wire::{Malformed, NodeId};

/// Bytes of a frame that is not CAN FD.
const CLASSIC_DATA: usize = 8;

/// Notices already emitted for this bus.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct NoticesSent {
    pub(in crate::session) canopen_rejected: bool,
    pub(in crate::session) canopen_presumed: bool,
    pub(in crate::session) fd: bool,
    pub(in crate::session) extended_full: bool,
    pub(in crate::session) fast_packets: bool,
    pub(in crate::session) made_up_times: bool,
}

/// Bytes that open transfers of machines hold, which share [`super::OPEN_DATA_LIMIT`].
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct OpenData {
    pub(in crate::session) sdo: usize,
    pub(in crate::session) isotp: usize,
    pub(in crate::session) uds: usize,
}

/// What all machines of a bus share.
#[derive(Debug, Clone)]
pub(in crate::session) struct Shared {
    pub(in crate::session) bus: Bus,
    pub(in crate::session) timers: Timers,
    pub(in crate::session) notices: NoticesSent,
    pub(in crate::session) open_data: OpenData,
}

impl Shared {
    /// Around a bus before its first frame.
    pub(in crate::session) fn new(bus: Bus) -> Self {
        Self {
            bus,
            timers: Timers::default(),
            notices: NoticesSent::default(),
            open_data: OpenData::default(),
        }
    }

    /// Lends everything for one frame or deadline.
    #[inline]
    pub(in crate::session) fn lend<'a>(&'a mut self, out: &'a mut dyn Observer) -> Context<'a> {
        Context { shared: self, out }
    }
}

/// What a machine works with while it handles a frame or a deadline: what all machines share, and the observer.
pub(in crate::session) struct Context<'a> {
    // One pointer: a pointer for each field would be written for every frame.
    shared: &'a mut Shared,
    out: &'a mut dyn Observer,
}

impl Deref for Context<'_> {
    type Target = Shared;

    #[inline]
    fn deref(&self) -> &Shared {
        self.shared
    }
}

impl DerefMut for Context<'_> {
    #[inline]
    fn deref_mut(&mut self) -> &mut Shared {
        self.shared
    }
}

impl Context<'_> {
    /// Passes an event to the observer.
    #[inline]
    pub(in crate::session) fn send(&mut self, event: &Event) {
        self.out.event(event, &self.shared.bus);
    }

    /// Passes the prepared event of a slot to the observer.
    #[inline]
    pub(in crate::session) fn send_prepared(&mut self, slot: usize) {
        if let Some(event) = self.shared.bus.routes.slot(slot).and_then(|entry| entry.prepared.as_deref()) {
            self.out.event(event, &self.shared.bus);
        }
    }

    /// A frame no service is decoded of. One a database describes is told as often as it changes.
    pub(in crate::session) fn emit_undecoded(&mut self, frame: &Frame, name: Option<&'static str>) {
        let name = name.filter(|_| self.shared.bus.canopen.is_confirmed());
        let is_data = !frame.flags.contains(FrameFlags::REMOTE);
        let message = self.described_message(frame).filter(|_| is_data).cloned();
        if message.is_none() {
            let (count, extended) = &mut self.shared.bus.undecoded;
            *count += 1;
            match frame.id {
                CanId::Extended(_) => *extended += 1,
                CanId::Standard(_) if is_data => self.shared.bus.unnamed.take(frame),
                CanId::Standard(_) => {}
            }
        }
        let is_known = message.is_some();
        let kind = EventKind::Frame(Undecoded { frame: *frame, name, message });
        let mut event = self.event(frame, kind);
        event.protocol = Protocol::Can;
        event.presumed = false;
        event.routine = !is_known || self.repeats(frame);
        self.send(&event);
    }

    /// What the user's databases tell of a frame. A longer message than such a frame carries comes in several,
    /// by a transport protocol nobody knows here.
    pub(in crate::session) fn described_message(&self, frame: &Frame) -> Option<&Arc<DatabaseMessage>> {
        let most = if frame.flags.contains(FrameFlags::FD) { MAX_DATA } else { CLASSIC_DATA };
        let message = self.shared.bus.database.frame(frame.id)?;
        message.length.is_some_and(|length| usize::from(length) <= most).then_some(message)
    }

    /// Whether a frame has the data of the one before it with its identifier. Those of the 29-bit ones that are
    /// not kept apart never have.
    fn repeats(&mut self, frame: &Frame) -> bool {
        let slot = self.shared.bus.routes.find(frame.id);
        let Some(entry) = slot.and_then(|slot| self.shared.bus.routes.slot_mut(slot)) else { return false };
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
    pub(in crate::session) fn is_decoded(&mut self, frame: &Frame) -> bool {
        if self.shared.bus.canopen.status() == ProtocolStatus::Presumed
            && !std::mem::replace(&mut self.shared.notices.canopen_presumed, true)
        {
            let text = "no sign of CANopen yet: read by the predefined identifiers, marked ?";
            self.emit_note(frame, text.into());
        }
        self.is_followed(frame)
    }

    /// The same for frames that make no event by themselves.
    pub(in crate::session) fn is_followed(&mut self, frame: &Frame) -> bool {
        if self.shared.bus.canopen.status() != ProtocolStatus::Rejected {
            return true;
        }
        if self.shared.bus.options.protocol != ProtocolChoice::None
            && !std::mem::replace(&mut self.shared.notices.canopen_rejected, true)
        {
            let reason = self.shared.bus.canopen.reason();
            let text = format!(
                "not taken for CANopen: {reason}; frames stay undecoded, --protocol canopen decodes them"
            );
            self.emit_note(frame, text);
        }
        self.emit_undecoded(frame, None);
        false
    }

    /// An event about one frame, as CANopen.
    #[inline]
    pub(in crate::session) fn event(&self, frame: &Frame, kind: EventKind) -> Event {
        Event {
            time: frame.time,
            bus: self.shared.bus.index,
            frames: FrameRange::one(frame.number),
            protocol: Protocol::Canopen,
            node: None,
            presumed: !self.shared.bus.canopen.is_confirmed(),
            routine: false,
            kind,
        }
    }

    /// Emits an event about one frame and a node.
    pub(in crate::session) fn emit(
        &mut self,
        frame: &Frame,
        node: impl Into<Option<NodeId>>,
        routine: bool,
        kind: EventKind,
    ) {
        let mut event = self.event_of(frame, node.into(), kind);
        event.routine = routine;
        self.send(&event);
    }

    /// An event about one frame and a node, as the protocol the node speaks.
    pub(in crate::session) fn event_of(&self, frame: &Frame, node: Option<NodeId>, kind: EventKind) -> Event {
        let mut event = self.event(frame, kind);
        event.node = node;
        if let Some(NodeId::J1939(_)) = node {
            event.protocol = Protocol::J1939;
            event.presumed = !self.shared.bus.j1939.is_confirmed();
        }
        event
    }

    /// Emits an event about the bus itself.
    pub(in crate::session) fn emit_can(&mut self, frame: &Frame, kind: EventKind) {
        let mut event = self.event(frame, kind);
        event.protocol = Protocol::Can;
        event.presumed = false;
        self.send(&event);
    }

    /// Says something about the bus.
    pub(in crate::session) fn emit_note(&mut self, frame: &Frame, text: String) {
        self.emit_can(frame, EventKind::Note { text });
    }

    /// Reports bytes that are too few for their service.
    pub(in crate::session) fn emit_malformed(
        &mut self,
        frame: &Frame,
        node: impl Into<Option<NodeId>>,
        error: Malformed,
        reason: &'static str,
    ) {
        self.emit(frame, node, false, EventKind::Malformed { error, reason });
    }

    /// Reports that a channel or an identifier did not fit its table.
    pub(in crate::session) fn emit_table_full(&mut self, frame: &Frame) {
        if self.shared.bus.channels.take_refused() {
            self.emit_can(frame, EventKind::Evicted { what: "SDO channel", count: 1 });
        }
        if self.shared.bus.routes.take_refused() {
            self.emit_can(frame, EventKind::Evicted { what: "learnt identifier", count: 1 });
        }
    }

    /// A frame with number and time of the last one, for events at the end of a capture.
    pub(in crate::session) fn last_frame(&self) -> Frame {
        Frame { number: self.shared.bus.last_frame, time: self.shared.bus.last_time, ..Frame::EMPTY }
    }

    /// An event about one frame, as J1939, of the node that sent it.
    pub(in crate::session) fn j1939_event(&self, frame: &Frame, id: J1939Id, kind: EventKind) -> Event {
        let sender = NodeId::J1939(id.source);
        let mut event = self.event_of(frame, Some(sender), kind);
        event.node = Some(sender).filter(|node| node.is_valid());
        event
    }

    /// Emits an event about one frame, as J1939, of the node that sent it.
    pub(in crate::session) fn emit_j1939(&mut self, frame: &Frame, id: J1939Id, kind: EventKind) {
        let event = self.j1939_event(frame, id, kind);
        self.send(&event);
    }

    /// Reports bytes that are too few for their group, or contradict it.
    pub(in crate::session) fn emit_malformed_j1939(
        &mut self,
        id: J1939Id,
        error: Malformed,
        reason: &'static str,
        frame: &Frame,
    ) {
        self.emit_j1939(frame, id, EventKind::Malformed { error, reason });
    }

    /// An event as UDS, about the frames of a message.
    pub(in crate::session) fn uds_event(
        &self,
        frame: &Frame,
        frames: FrameRange,
        node: Option<NodeId>,
        kind: EventKind,
    ) -> Event {
        Event {
            time: frame.time,
            bus: self.shared.bus.index,
            frames,
            protocol: Protocol::Uds,
            node,
            presumed: false,
            routine: false,
            kind,
        }
    }

    /// Reports bytes that are too few for ISO-TP or UDS, or undefined there.
    pub(in crate::session) fn emit_malformed_uds(
        &mut self,
        frame: &Frame,
        error: Malformed,
        reason: &'static str,
    ) {
        let kind = EventKind::Malformed { error, reason };
        let event = self.uds_event(frame, FrameRange::one(frame.number), None, kind);
        self.send(&event);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::BusIndex;
    use crate::profile::dbc::{Database, parse};
    use crate::session::BusDecoder;
    use crate::session::SessionOptions;

    const DBC: &str = "BO_ 291 SHORT: 2 N\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" N\n\
                       BO_ 292 LONG: 16 N\n SG_ B : 0|8@1+ (1,0) [0|0] \"\" N\n\
                       BO_ 389 PROCESS: 8 N\n SG_ C : 0|16@1+ (1,0) [0|0] \"\" N\n";

    fn bus(names: &[&str]) -> BusDecoder {
        let mut database = Database::default();
        database.add(parse(DBC.as_bytes()).unwrap());
        let bus_databases =
            names.iter().map(|name| ((*name).to_owned(), Arc::new(database.clone()))).collect();
        let options = SessionOptions { bus_databases, ..SessionOptions::default() };
        BusDecoder::new(BusIndex(0), "can0", Arc::new(options))
    }

    fn push(bus: &mut BusDecoder, frame: &Frame) -> Vec<Event> {
        let mut events = Vec::new();
        bus.push(frame, &mut |event: &Event, _: &Bus| events.push(event.clone()));
        events.retain(|event| matches!(event.kind, EventKind::Frame(_) | EventKind::Pdo(_)));
        events
    }

    /// Name of the message a frame is laid out by, and whether it is routine.
    fn seen(bus: &mut BusDecoder, frame: &Frame) -> (Option<String>, bool) {
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
        assert_eq!(bus.bus().undecoded, (1, 0));
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
