//! One bus: its clock, its routes, its nodes, and the way of a frame through them.

use std::sync::Arc;

use super::belief::Belief;
use super::canopen::{Channels, LssState, SyncState};
use super::clock::Clock;
use super::device::Restart;
use super::j1939::{Claims, J1939Belief, Transports};
use super::node::Node;
use super::routes::{Origin, Routes, Service};
use super::timers::Timers;
use super::uds::{UdsState, Unnamed};
use super::{Observer, SessionOptions};
use crate::event::EventKind;
use crate::frame::{BusIndex, CanId, Frame, FrameFlags, Timestamp};
use crate::profile::Owner;
use crate::profile::dbc::Database;
use crate::wire::canopen::sdo::Side;
use crate::wire::error_frame;
use crate::wire::{NODE_PLACES, NodeId};
use crate::words::plural;

/// Everything remembered about one bus. A clone is a checkpoint.
#[derive(Debug, Clone)]
pub struct Bus {
    pub(super) index: BusIndex,
    pub(super) name: Arc<str>,
    pub(super) options: Arc<SessionOptions>,
    /// What the user's databases tell of this bus.
    pub(super) database: Arc<Database>,
    pub(super) belief: Belief,
    pub(super) j1939: J1939Belief,
    pub(super) claims: Claims,
    pub(super) clock: Clock,
    pub(super) timers: Timers,
    pub(super) routes: Routes,
    pub(super) nodes: Vec<Node>,
    /// Place in `nodes` + 1 by [`NodeId::place`], 0 = none.
    pub(super) node_by_id: Box<[u16; NODE_PLACES]>,
    pub(super) channels: Channels,
    pub(super) transports: Transports,
    pub(super) sync: SyncState,
    pub(super) lss: LssState,
    pub(super) uds: UdsState,
    /// What speaks for UDS that nobody named.
    pub(super) unnamed: Unnamed,
    pub(super) said: Said,
    /// Frame of the last reset of all nodes: it also means those that were not heard yet.
    pub(super) reset_all: Option<(u64, Restart)>,
    /// Last boot-up that nobody commanded: monotonic time and node-ID.
    pub(super) last_boot: Option<(i64, NodeId)>,
    /// Monotonic time at which the last silence of the bus ended.
    pub(super) silent_until: Option<i64>,
    /// Frames left undecoded, and those of 29 bits among them.
    pub(super) undecoded: (u64, u64),
    /// Last frame seen and its stamp.
    pub(super) last_frame: u64,
    pub(super) last_time: Option<Timestamp>,
    /// Bit rate the recorder told, in bit/s.
    pub(super) told_rate: Option<u32>,
}

/// What is said once a bus.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Said {
    pub(super) doubted: bool,
    pub(super) presumed: bool,
    pub(super) fd: bool,
    pub(super) extended_full: bool,
    pub(super) fast_packets: bool,
    pub(super) made_up: bool,
}

impl Bus {
    /// A bus nothing is known of.
    pub fn new(index: BusIndex, name: &str, options: Arc<SessionOptions>) -> Self {
        let mut bus = Self {
            index,
            name: name.into(),
            belief: Belief::new(options.protocol),
            j1939: J1939Belief::new(options.protocol),
            database: options.database(name),
            options,
            claims: Claims::default(),
            clock: Clock::default(),
            timers: Timers::default(),
            routes: Routes::default(),
            nodes: Vec::new(),
            node_by_id: Box::new([0; NODE_PLACES]),
            channels: Channels::default(),
            transports: Transports::default(),
            sync: SyncState::default(),
            lss: LssState::default(),
            uds: UdsState::default(),
            unnamed: Unnamed::default(),
            said: Said::default(),
            reset_all: None,
            last_boot: None,
            silent_until: None,
            undecoded: (0, 0),
            last_frame: 0,
            last_time: None,
            told_rate: None,
        };
        bus.take_given();
        bus
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
            return self.unslotted(frame, out);
        };
        let Some(service) = self.routes.slot(slot).map(|slot| slot.service) else { return };
        if frame.flags.contains(FrameFlags::FD) && !matches!(service, Service::IsoTp(_)) {
            return self.fd_frame(frame, service, out);
        }
        match service {
            Service::Pdo(name, node) => self.on_pdo(slot, name, node, frame, out),
            Service::J1939(id) => self.on_j1939(Some(slot), id, frame, out),
            Service::Unclassified => self.undecoded(frame, None, out),
            Service::Named(name) => self.undecoded(frame, Some(name), out),
            _ => self.on_service(service, frame, out),
        }
    }

    /// A frame of an identifier that is not kept apart: too many were seen.
    #[cold]
    fn unslotted(&mut self, frame: &Frame, out: &mut dyn Observer) {
        match self.routes.origin(frame.id) {
            Origin::J1939(id) if !frame.flags.contains(FrameFlags::FD) => {
                self.on_j1939(None, id, frame, out);
            }
            _ => self.undecoded(frame, None, out),
        }
    }

    /// The services that are neither PDO nor J1939.
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
            Service::TestMarker => self.on_test_marker(frame, out),
            Service::IsoTp(link) => self.on_isotp(link, frame, out),
            Service::Pdo(..) | Service::J1939(_) | Service::Unclassified | Service::Named(_) => {}
        }
    }

    /// Nothing more comes: ends what is open.
    pub fn finish(&mut self, out: &mut dyn Observer) {
        self.finish_transfers(out);
        self.finish_transports(out);
        self.finish_messages(out);
        self.finish_uds(out);
        let (count, extended) = self.undecoded;
        if count > 0 {
            let frame = Frame { number: self.last_frame, time: self.last_time, ..Frame::EMPTY };
            let frames = plural(count, "frame");
            let text =
                format!("{frames} of no known service ({extended} of them 29-bit): --frames prints them");
            self.note(&frame, text, out);
            if let Some(hint) = self.unnamed.hint() {
                self.note(&frame, hint, out);
            }
        }
    }

    /// Lets time pass to `stamp` without a frame: a live bus that is quiet.
    pub fn advance(&mut self, stamp: Timestamp, out: &mut dyn Observer) {
        if self.clock.runs() {
            self.pass(stamp, out);
        }
    }

    /// Finds out what an identifier means when its first frame comes.
    #[cold]
    fn add_slot(&mut self, frame: &Frame, out: &mut dyn Observer) -> Option<usize> {
        let service = match self.routes.origin(frame.id) {
            Origin::Learnt(service) => service,
            Origin::Default(owner) => self.service_of(owner),
            Origin::J1939(id) => Service::J1939(id),
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
            Owner::Emcy(node) => Service::Emcy(node.into()),
            Owner::Pdo(name, node) => Service::Pdo(name, node.into()),
            Owner::Sdo(side, node) => match self.channels.default_channel(node) {
                Some(channel) => Service::Sdo(side, channel),
                None => Service::Unclassified,
            },
            Owner::ErrorControl(node) => Service::ErrorControl(node.into()),
            Owner::Lss(from_master) => Service::Lss(from_master),
            Owner::TestMarker => Service::TestMarker,
        }
    }

    /// CAN FD on CANopen and J1939 identifiers is not decoded (CiA 1301 and J1939-22 are other protocols).
    #[cold]
    fn fd_frame(&mut self, frame: &Frame, service: Service, out: &mut dyn Observer) {
        let owner = match service {
            Service::Unclassified | Service::Named(_) => None,
            // J1939-22 puts other things into such frames.
            Service::J1939(_) => self.j1939.is_believed().then_some("J1939"),
            _ => self.belief.is_believed().then_some("CANopen"),
        };
        if let Some(owner) = owner.filter(|_| !std::mem::replace(&mut self.said.fd, true)) {
            self.note(frame, format!("CAN FD frames on {owner} identifiers are left undecoded"), out);
        }
        self.undecoded(frame, None, out);
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
