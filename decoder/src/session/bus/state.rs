//! State of one bus for observers: clock, nodes, meaning of identifiers.

use std::sync::Arc;

use super::hints::{SdoDialogues, SdoPairHint, UdsPairHint, UdsSuspects};
use super::identifiers::{IdentifierRoutes, IdentifierService, PdoUsers, SdoChannels, UdsPairs, shared_gap};
use super::nodes::{GateState, NamedNodes, Node, NodeIdChanges, PendingNodeId, RestartEvidence};
use super::omissions::OmittedFrames;
use super::open_transfers::OpenTransfers;
use super::time::{AmbiguousGap, BusClock, Cadence};
use crate::event::FrameRange;
use crate::frame::{BusIndex, CanId, Timestamp};
use crate::profile::dbc::{Database, SuspectParameter};
use crate::profile::{
    Catalogue, EntryResolver, IdentifierOwner, NoValues, ObjectMeaning, is_fast_packet, plain_device,
};
use crate::session::detection::{CanopenDetection, J1939Detection, ProtocolStatus};
use crate::session::options::{ProtocolChoice, SessionOptions};
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::SdoSide;
use crate::wire::j1939::{J1939Name, Pgn};
use crate::wire::{NODE_PLACES, NodeId};

/// State of one bus. Machines change it, observers read it.
#[derive(Debug, Clone)]
pub struct Bus {
    pub(in crate::session) index: BusIndex,
    pub(in crate::session) name: Arc<str>,
    pub(in crate::session) options: Arc<SessionOptions>,
    /// Messages of the user's databases for this bus.
    pub(in crate::session) database: Arc<Database>,
    pub(in crate::session) protocol: ProtocolChoice,
    pub(in crate::session) canopen: CanopenDetection,
    pub(in crate::session) j1939: J1939Detection,
    /// Nodes whose protocol is settled.
    pub(in crate::session) named: NamedNodes,
    /// Frames that are not decoded, by reason.
    pub(in crate::session) omissions: OmittedFrames,
    pub(in crate::session) clock: BusClock,
    pub(in crate::session) routes: IdentifierRoutes,
    pub(in crate::session) channels: SdoChannels,
    /// UDS servers in the bus file.
    pub(in crate::session) uds_pairs: Arc<UdsPairs>,
    pub(in crate::session) nodes: Vec<Node>,
    /// Index in `nodes` + 1, by [`NodeId::table_place`]; 0 = no node.
    pub(in crate::session) node_by_id: Box<[u16; NODE_PLACES]>,
    pub(in crate::session) restarts: RestartEvidence,
    pub(in crate::session) node_id_changes: NodeIdChanges,
    pub(in crate::session) open_transfers: OpenTransfers,
    pub(in crate::session) pdo_users: PdoUsers,
    /// Whether the frames on the identifier of TIME are not a clock.
    pub(in crate::session) is_time_rejected: bool,
    /// Identifier of the SYNC received last.
    pub(in crate::session) last_sync: Option<CanId>,
    /// At least one UDS request received a response.
    pub(in crate::session) is_uds: bool,
    /// States of nodes in the bus file are not reported yet.
    pub(in crate::session) has_given_states: bool,
    /// A group of NMEA 2000 was received.
    pub(in crate::session) is_nmea2000: bool,
    /// Index of the identifier whose PDO or message is being sent to the observer.
    pub(in crate::session) current_identifier: Option<usize>,
    /// UDS traffic between identifiers missing from the bus file.
    pub(in crate::session) unnamed: UdsSuspects,
    /// SDO-like dialogues on identifiers of no channel.
    pub(in crate::session) dialogues: SdoDialogues,
    /// Number of undecoded frames, and of those with 29-bit identifiers.
    pub(in crate::session) undecoded: (u64, u64),
    /// Last frame; its timestamp is `last_time`.
    pub(in crate::session) last_frame: u64,
    pub(in crate::session) ambiguous_gap: Option<AmbiguousGap>,
    pub(in crate::session) last_time: Option<Timestamp>,
    /// Bit rate stated in the capture, in bit/s.
    pub(in crate::session) recorded_bit_rate: Option<u32>,
}

impl Bus {
    /// State of a bus before its first frame.
    pub(in crate::session) fn new(index: BusIndex, name: &str, options: Arc<SessionOptions>) -> Self {
        let protocol = options.protocol_of(name);
        Self {
            index,
            name: name.into(),
            database: options.database(name),
            protocol,
            canopen: CanopenDetection::new(protocol),
            j1939: J1939Detection::new(protocol),
            named: NamedNodes::default(),
            omissions: OmittedFrames::default(),
            options,
            clock: BusClock::default(),
            routes: IdentifierRoutes::default(),
            channels: SdoChannels::default(),
            uds_pairs: Arc::default(),
            nodes: Vec::new(),
            node_by_id: Box::new([0; NODE_PLACES]),
            restarts: RestartEvidence::default(),
            node_id_changes: NodeIdChanges::default(),
            open_transfers: OpenTransfers::default(),
            pdo_users: PdoUsers::default(),
            is_time_rejected: false,
            last_sync: None,
            is_uds: false,
            has_given_states: false,
            is_nmea2000: false,
            current_identifier: None,
            unnamed: UdsSuspects::default(),
            dialogues: SdoDialogues::default(),
            undecoded: (0, 0),
            last_frame: 0,
            ambiguous_gap: None,
            last_time: None,
            recorded_bit_rate: None,
        }
    }

    /// Profiles of the caller.
    pub fn catalogue(&self) -> &Catalogue {
        &self.options.catalogue
    }

    /// Name of the interface.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Name from the user for the NMT master.
    pub fn master_name(&self) -> Option<&str> {
        self.options.bus_file.master(&self.name)
    }

    /// Index of the bus within the capture.
    pub fn index(&self) -> BusIndex {
        self.index
    }

    /// Monotonic time of the last frame in ns; 0 if the capture has no timestamps.
    pub fn now(&self) -> i64 {
        self.clock.now()
    }

    /// Converts a timestamp to monotonic time, at most [`Bus::now`].
    pub fn monotonic(&self, stamp: Timestamp) -> i64 {
        self.clock.monotonic(stamp)
    }

    /// Converts monotonic time to a timestamp of the capture; `None` if it has no timestamps.
    pub fn stamp_of(&self, time: i64) -> Option<Timestamp> {
        self.clock.stamp_of(time)
    }

    /// Time without traffic after which the bus is silent as a whole, in ns: at least three periodic producers have missed
    /// all their messages. `None` if there are fewer.
    pub fn silence_limit(&self) -> Option<i64> {
        let received = self.clock.last_frame_time();
        Some(self.shared_gap(received)?.max(self.clock.usual_gap()))
    }

    /// Time in ns after `received`, the monotonic time of a frame, at which at least three periodic producers have missed all
    /// their messages, if no frame follows.
    pub(in crate::session) fn shared_gap(&self, received: i64) -> Option<i64> {
        shared_gap(self.routes.pulses(), received).map(|due| due.saturating_sub(received))
    }

    /// Frame before an unusual gap in the traffic that contains a time, or that evidence spans, and that is no hole for
    /// certain: fewer than three periodic producers are missing.
    pub(crate) fn ambiguous_gap(&self, time: Option<Timestamp>, evidence: FrameRange) -> Option<u64> {
        let time = time.map(|time| self.monotonic(time));
        let past = self.ambiguous_gap.filter(|gap| evidence.first <= gap.frames.first).filter(|gap| {
            let (start, end) = gap.times;
            let is_within = |time: i64| time <= end && time.saturating_sub(start) > gap.limit;
            evidence.last >= gap.frames.last || time.is_some_and(is_within)
        });
        // On a live bus, the next frame is not there yet.
        let start = self.clock.last_frame_time();
        let is_quiet = time.is_some_and(|time| time.saturating_sub(start) > self.clock.usual_gap());
        let present = || (is_quiet && self.silence_limit().is_none()).then_some(self.last_frame);
        past.map(|gap| gap.frames.first).or_else(present)
    }

    /// Time of the last frame, if it had one.
    pub(crate) fn last_time(&self) -> Option<Timestamp> {
        self.last_time
    }

    /// Number of the last frame of this bus; 0 before the first.
    pub fn last_frame(&self) -> u64 {
        self.last_frame
    }

    /// Whether the traffic is confirmed as CANopen, or contains a node that the user named.
    pub fn is_canopen(&self) -> bool {
        self.canopen.is_confirmed() || self.named.has_canopen()
    }

    /// Whether messages were decoded as CANopen although nothing confirms that the bus uses it.
    pub fn is_canopen_presumed(&self) -> bool {
        self.canopen.is_presumed() && !self.named.has_canopen()
    }

    /// Whether the 29-bit frames are confirmed as J1939, or contain an address that the user named.
    pub fn is_j1939(&self) -> bool {
        self.j1939.is_confirmed() || self.named.has_j1939()
    }

    /// Whether the protocol of a node is confirmed by evidence or by the user; without a node, that of the CANopen
    /// services of the whole bus.
    pub fn is_settled(&self, node: Option<NodeId>) -> bool {
        match node {
            Some(id @ NodeId::J1939(_)) => self.j1939.is_confirmed() || self.named.contains(id),
            Some(id) => self.canopen.is_confirmed() || self.named.contains(id),
            None => self.is_canopen(),
        }
    }

    /// Whether CANopen was rejected; only nodes that the user named are decoded.
    pub fn is_canopen_rejected(&self) -> bool {
        self.canopen.protocol_status() == ProtocolStatus::Rejected
    }

    /// Whether the events of a node, or of the CANopen services of the bus, were withdrawn: the traffic proved not to
    /// be CANopen, and nobody named the node.
    pub fn is_withdrawn(&self, node: Option<NodeId>) -> bool {
        let is_canopen = node.is_none_or(|id| id.canopen().is_some());
        is_canopen && self.is_canopen_rejected() && !self.is_settled(node)
    }

    /// Whether TIME events were withdrawn, because their identifier proved not to be a clock.
    pub fn is_time_withdrawn(&self) -> bool {
        self.is_time_rejected || self.is_withdrawn(None)
    }

    /// Limits of decoding on this bus, one text per reason: number of frames, reason, and the option to change it.
    pub fn limit_texts(&self) -> Vec<String> {
        let canopen = self.rejection_reason();
        let mut texts =
            self.omissions.omission_texts(canopen.as_deref(), self.j1939.rejection_reason().as_deref());
        // If CANopen was detected later, the frame is a single wrong one.
        let contradiction = self.named.contradiction().filter(|_| !self.canopen.is_confirmed());
        texts.extend(contradiction.map(str::to_owned));
        texts
    }

    /// Number of frames of no known service that no database describes, without those of [`Self::limit_texts`].
    pub fn unknown_frames(&self) -> u64 {
        self.undecoded.0.saturating_sub(self.omissions.undecoded_count())
    }

    /// Whether `source` has an open multi-packet transfer that may be about `pgn`.
    pub fn is_transferring(&self, source: u8, pgn: Pgn) -> bool {
        self.open_transfers.contains(source, pgn)
    }

    /// Name and unit of a suspect parameter, from the user's databases.
    pub fn suspect_parameter(&self, spn: u32) -> Option<&SuspectParameter> {
        self.database.parameter_by_spn(spn)
    }

    /// Node with this node-ID or address; a plain number is a CANopen node-ID.
    pub fn node(&self, id: impl Into<NodeId>) -> Option<&Node> {
        self.node_at(id.into().table_place())
    }

    /// Node with this node-ID; if it has no frame, the node that had it before a change of its node-ID.
    pub fn present_or_former(&self, id: NodeId) -> Option<&Node> {
        let present = self.node(id);
        let former = || self.nodes.iter().find(|node| node.previous_id == Some(id));
        present.filter(|node| node.last_frame > 0).or_else(former).or(present)
    }

    /// All nodes in ascending order, CANopen first.
    pub fn nodes(&self) -> impl Iterator<Item = &Node> {
        NodeId::all_ids().filter_map(|id| self.node(id))
    }

    /// All gates of all set points of a node received so far, closed ones first.
    pub fn gates(&self, node: impl Into<NodeId>) -> Vec<GateState> {
        self.node(node)
            .map_or_else(Vec::new, |node| node.all_gates(self.clock.now(), |id| self.consumers_text(id)))
    }

    /// Device that must receive a J1939 message within a time, and the time from its manual, in ns.
    pub fn awaited_message(&self, id: CanId) -> Option<(NodeId, i64)> {
        let slot = self.routes.find_slot(id).and_then(|slot| self.routes.slot(slot))?;
        slot.cadence.as_deref().map(Cadence::max_interval)
    }

    /// Present meaning of an object of a node; as in CiA 301 for an unknown node.
    pub(in crate::session) fn meaning(&self, id: NodeId, object: ObjectAddress) -> Option<ObjectMeaning> {
        match self.node(id) {
            Some(node) => node.meaning(object),
            None => EntryResolver::new(&plain_device().dictionary, &NoValues).resolve_meaning(object),
        }
    }

    /// Identifier of the last SYNC.
    pub fn last_sync(&self) -> Option<CanId> {
        self.last_sync
    }

    /// Reason why the bus was not detected as CANopen; `None` if it was, if nothing contradicts CANopen, or if a node
    /// that the user named is present.
    pub fn detection_doubt(&self) -> Option<String> {
        self.rejection_reason().filter(|_| !self.named.has_canopen())
    }

    /// Reason why identifiers of nodes that nobody named are not decoded as CANopen.
    pub(in crate::session) fn rejection_reason(&self) -> Option<String> {
        (self.canopen.protocol_status() == ProtocolStatus::Rejected).then(|| self.canopen.rejection_reason())
    }

    /// Whether at least one UDS request received a response.
    pub fn is_uds(&self) -> bool {
        self.is_uds
    }

    /// Whether frames of a group are parts of fast packets.
    #[inline]
    pub(in crate::session) fn sends_fast_packets(&self, pgn: Pgn) -> bool {
        /// Last group of data page 0; no fast packet is on it.
        const LAST_OF_PAGE_0: u32 = 0xFFFF;
        pgn.number() > LAST_OF_PAGE_0 && is_fast_packet(pgn, self.is_nmea2000)
    }

    /// Pairs of identifiers that look like UDS and are missing from the bus file.
    pub fn unnamed_uds(&self) -> Vec<UdsPairHint> {
        self.unnamed.pair_hints()
    }

    /// Pairs of identifiers without a channel that exchange messages like SDO client and server.
    pub fn sdo_dialogues(&self) -> Vec<SdoPairHint> {
        self.dialogues.pair_hints()
    }

    /// Bytes held, without stores shared with checkpoints.
    pub fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.routes.footprint()
            + self.channels.footprint()
            + self.open_transfers.footprint()
            + self.nodes.iter().map(Node::footprint).sum::<usize>()
    }

    /// Node with this node-ID or address, created on first use.
    #[inline]
    pub(in crate::session) fn node_mut(&mut self, id: NodeId) -> Option<&mut Node> {
        let place = match *self.node_by_id.get(id.table_place())? {
            0 => self.add_node(id)?,
            place => place,
        };
        self.nodes.get_mut(usize::from(place) - 1)
    }

    /// Node with this node-ID or address, if it exists.
    #[inline]
    pub(in crate::session) fn known_node_mut(&mut self, id: NodeId) -> Option<&mut Node> {
        self.node_at_mut(id.table_place())
    }

    /// Node by the index of its node-ID in tables by node, if it exists.
    #[inline]
    pub(in crate::session) fn node_at(&self, place: usize) -> Option<&Node> {
        let index = *self.node_by_id.get(place)?;
        self.nodes.get(usize::from(index).checked_sub(1)?)
    }

    /// The same, mutable.
    #[inline]
    pub(in crate::session) fn node_at_mut(&mut self, place: usize) -> Option<&mut Node> {
        let index = *self.node_by_id.get(place)?;
        self.nodes.get_mut(usize::from(index).checked_sub(1)?)
    }

    /// Creates a node; returns its index + 1.
    #[cold]
    fn add_node(&mut self, id: NodeId) -> Option<u16> {
        let place = u16::try_from(self.nodes.len() + 1).ok()?;
        let name = self.given_name(id);
        self.nodes.push(Node::new(id, name));
        *self.node_by_id.get_mut(id.table_place())? = place;
        Some(place)
    }

    /// Name from the user for a node-ID or address.
    pub(in crate::session) fn given_name(&self, id: NodeId) -> Option<Arc<str>> {
        let named = self.options.node_names.iter().find(|(named, _)| *named == id);
        let name = named.map(|(_, name)| name.as_str());
        name.or_else(|| self.options.bus_file.name(&self.name, id)).map(Into::into)
    }

    /// Service of a default owner; creates its SDO channel if needed.
    pub(in crate::session) fn service_of(&mut self, owner: IdentifierOwner) -> IdentifierService {
        match owner {
            IdentifierOwner::Unclassified => IdentifierService::Unclassified,
            IdentifierOwner::Named(name) => IdentifierService::Named(name),
            IdentifierOwner::Nmt => IdentifierService::Nmt,
            IdentifierOwner::Sync => IdentifierService::Sync,
            IdentifierOwner::Time => IdentifierService::Time,
            IdentifierOwner::Emcy(node) => IdentifierService::Emcy(node.into()),
            IdentifierOwner::Pdo(name, node) if self.is_sent_elsewhere(name, node.into()) => {
                IdentifierService::Unclassified
            }
            IdentifierOwner::Pdo(name, node) => IdentifierService::Pdo(name, node.into()),
            IdentifierOwner::Sdo(side, node) => match self.channels.default_channel(node) {
                Some(channel) => IdentifierService::Sdo(side, channel),
                None => IdentifierService::Unclassified,
            },
            IdentifierOwner::ErrorControl(node) => IdentifierService::ErrorControl(node.into()),
            IdentifierOwner::Lss(from_master) => IdentifierService::Lss(from_master),
            IdentifierOwner::TestMarker => IdentifierService::TestMarker,
        }
    }

    /// Identifiers of request and response of an SDO channel.
    pub(in crate::session) fn channel_ids(&self, channel: u16) -> Option<(CanId, CanId)> {
        self.channels.channel_ids(channel)
    }

    /// Routes both identifiers of a channel.
    pub(in crate::session) fn route_channel(&mut self, channel: u16, request: CanId, response: CanId) {
        self.routes.learn_service(request, IdentifierService::Sdo(SdoSide::Client, channel));
        self.routes.learn_service(response, IdentifierService::Sdo(SdoSide::Server, channel));
    }

    /// Bit rate in bit/s, from the bus file, otherwise from the capture.
    pub fn bit_rate(&self) -> Option<u32> {
        self.options.bus_file.bit_rate(&self.name).or(self.recorded_bit_rate)
    }

    /// Time in ns after which an SDO request without a response has timed out.
    pub(crate) fn sdo_silence(&self) -> i64 {
        self.options.sdo_silence
    }

    /// Number in the object store of a node.
    pub(in crate::session) fn object_number(&self, id: NodeId, address: ObjectAddress) -> Option<u64> {
        self.node(id)?.store().number(address)
    }

    /// Service of an 11-bit identifier in the predefined connection set.
    pub(in crate::session) fn default_service(&mut self, id: CanId) -> IdentifierService {
        let CanId::Standard(id) = id else { return IdentifierService::Unclassified };
        let owner = crate::profile::connection_set().owner_of(id);
        self.service_of(owner)
    }

    /// Address of the device with a NAME.
    pub(in crate::session) fn address_of(&self, name: J1939Name) -> Option<u8> {
        self.nodes.iter().find(|node| node.j1939_name() == Some(name)).and_then(|node| node.id().j1939())
    }

    /// New node-ID that a node accepted and that its present restart activates; at the boot sign of the node.
    pub fn pending_node_id(&self, id: NodeId) -> Option<PendingNodeId> {
        self.node_id_changes.pending_change(self.node(id)?)
    }
}
