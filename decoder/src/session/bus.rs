//! One bus: its clock, its routes, its nodes, and the way of a frame through them.

use std::sync::Arc;

use super::belief::{Belief, Standing};
use super::canopen::{Channels, LssState, SyncState};
use super::clock::Clock;
use super::node::Node;
use super::routes::{Origin, Routes, Service};
use super::timers::{Subject, Timers};
use super::{Observer, SessionOptions};
use crate::event::{Event, EventKind, FrameRange, Protocol, Undecoded};
use crate::frame::{BusIndex, CanId, Frame, FrameFlags, Timestamp};
use crate::profile::Owner;
use crate::wire::canopen::sdo::Side;
use crate::wire::{Malformed, error_frame};

/// Everything remembered about one bus. A clone is a checkpoint.
#[derive(Debug, Clone)]
pub struct Bus {
    pub(super) index: BusIndex,
    pub(super) name: Arc<str>,
    pub(super) options: Arc<SessionOptions>,
    pub(super) belief: Belief,
    pub(super) clock: Clock,
    pub(super) timers: Timers,
    pub(super) routes: Routes,
    pub(super) nodes: Vec<Node>,
    /// Place in `nodes` + 1 by node-ID, 0 = none.
    node_by_id: [u8; 128],
    pub(super) channels: Channels,
    pub(super) sync: SyncState,
    pub(super) lss: LssState,
    said: Said,
    /// Last boot-up that nobody commanded: monotonic time and node-ID.
    pub(super) last_boot: Option<(i64, u8)>,
    /// Monotonic time at which the last silence of the bus ended.
    pub(super) silent_until: Option<i64>,
    /// Frames left undecoded, and those of 29 bits among them.
    undecoded: (u64, u64),
    /// Last frame seen and its stamp.
    pub(super) last_frame: u64,
    pub(super) last_time: Option<Timestamp>,
}

/// What is said once a bus.
#[derive(Debug, Clone, Copy, Default)]
struct Said {
    doubted: bool,
    presumed: bool,
    fd: bool,
    extended_full: bool,
}

impl Bus {
    /// A bus nothing is known of.
    pub fn new(index: BusIndex, name: &str, options: Arc<SessionOptions>) -> Self {
        let mut bus = Self {
            index,
            name: name.into(),
            belief: Belief::new(options.protocol),
            options,
            clock: Clock::default(),
            timers: Timers::default(),
            routes: Routes::default(),
            nodes: Vec::new(),
            node_by_id: [0; 128],
            channels: Channels::default(),
            sync: SyncState::default(),
            lss: LssState::default(),
            said: Said::default(),
            last_boot: None,
            silent_until: None,
            undecoded: (0, 0),
            last_frame: 0,
            last_time: None,
        };
        bus.take_given();
        bus
    }

    /// Name of the interface.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Index within the capture.
    pub fn index(&self) -> BusIndex {
        self.index
    }

    /// Whether the traffic is believed to be CANopen.
    pub fn is_canopen(&self) -> bool {
        self.belief.is_believed()
    }

    /// The node with this node-ID now.
    pub fn node(&self, id: u8) -> Option<&Node> {
        let place = *self.node_by_id.get(usize::from(id))?;
        self.nodes.get(usize::from(place.checked_sub(1)?))
    }

    /// All nodes in order of their node-ID.
    pub fn nodes(&self) -> impl Iterator<Item = &Node> {
        (1..=127).filter_map(|id| self.node(id))
    }

    /// What an identifier means now, for people: `TPDO1 of 5`, `SDO response of 15`.
    pub fn describe_id(&self, id: CanId) -> String {
        match self.routes.find(id).and_then(|slot| self.routes.slot(slot)).map(|slot| slot.service) {
            _ if !self.belief.is_believed() => String::new(),
            None | Some(Service::Unclassified) => String::new(),
            Some(Service::Named(name)) => name.to_owned(),
            Some(Service::Nmt) => "NMT".to_owned(),
            Some(Service::Sync) => "SYNC".to_owned(),
            Some(Service::Time) => "TIME".to_owned(),
            Some(Service::Emcy(node)) => format!("EMCY of {node}"),
            Some(Service::Pdo(name, node)) => format!("{name} of {node}"),
            Some(Service::ErrorControl(node)) => format!("heartbeat, guarding of {node}"),
            Some(Service::Lss(true)) => "LSS master".to_owned(),
            Some(Service::Lss(false)) => "LSS slave".to_owned(),
            Some(Service::Sdo(side, channel)) => {
                let server = self.channels.server(channel).unwrap_or(0);
                match side {
                    Side::Client => format!("SDO request to {server}"),
                    Side::Server => format!("SDO response of {server}"),
                }
            }
        }
    }

    /// Why it is not taken for CANopen; `None` where it is, or nothing speaks against it yet.
    pub fn doubt(&self) -> Option<String> {
        (self.belief.standing() == Standing::Doubted).then(|| self.belief.reason())
    }

    /// Bytes of its own, stores shared with checkpoints apart.
    pub fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.routes.footprint()
            + self.timers.footprint()
            + self.channels.footprint()
            + self.nodes.iter().map(Node::footprint).sum::<usize>()
    }

    /// Bytes of the nodes' stores.
    pub fn store_footprint(&self) -> usize {
        self.nodes.iter().map(|node| node.store().footprint()).sum()
    }

    /// The node with this node-ID, made if new.
    #[inline]
    pub(super) fn node_mut(&mut self, id: u8) -> Option<&mut Node> {
        let place = match *self.node_by_id.get(usize::from(id))? {
            0 => self.add_node(id)?,
            place => place,
        };
        self.nodes.get_mut(usize::from(place) - 1)
    }

    /// Makes a node; gives its place + 1.
    #[cold]
    fn add_node(&mut self, id: u8) -> Option<u8> {
        let place = u8::try_from(self.nodes.len() + 1).ok()?;
        let named = self.options.node_names.iter().find(|(named, _)| *named == id);
        let name = named.map(|(_, name)| name.as_str());
        let name = name.or_else(|| self.options.bus_file.name(&self.name, id));
        self.nodes.push(Node::new(id, name.map(Into::into)));
        *self.node_by_id.get_mut(usize::from(id))? = place;
        Some(place)
    }

    /// Gives a node another node-ID; the node that had it loses it. What was learnt of its identifiers
    /// stays with it, the defaults follow the node-ID.
    pub(super) fn move_node(&mut self, from: u8, to: u8) {
        let place = |bus: &Self, id: u8| bus.node_by_id.get(usize::from(id)).copied().unwrap_or(0);
        let (moved, replaced) = (place(self, from), place(self, to));
        for (place, id) in [(moved, to), (replaced, from)] {
            if let Some(node) = usize::from(place).checked_sub(1).and_then(|place| self.nodes.get_mut(place))
            {
                node.id = id;
            }
            if let Some(slot) = self.node_by_id.get_mut(usize::from(id)) {
                *slot = place;
            }
        }
        // The place of the node that was replaced is empty now, under the node-ID that became free.
        if let Some(node) = usize::from(replaced).checked_sub(1).and_then(|place| self.nodes.get_mut(place)) {
            *node = Node::new(from, None);
        }
        for (id, service) in self.routes.learnt() {
            let moved = match service {
                Service::Pdo(name, node) if node == from => Service::Pdo(name, to),
                Service::Emcy(node) if node == from => Service::Emcy(to),
                _ => continue,
            };
            self.routes.learn(id, moved);
        }
        // Deadlines are queued by node-ID.
        for id in [from, to] {
            self.timers.remove(Subject::Heartbeat(id));
        }
        let place = usize::from(moved).checked_sub(1);
        if let Some(heartbeat) =
            place.and_then(|place| self.nodes.get_mut(place)).map(|node| &mut node.heartbeat)
        {
            heartbeat.queued = heartbeat.deadline.is_some();
            if let Some(deadline) = heartbeat.deadline {
                self.timers.add(deadline, Subject::Heartbeat(to));
            }
        }
    }

    /// Takes the next frame.
    pub fn push(&mut self, frame: &Frame, out: &mut dyn Observer) {
        if let Some(stamp) = frame.time {
            self.tick(stamp, frame.number, out);
        }
        self.last_frame = frame.number;
        self.last_time = frame.time;
        if frame.flags.contains(FrameFlags::ERROR) {
            let kind = EventKind::CanError(error_frame::parse(frame.id.number(), frame.data()));
            return self.emit_can(frame, kind, out);
        }
        let Some(slot) = self.routes.find(frame.id).or_else(|| self.add_slot(frame, out)) else {
            return self.undecoded(frame, None, out);
        };
        let Some(service) = self.routes.slot(slot).map(|slot| slot.service) else { return };
        if frame.flags.contains(FrameFlags::FD) {
            return self.fd_frame(frame, service, out);
        }
        match service {
            Service::Pdo(name, node) => self.on_pdo(slot, name, node, frame, out),
            Service::Unclassified => self.undecoded(frame, None, out),
            Service::Named(name) => self.undecoded(frame, Some(name), out),
            _ => self.on_service(service, frame, out),
        }
    }

    /// The services that are not a PDO.
    fn on_service(&mut self, service: Service, frame: &Frame, out: &mut dyn Observer) {
        // Only PDOs and error control are asked for by remote frames (CiA 301 §7.2.2, §7.2.8.3.2.1).
        if frame.flags.contains(FrameFlags::REMOTE) && !matches!(service, Service::ErrorControl(_)) {
            return self.undecoded(frame, None, out);
        }
        match service {
            Service::Sync => self.on_sync(frame, out),
            Service::ErrorControl(node) => self.on_error_control(node, frame, out),
            Service::Sdo(side, channel) => self.on_sdo(side, channel, frame, out),
            Service::Emcy(node) => self.on_emcy(node, frame, out),
            Service::Nmt => self.on_nmt(frame, out),
            Service::Time => self.on_time(frame, out),
            Service::Lss(from_master) => self.on_lss(from_master, frame, out),
            Service::Pdo(..) | Service::Unclassified | Service::Named(_) => {}
        }
    }

    /// Nothing more comes: ends what is open.
    pub fn finish(&mut self, out: &mut dyn Observer) {
        self.finish_transfers(out);
        let (count, extended) = self.undecoded;
        if count > 0 {
            let frame = Frame { number: self.last_frame, time: self.last_time, ..Frame::EMPTY };
            let text = format!(
                "{count} frames belong to no known service ({extended} of them 29-bit): --frames prints them"
            );
            self.note(&frame, text, out);
        }
    }

    /// Lets time pass to `stamp` without a frame: a live bus that is quiet.
    pub fn advance(&mut self, stamp: Timestamp, out: &mut dyn Observer) {
        if self.clock.runs() {
            let number = self.last_frame;
            self.tick(stamp, number, out);
        }
    }

    #[inline]
    fn tick(&mut self, stamp: Timestamp, number: u64, out: &mut dyn Observer) {
        let advance = self.clock.advance(stamp);
        if advance.step.is_some() || advance.silence.is_some() {
            self.irregular(stamp, number, advance.step, advance.silence, out);
        }
        if self.timers.is_due(advance.now) {
            self.expire(advance.now, out);
        }
    }

    #[cold]
    fn irregular(
        &mut self,
        stamp: Timestamp,
        number: u64,
        step: Option<i64>,
        silence: Option<(i64, i64)>,
        out: &mut dyn Observer,
    ) {
        let event = |kind| Event {
            time: Some(stamp),
            bus: self.index,
            frames: FrameRange { first: self.last_frame, last: number },
            protocol: Protocol::Can,
            node: None,
            presumed: false,
            routine: false,
            kind,
        };
        if let Some(step) = step {
            out.event(&event(EventKind::ClockStep { step }), self);
        }
        if let Some((gap, limit)) = silence {
            // Deadlines before the bus fell silent stand; those within the silence are put off by it.
            let event = event(EventKind::BusSilent { gap });
            let fell_silent = self.clock.now().saturating_sub(gap).saturating_add(limit);
            self.expire(fell_silent, out);
            out.event(&event, self);
            self.silent_until = Some(self.clock.now());
            self.postpone(gap);
        }
    }

    /// Moves every deadline that is not over yet by `delay`.
    fn postpone(&mut self, delay: i64) {
        self.channels.postpone(delay);
        for node in &mut self.nodes {
            if let Some(deadline) = &mut node.heartbeat.deadline {
                *deadline = deadline.saturating_add(delay);
            }
        }
    }

    /// Handles every deadline before `now`.
    #[cold]
    fn expire(&mut self, now: i64, out: &mut dyn Observer) {
        while let Some((_, subject)) = self.timers.take_due(now) {
            match subject {
                Subject::SdoChannel(channel) => self.sdo_deadline(channel, now, out),
                Subject::Heartbeat(node) => self.heartbeat_deadline(node, now, out),
            }
        }
    }

    /// Finds out what an identifier means when its first frame comes.
    #[cold]
    fn add_slot(&mut self, frame: &Frame, out: &mut dyn Observer) -> Option<usize> {
        let service = match self.routes.origin(frame.id) {
            Origin::Learnt(service) => service,
            Origin::Default(owner) => self.service_of(owner),
        };
        let slot = self.routes.add(frame.id, service);
        if slot.is_none() && !std::mem::replace(&mut self.said.extended_full, true) {
            let kind = EventKind::Evicted { what: "29-bit identifiers kept apart", count: 1 };
            self.emit_can(frame, kind, out);
        }
        self.say_refused(frame, out);
        slot
    }

    /// Says that a channel or an identifier found no room.
    pub(super) fn say_refused(&mut self, frame: &Frame, out: &mut dyn Observer) {
        if self.channels.take_refused() {
            self.emit_can(frame, EventKind::Evicted { what: "SDO channel", count: 1 }, out);
        }
        if self.routes.take_refused() {
            self.emit_can(frame, EventKind::Evicted { what: "learnt identifier", count: 1 }, out);
        }
    }

    /// The service a default owner stands for, with its channel.
    pub(super) fn service_of(&mut self, owner: Owner) -> Service {
        match owner {
            Owner::Unclassified => Service::Unclassified,
            Owner::Named(name) => Service::Named(name),
            Owner::Nmt => Service::Nmt,
            Owner::Sync => Service::Sync,
            Owner::Time => Service::Time,
            Owner::Emcy(node) => Service::Emcy(node),
            Owner::Pdo(name, node) => Service::Pdo(name, node),
            Owner::Sdo(side, node) => match self.channels.default_channel(node) {
                Some(channel) => Service::Sdo(side, channel),
                None => Service::Unclassified,
            },
            Owner::ErrorControl(node) => Service::ErrorControl(node),
            Owner::Lss(from_master) => Service::Lss(from_master),
        }
    }

    /// CAN FD on CANopen identifiers is not decoded (CiA 1301 is another protocol).
    #[cold]
    fn fd_frame(&mut self, frame: &Frame, service: Service, out: &mut dyn Observer) {
        let is_owned = !matches!(service, Service::Unclassified | Service::Named(_));
        if is_owned && self.belief.is_believed() && !std::mem::replace(&mut self.said.fd, true) {
            self.note(frame, "CAN FD frames on CANopen identifiers are left undecoded".into(), out);
        }
        self.undecoded(frame, None, out);
    }

    /// A frame no service is decoded of.
    pub(super) fn undecoded(&mut self, frame: &Frame, name: Option<&'static str>, out: &mut dyn Observer) {
        let name = name.filter(|_| self.belief.is_believed());
        let (count, extended) = &mut self.undecoded;
        *count += 1;
        *extended += u64::from(matches!(frame.id, CanId::Extended(_)));
        let kind = EventKind::Frame(Box::new(Undecoded { frame: *frame, name }));
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
        if self.options.protocol == super::ProtocolChoice::Auto
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
        node: u8,
        routine: bool,
        kind: EventKind,
        out: &mut dyn Observer,
    ) {
        let mut event = self.event(frame, kind);
        event.node = (node != 0).then_some(node);
        event.routine = routine;
        out.event(&event, self);
    }

    /// Emits an event about the bus itself.
    fn emit_can(&self, frame: &Frame, kind: EventKind, out: &mut dyn Observer) {
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
        node: u8,
        error: Malformed,
        reason: &'static str,
        out: &mut dyn Observer,
    ) {
        self.emit(frame, node, false, EventKind::Malformed { error, reason }, out);
    }

    /// The identifiers of an SDO channel's two sides.
    pub(super) fn channel_ids(&self, channel: u16) -> Option<(CanId, CanId)> {
        self.channels.ids(channel)
    }

    /// Routes both identifiers of a channel.
    pub(super) fn route_channel(&mut self, channel: u16, request: CanId, response: CanId) {
        self.routes.learn(request, Service::Sdo(Side::Client, channel));
        self.routes.learn(response, Service::Sdo(Side::Server, channel));
    }
}
