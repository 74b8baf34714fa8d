//! One bus as observers see it: its clock, its nodes, what its identifiers mean.

use std::sync::Arc;

use super::cadence::Cadence;
use super::channels::SdoChannels;
use super::clock::Clock;
use super::gates::GateState;
use super::link::Pairs;
use super::node::Node;
use super::node_id_changes::NodeIdChanges;
use super::open_transfers::OpenTransfers;
use super::restart::RestartEvidence;
use super::routes::{Routes, Service};
use super::unnamed_uds::UnnamedUds;
use crate::frame::{BusIndex, CanId, Timestamp};
use crate::profile::dbc::{Database, Parameter};
use crate::profile::{Meaning, NothingKnown, Owner, Resolver, plain_device};
use crate::session::detection::{CanopenDetection, J1939Detection, ProtocolStatus};
use crate::session::options::SessionOptions;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::Side;
use crate::wire::j1939::{Name, Pgn};
use crate::wire::{NODE_PLACES, NodeId};

/// What is known of one bus. Machines change it, observers read it.
#[derive(Debug, Clone)]
pub struct Bus {
    pub(in crate::session) index: BusIndex,
    pub(in crate::session) name: Arc<str>,
    pub(in crate::session) options: Arc<SessionOptions>,
    /// Messages of the user's databases on this bus.
    pub(in crate::session) database: Arc<Database>,
    pub(in crate::session) canopen: CanopenDetection,
    pub(in crate::session) j1939: J1939Detection,
    pub(in crate::session) clock: Clock,
    pub(in crate::session) routes: Routes,
    pub(in crate::session) channels: SdoChannels,
    /// UDS servers of the bus file.
    pub(in crate::session) uds_pairs: Arc<Pairs>,
    pub(in crate::session) nodes: Vec<Node>,
    /// Place in `nodes` + 1 by [`NodeId::place`], 0 = none.
    pub(in crate::session) node_by_id: Box<[u16; NODE_PLACES]>,
    pub(in crate::session) restarts: RestartEvidence,
    pub(in crate::session) node_id_changes: NodeIdChanges,
    pub(in crate::session) open_transfers: OpenTransfers,
    /// Identifier of the SYNC received last.
    pub(in crate::session) last_sync: Option<CanId>,
    /// A UDS request was answered.
    pub(in crate::session) is_uds: bool,
    /// UDS between identifiers that the bus file does not name.
    pub(in crate::session) unnamed: UnnamedUds,
    /// Frames left undecoded, and those of 29 bits among them.
    pub(in crate::session) undecoded: (u64, u64),
    /// Last frame and its timestamp.
    pub(in crate::session) last_frame: u64,
    pub(in crate::session) last_time: Option<Timestamp>,
    /// Bit rate as recorded, in bit/s.
    pub(in crate::session) recorded_bit_rate: Option<u32>,
}

impl Bus {
    /// A bus of which nothing was seen.
    pub(in crate::session) fn new(index: BusIndex, name: &str, options: Arc<SessionOptions>) -> Self {
        Self {
            index,
            name: name.into(),
            database: options.database(name),
            canopen: CanopenDetection::new(options.protocol),
            j1939: J1939Detection::new(options.protocol),
            options,
            clock: Clock::default(),
            routes: Routes::default(),
            channels: SdoChannels::default(),
            uds_pairs: Arc::default(),
            nodes: Vec::new(),
            node_by_id: Box::new([0; NODE_PLACES]),
            restarts: RestartEvidence::default(),
            node_id_changes: NodeIdChanges::default(),
            open_transfers: OpenTransfers::default(),
            last_sync: None,
            is_uds: false,
            unnamed: UnnamedUds::default(),
            undecoded: (0, 0),
            last_frame: 0,
            last_time: None,
            recorded_bit_rate: None,
        }
    }

    /// Name of the interface.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name the user gave to whoever commands its nodes.
    pub fn master_name(&self) -> Option<&str> {
        self.options.bus_file.master(&self.name)
    }

    /// Index within the capture.
    pub fn index(&self) -> BusIndex {
        self.index
    }

    /// Monotonic time in nanoseconds: that of the last frame; 0 where the capture has no times.
    pub fn now(&self) -> i64 {
        self.clock.now()
    }

    /// A stamp of the capture as monotonic time, not beyond [`Bus::now`].
    pub fn monotonic(&self, stamp: Timestamp) -> i64 {
        self.clock.monotonic(stamp)
    }

    /// A monotonic time as a stamp of the capture; `None` where it has no times.
    pub fn stamp_of(&self, time: i64) -> Option<Timestamp> {
        self.clock.stamp_of(time)
    }

    /// How long all traffic may stop before the bus counts as silent, in nanoseconds; none until the pattern of its
    /// periodic messages is known.
    pub fn silence_limit(&self) -> Option<i64> {
        self.clock.silence_limit()
    }

    /// Number of the last frame of this bus; 0 before the first.
    pub fn last_frame(&self) -> u64 {
        self.last_frame
    }

    /// Whether the traffic is believed to be CANopen.
    pub fn is_canopen(&self) -> bool {
        self.canopen.is_confirmed()
    }

    /// Whether the 29-bit frames are believed to be J1939.
    pub fn is_j1939(&self) -> bool {
        self.j1939.is_confirmed()
    }

    /// Whether an address is in the middle of a transfer of several packets that can be about a group.
    pub fn is_transferring(&self, source: u8, pgn: Pgn) -> bool {
        self.open_transfers.contains(source, pgn)
    }

    /// Name and unit of a suspect parameter, by the user's databases.
    pub fn parameter(&self, spn: u32) -> Option<&Parameter> {
        self.database.parameter(spn)
    }

    /// The node with this number now; a bare number is a CANopen node-ID.
    pub fn node(&self, id: impl Into<NodeId>) -> Option<&Node> {
        let place = *self.node_by_id.get(id.into().place())?;
        self.nodes.get(usize::from(place.checked_sub(1)?))
    }

    /// All nodes in order of their numbers, CANopen first.
    pub fn nodes(&self) -> impl Iterator<Item = &Node> {
        NodeId::all().filter_map(|id| self.node(id))
    }

    /// All gates of all set points of a node that were seen, closed ones first.
    pub fn gates(&self, node: impl Into<NodeId>) -> Vec<GateState> {
        self.node(node).map_or_else(Vec::new, |node| node.gates(self.clock.now()))
    }

    /// Of a J1939 message that a device waits for: that device, and the nanoseconds its manual gives.
    pub fn awaited(&self, id: CanId) -> Option<(NodeId, i64)> {
        let slot = self.routes.find(id).and_then(|slot| self.routes.slot(slot))?;
        slot.cadence.as_deref().map(Cadence::limit)
    }

    /// What an object of a node means now; of one never heard what CiA 301 says.
    pub(in crate::session) fn meaning(&self, id: NodeId, object: ObjectAddress) -> Option<Meaning> {
        match self.node(id) {
            Some(node) => node.meaning(object),
            None => Resolver::new(&plain_device().dictionary, &NothingKnown).meaning(object),
        }
    }

    /// Identifier of the SYNC that came last.
    pub fn last_sync(&self) -> Option<CanId> {
        self.last_sync
    }

    /// Why it is not taken for CANopen; `None` where it is, or nothing speaks against it yet.
    pub fn doubt(&self) -> Option<String> {
        (self.canopen.status() == ProtocolStatus::Rejected).then(|| self.canopen.reason())
    }

    /// Whether a request of UDS was answered on it.
    pub fn is_uds(&self) -> bool {
        self.is_uds
    }

    /// What a user may tell of identifiers that nobody explained, where their frames look like UDS.
    pub fn unnamed_uds(&self) -> Option<String> {
        self.unnamed.hint()
    }

    /// Bytes of its own, stores shared with checkpoints apart.
    pub fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.routes.footprint()
            + self.channels.footprint()
            + self.open_transfers.footprint()
            + self.nodes.iter().map(Node::footprint).sum::<usize>()
    }

    /// The node with this number, made if new.
    #[inline]
    pub(in crate::session) fn node_mut(&mut self, id: NodeId) -> Option<&mut Node> {
        let place = match *self.node_by_id.get(id.place())? {
            0 => self.add_node(id)?,
            place => place,
        };
        self.nodes.get_mut(usize::from(place) - 1)
    }

    /// Makes a node; gives its place + 1.
    #[cold]
    fn add_node(&mut self, id: NodeId) -> Option<u16> {
        let place = u16::try_from(self.nodes.len() + 1).ok()?;
        let name = self.given_name(id);
        self.nodes.push(Node::new(id, name));
        *self.node_by_id.get_mut(id.place())? = place;
        Some(place)
    }

    /// Name the user gave to a number.
    pub(in crate::session) fn given_name(&self, id: NodeId) -> Option<Arc<str>> {
        let named = self.options.node_names.iter().find(|(named, _)| *named == id);
        let name = named.map(|(_, name)| name.as_str());
        name.or_else(|| self.options.bus_file.name(&self.name, id)).map(Into::into)
    }

    /// The service of a default owner, with its channel.
    pub(in crate::session) fn service_of(&mut self, owner: Owner) -> Service {
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

    /// The identifiers of an SDO channel's two sides.
    pub(in crate::session) fn channel_ids(&self, channel: u16) -> Option<(CanId, CanId)> {
        self.channels.ids(channel)
    }

    /// Routes both identifiers of a channel.
    pub(in crate::session) fn route_channel(&mut self, channel: u16, request: CanId, response: CanId) {
        self.routes.learn(request, Service::Sdo(Side::Client, channel));
        self.routes.learn(response, Service::Sdo(Side::Server, channel));
    }

    /// Bit rate in bit/s: from the bus file, else as recorded.
    pub fn bit_rate(&self) -> Option<u32> {
        self.options.bus_file.bit_rate(&self.name).or(self.recorded_bit_rate)
    }

    /// A number in the store of a node.
    pub(in crate::session) fn object_number(&self, id: NodeId, address: ObjectAddress) -> Option<u64> {
        self.node(id)?.store().number(address)
    }

    /// What an identifier is where nothing was learnt of it.
    pub(in crate::session) fn default_service(&mut self, id: CanId) -> Service {
        let CanId::Standard(id) = id else { return Service::Unclassified };
        let owner = crate::profile::connection_set().owner(id);
        self.service_of(owner)
    }

    /// Address of the device with a NAME.
    pub(in crate::session) fn address_of(&self, name: Name) -> Option<u8> {
        self.nodes.iter().find(|node| node.j1939_name() == Some(name)).and_then(|node| node.id().j1939())
    }
}
