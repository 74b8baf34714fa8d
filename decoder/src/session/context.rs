//! Context of a protocol machine: bus, timers, and the path of events to the observer.

use std::ops::{Deref, DerefMut};
use std::sync::Arc;

use crate::event::{Event, EventKind, EventProtocol, EvictedState, FrameRange, UndecodedFrame};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA};
use crate::profile::dbc::DatabaseMessage;
use crate::session::bus::{Bus, IdentifierService};
use crate::session::detection::ProtocolStatus;
use crate::session::observer::Observer;
use crate::session::options::ProtocolChoice;
use crate::session::timers::Timers;
use crate::wire::j1939::J1939Id;
use crate::wire::{MalformedPayload, NodeId};
use crate::words::count_noun;

/// Max data bytes of a classical CAN frame.
const CLASSIC_DATA: usize = 8;

/// Notices already emitted for this bus.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct NoticesSent {
    pub(in crate::session) canopen_rejected: bool,
    pub(in crate::session) canopen_presumed: bool,
    pub(in crate::session) name_contradicted: bool,
    pub(in crate::session) fd: bool,
    pub(in crate::session) extended_full: bool,
    pub(in crate::session) fast_packets: bool,
    pub(in crate::session) made_up_times: bool,
}

/// Bytes held by open transfers, per machine; the sum is limited to [`super::OPEN_DATA_LIMIT`].
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct OpenData {
    pub(in crate::session) sdo: usize,
    pub(in crate::session) isotp: usize,
    pub(in crate::session) uds: usize,
}

/// State shared by all machines of a bus.
#[derive(Debug, Clone)]
pub(in crate::session) struct SharedState {
    pub(in crate::session) bus: Bus,
    pub(in crate::session) timers: Timers,
    pub(in crate::session) notices: NoticesSent,
    pub(in crate::session) open_data: OpenData,
}

impl SharedState {
    /// State of a bus before its first frame.
    pub(in crate::session) fn new(bus: Bus) -> Self {
        Self {
            bus,
            timers: Timers::default(),
            notices: NoticesSent::default(),
            open_data: OpenData::default(),
        }
    }

    /// Lends the shared state and the observer for one frame or deadline.
    #[inline]
    pub(in crate::session) fn lend_context<'a>(
        &'a mut self,
        out: &'a mut dyn Observer,
    ) -> MachineContext<'a> {
        MachineContext { shared: self, out }
    }
}

/// Context of a machine during one frame or deadline: the shared state and the observer.
pub(in crate::session) struct MachineContext<'a> {
    // A single pointer is cheap: one pointer per field would be written for every frame.
    shared: &'a mut SharedState,
    out: &'a mut dyn Observer,
}

impl Deref for MachineContext<'_> {
    type Target = SharedState;

    #[inline]
    fn deref(&self) -> &SharedState {
        self.shared
    }
}

impl DerefMut for MachineContext<'_> {
    #[inline]
    fn deref_mut(&mut self) -> &mut SharedState {
        self.shared
    }
}

impl MachineContext<'_> {
    /// Passes an event to the observer.
    #[inline]
    pub(in crate::session) fn send_event(&mut self, event: &Event) {
        self.out.on_event(event, &self.shared.bus);
    }

    /// Passes the prepared event of a slot to the observer.
    #[inline]
    pub(in crate::session) fn send_prepared(&mut self, slot: usize) {
        self.shared.bus.routes.set_current(Some(slot));
        if let Some(event) = self.shared.bus.routes.slot(slot).and_then(|entry| entry.prepared.as_deref()) {
            self.out.on_event(event, &self.shared.bus);
        }
        self.shared.bus.routes.set_current(None);
    }

    /// Emits an undecoded frame. If a database describes it, it is routine only while unchanged.
    pub(in crate::session) fn emit_undecoded(&mut self, frame: &Frame, name: Option<&'static str>) {
        let bus = &self.shared.bus;
        let name = name.filter(|name| bus.protocols.is_canopen() && !bus.routes.is_lone(frame.id, name));
        let is_data = !frame.flags.contains(FrameFlags::REMOTE);
        let message = self.described_message(frame).filter(|_| is_data).cloned();
        if message.is_none() {
            let (count, extended) = &mut self.shared.bus.protocols.undecoded;
            *count += 1;
            match frame.id {
                CanId::Extended(_) => *extended += 1,
                CanId::Standard(_) if is_data => {
                    self.shared.bus.hints.unnamed.take_frame(frame);
                    self.follow_dialogue(frame);
                }
                CanId::Standard(_) => {}
            }
        }
        let is_known = message.is_some();
        let kind = EventKind::Frame(UndecodedFrame { frame: *frame, name, message });
        let mut event = self.canopen_event(frame, kind);
        event.protocol = EventProtocol::Can;
        event.presumed = false;
        event.routine = !is_known || self.repeats_data(frame);
        self.send_event(&event);
    }

    /// Looks for an SDO dialogue on identifiers of no channel; `true` if this frame revealed one. Its identifiers
    /// are not decoded any more.
    pub(in crate::session) fn follow_dialogue(&mut self, frame: &Frame) -> bool {
        let Some(pair) = self.shared.bus.hints.dialogues.take_frame(frame) else { return false };
        self.shared.bus.routes.reroute(pair.request, IdentifierService::Named("SDO-like request"));
        self.shared.bus.routes.reroute(pair.response, IdentifierService::Named("SDO-like response"));
        self.emit_note(frame, pair.hint_text());
        true
    }

    /// Database message for a frame. `None` if the message is longer than the frame can be: an unknown
    /// transport protocol would split it over several frames.
    pub(in crate::session) fn described_message(&self, frame: &Frame) -> Option<&Arc<DatabaseMessage>> {
        let most = if frame.flags.contains(FrameFlags::FD) { MAX_DATA } else { CLASSIC_DATA };
        let message = self.shared.bus.database.message_by_id(frame.id)?;
        message.length.is_some_and(|length| usize::from(length) <= most).then_some(message)
    }

    /// Whether the data equal those of the previous frame with this identifier. Always false for a 29-bit
    /// identifier without a slot.
    fn repeats_data(&mut self, frame: &Frame) -> bool {
        let slot = self.shared.bus.routes.find_slot(frame.id);
        let Some(entry) = slot.and_then(|slot| self.shared.bus.routes.slot_mut(slot)) else { return false };
        let Some(before) = &mut entry.described else {
            entry.described = Some(Box::new(*frame));
            return false;
        };
        let repeats = before.data() == frame.data();
        **before = *frame;
        repeats
    }

    /// Whether a frame on a CANopen identifier is decoded; otherwise it is emitted undecoded. Emits a note
    /// before the first presumed event. `node` is `None` for a service of the whole bus.
    pub(in crate::session) fn is_decoded(&mut self, node: Option<NodeId>, frame: &Frame) -> bool {
        if self.is_settled(node) {
            return true;
        }
        // A SYNC may precede the first frame of a node that the user named: the note waits for a node.
        let is_early = node.is_none() && self.shared.bus.protocols.named.names_canopen();
        if self.shared.bus.protocols.canopen.protocol_status() == ProtocolStatus::Presumed && !is_early {
            self.shared.bus.protocols.canopen.note_presumed();
            if !std::mem::replace(&mut self.shared.notices.canopen_presumed, true) {
                let text = "CANopen not confirmed yet: decoded by the predefined connection set, marked ?";
                self.emit_note(frame, text.into());
            }
        }
        self.is_followed(node, frame)
    }

    /// Whether the protocol of a node that sent a frame is settled; as [`Bus::is_settled`].
    pub(in crate::session) fn is_settled(&mut self, node: Option<NodeId>) -> bool {
        let bus = &mut self.shared.bus;
        let is_named = match node {
            Some(id) => bus.protocols.named.note_canopen(id),
            None => bus.protocols.named.has_canopen(),
        };
        is_named || bus.protocols.canopen.is_confirmed()
    }

    /// Like [`Self::is_decoded`], for frames that do not cause an event of their own.
    pub(in crate::session) fn is_followed(&mut self, node: Option<NodeId>, frame: &Frame) -> bool {
        if self.is_settled(node)
            || self.shared.bus.protocols.canopen.protocol_status() != ProtocolStatus::Rejected
        {
            return true;
        }
        if self.shared.bus.protocols.choice != ProtocolChoice::None {
            self.shared.bus.protocols.omissions.canopen += 1;
            if !std::mem::replace(&mut self.shared.notices.canopen_rejected, true) {
                self.emit_rejection(frame);
            }
        }
        self.emit_undecoded(frame, None);
        false
    }

    /// Reports why frames are not decoded as CANopen, and which nodes are, because the user named them.
    fn emit_rejection(&mut self, frame: &Frame) {
        let reason = self.shared.bus.protocols.canopen.rejection_reason();
        let text = if self.shared.bus.protocols.named.has_canopen() {
            let nodes = self.shared.bus.protocols.named.canopen_list();
            format!(
                "not detected as CANopen: {reason}; only identifiers of named nodes ({nodes}) are decoded \
                 (--protocol canopen decodes all)"
            )
        } else {
            format!(
                "not detected as CANopen: {reason}; frames are not decoded (--protocol canopen decodes them)"
            )
        };
        self.emit_note(frame, text);
    }

    /// Reports once that a frame of a node that the user named is not valid in CANopen; `expected` is its content by
    /// CiA 301.
    #[cold]
    pub(in crate::session) fn emit_contradicted_name(&mut self, node: NodeId, frame: &Frame, expected: &str) {
        if !self.shared.bus.protocols.canopen.is_confirmed()
            && self.shared.bus.protocols.named.contains(node)
            && !std::mem::replace(&mut self.shared.notices.name_contradicted, true)
        {
            let (id, length) = (frame.id, count_noun(u64::from(frame.length), "byte"));
            let text = format!(
                "{} treated as CANopen because the user named it, but {id} has {length} (CiA 301: {expected}); BUS:N \
                 limits an option to one bus",
                node.sentence_label()
            );
            self.shared.bus.protocols.named.note_contradiction(&text);
            self.emit_note(frame, text);
        }
    }

    /// CANopen event about one frame.
    #[inline]
    pub(in crate::session) fn canopen_event(&self, frame: &Frame, kind: EventKind) -> Event {
        Event {
            time: frame.time,
            bus: self.shared.bus.index,
            frames: FrameRange::one(frame.number),
            protocol: EventProtocol::Canopen,
            node: None,
            presumed: !self.shared.bus.protocols.is_settled(None),
            routine: false,
            kind,
        }
    }

    /// Emits an event about one frame and a node.
    pub(in crate::session) fn emit_event(
        &mut self,
        frame: &Frame,
        node: impl Into<Option<NodeId>>,
        routine: bool,
        kind: EventKind,
    ) {
        let mut event = self.event_of(frame, node.into(), kind);
        event.routine = routine;
        self.send_event(&event);
    }

    /// Event about one frame and a node; the type of node-ID determines the protocol.
    pub(in crate::session) fn event_of(&self, frame: &Frame, node: Option<NodeId>, kind: EventKind) -> Event {
        let mut event = self.canopen_event(frame, kind);
        event.node = node;
        event.presumed = !self.shared.bus.protocols.is_settled(node);
        if let Some(NodeId::J1939(_)) = node {
            event.protocol = EventProtocol::J1939;
        }
        event
    }

    /// Emits an event about the bus itself.
    pub(in crate::session) fn emit_can(&mut self, frame: &Frame, kind: EventKind) {
        let mut event = self.canopen_event(frame, kind);
        event.protocol = EventProtocol::Can;
        event.presumed = false;
        self.send_event(&event);
    }

    /// Emits a note about the bus.
    pub(in crate::session) fn emit_note(&mut self, frame: &Frame, text: String) {
        self.emit_can(frame, EventKind::Note { text });
    }

    /// Reports a message too short for its service.
    pub(in crate::session) fn emit_malformed(
        &mut self,
        frame: &Frame,
        node: impl Into<Option<NodeId>>,
        error: MalformedPayload,
        reason: &'static str,
    ) {
        self.emit_event(frame, node, false, EventKind::Malformed { error, reason });
    }

    /// Reports that a channel or an identifier was rejected because its table is full.
    pub(in crate::session) fn emit_table_full(&mut self, frame: &Frame) {
        if self.shared.bus.channels.take_refused() {
            self.emit_can(frame, EventKind::Evicted { what: EvictedState::SdoChannel, count: 1 });
        }
        if self.shared.bus.routes.take_refused() {
            self.emit_can(frame, EventKind::Evicted { what: EvictedState::LearntIdentifier, count: 1 });
        }
    }

    /// Empty frame with number and time of the last frame, for events at the end of a capture.
    pub(in crate::session) fn last_frame(&self) -> Frame {
        Frame { number: self.shared.bus.last_frame, time: self.shared.bus.last_time, ..Frame::EMPTY }
    }

    /// J1939 event about one frame and its sender.
    pub(in crate::session) fn j1939_event(&self, frame: &Frame, id: J1939Id, kind: EventKind) -> Event {
        let sender = NodeId::J1939(id.source);
        let mut event = self.event_of(frame, Some(sender), kind);
        event.node = Some(sender).filter(|node| node.is_valid());
        event.presumed &= !self.shared.bus.protocols.named.concerns_named(id);
        event
    }

    /// Emits a J1939 event about one frame and its sender.
    pub(in crate::session) fn emit_j1939(&mut self, frame: &Frame, id: J1939Id, kind: EventKind) {
        let event = self.j1939_event(frame, id, kind);
        self.send_event(&event);
    }

    /// Reports a payload that is too short for its parameter group, or contradicts it.
    pub(in crate::session) fn emit_malformed_j1939(
        &mut self,
        id: J1939Id,
        error: MalformedPayload,
        reason: &'static str,
        frame: &Frame,
    ) {
        self.emit_j1939(frame, id, EventKind::Malformed { error, reason });
    }

    /// UDS event about the frames of a message.
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
            protocol: EventProtocol::Uds,
            node,
            presumed: false,
            routine: false,
            kind,
        }
    }

    /// Reports a payload that is too short for ISO-TP or UDS, or not defined there.
    pub(in crate::session) fn emit_malformed_uds(
        &mut self,
        frame: &Frame,
        error: MalformedPayload,
        reason: &'static str,
    ) {
        let kind = EventKind::Malformed { error, reason };
        let event = self.uds_event(frame, FrameRange::one(frame.number), None, kind);
        self.send_event(&event);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::BusIndex;
    use crate::profile::LayoutOrigin;
    use crate::profile::dbc::{Database, parse_database};
    use crate::session::BusDecoder;
    use crate::session::SessionOptions;

    const DBC: &str = "BO_ 291 SHORT: 2 N\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" N\n\
                       BO_ 292 LONG: 16 N\n SG_ B : 0|8@1+ (1,0) [0|0] \"\" N\n\
                       BO_ 389 PROCESS: 8 N\n SG_ C : 0|16@1+ (1,0) [0|0] \"\" N\n";

    fn bus(names: &[&str]) -> BusDecoder {
        let mut database = Database::default();
        database.add_file(parse_database(DBC.as_bytes()).unwrap());
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

    /// Name of the database message, and whether the event is routine.
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
        assert_eq!(bus.bus().protocols.undecoded, (1, 0));
        // A database of one bus does not apply to another.
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
    fn an_unmapped_pdo_is_laid_out_by_the_database() {
        let mut bus = bus(&["can0"]);
        push(&mut bus, &Frame::data_frame(CanId::Standard(0x705), &[5]));
        let events = push(&mut bus, &Frame::data_frame(CanId::Standard(0x185), &[1, 2]));
        let EventKind::Pdo(pdo) = &events[0].kind else { panic!("{events:?}") };
        assert_eq!(pdo.layout.as_ref().map(|layout| layout.origin), Some(LayoutOrigin::Dbc));
        let events = push(&mut bus, &Frame::data_frame(CanId::Standard(0x285), &[1, 2]));
        let EventKind::Pdo(pdo) = &events[0].kind else { panic!("{events:?}") };
        assert!(pdo.layout.is_none());
    }
}
