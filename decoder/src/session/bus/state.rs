//! State of one bus for observers: clock, nodes, meaning of identifiers.

use std::sync::Arc;

use super::hints::BusHints;
use super::identifiers::{IdentifierRoutes, IdentifierService, SdoChannels, UdsPairs};
use super::nodes::{BusNodes, GateState, Node, NodeIdChanges, PendingNodeId, RestartEvidence};
use super::open_transfers::OpenTransfers;
use super::protocols::BusProtocols;
use super::time::{AmbiguousGap, BusClock};
use crate::event::FrameRange;
use crate::frame::{BusIndex, CanId, Timestamp};
use crate::profile::dbc::Database;
use crate::profile::{Catalogue, IdentifierOwner};
use crate::session::options::SessionOptions;
use crate::standard_tables::{NamedParameter, standard_parameter};
use crate::wire::NodeId;
use crate::wire::j1939::Pgn;

/// State of one bus. Machines change it, observers read it.
#[derive(Debug, Clone)]
pub struct Bus {
    pub(in crate::session) index: BusIndex,
    pub(in crate::session) name: Arc<str>,
    pub(in crate::session) options: Arc<SessionOptions>,
    /// Messages of the user's databases for this bus.
    pub(in crate::session) database: Arc<Database>,
    pub(in crate::session) protocols: BusProtocols,
    pub(in crate::session) clock: BusClock,
    pub(in crate::session) routes: IdentifierRoutes,
    pub(in crate::session) channels: SdoChannels,
    /// UDS servers in the bus file.
    pub(in crate::session) uds_pairs: Arc<UdsPairs>,
    pub(in crate::session) nodes: BusNodes,
    pub(in crate::session) restarts: RestartEvidence,
    pub(in crate::session) node_id_changes: NodeIdChanges,
    pub(in crate::session) open_transfers: OpenTransfers,
    /// Identifier of the SYNC received last.
    pub(in crate::session) last_sync: Option<CanId>,
    /// States of nodes in the bus file are not reported yet.
    pub(in crate::session) has_given_states: bool,
    /// Traffic that suggests what the user may state.
    pub(in crate::session) hints: BusHints,
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
        let name: Arc<str> = name.into();
        Self {
            index,
            database: options.database(&name),
            nodes: BusNodes::new(&options, &name),
            protocols: BusProtocols::new(options.protocol_of(&name)),
            name,
            options,
            clock: BusClock::default(),
            routes: IdentifierRoutes::default(),
            channels: SdoChannels::default(),
            uds_pairs: Arc::default(),
            restarts: RestartEvidence::default(),
            node_id_changes: NodeIdChanges::default(),
            open_transfers: OpenTransfers::default(),
            last_sync: None,
            has_given_states: false,
            hints: BusHints::default(),
            last_frame: 0,
            ambiguous_gap: None,
            last_time: None,
            recorded_bit_rate: None,
        }
    }

    /// Protocols that the bus uses, by evidence and by the user.
    pub fn protocols(&self) -> &BusProtocols {
        &self.protocols
    }

    /// Present services of the identifiers.
    pub fn identifiers(&self) -> &IdentifierRoutes {
        &self.routes
    }

    /// All nodes, also by a former node-ID.
    pub fn node_table(&self) -> &BusNodes {
        &self.nodes
    }

    /// Traffic that suggests what the user may state in a bus file.
    pub fn hints(&self) -> &BusHints {
        &self.hints
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
        Some(self.routes.shared_gap(received)?.max(self.clock.usual_gap()))
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

    /// Whether `source` has an open multi-packet transfer that may be about `pgn`.
    pub fn is_transferring(&self, source: u8, pgn: Pgn) -> bool {
        self.open_transfers.contains(source, pgn)
    }

    /// Name and unit of a suspect parameter, from the user's databases, otherwise from the table of J1939.
    pub fn suspect_parameter(&self, spn: u32) -> Option<NamedParameter<'_>> {
        let given = self.database.parameter_by_spn(spn);
        let given = given.map(|known| NamedParameter { name: &known.name, unit: &known.unit });
        given.or_else(|| standard_parameter(spn))
    }

    /// Node with this node-ID or address; a plain number is a CANopen node-ID.
    pub fn node(&self, id: impl Into<NodeId>) -> Option<&Node> {
        self.nodes.node(id.into())
    }

    /// All nodes in ascending order, CANopen first.
    pub fn nodes(&self) -> impl Iterator<Item = &Node> {
        self.nodes.in_order()
    }

    /// All gates of all set points of a node received so far, closed ones first.
    pub fn gates(&self, node: impl Into<NodeId>) -> Vec<GateState> {
        self.node(node).map_or_else(Vec::new, |node| {
            node.all_gates(self.clock.now(), |id| self.nodes.consumers_text(id))
        })
    }

    /// Identifier of the last SYNC.
    pub fn last_sync(&self) -> Option<CanId> {
        self.last_sync
    }

    /// Bytes held, without stores shared with checkpoints.
    pub fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.routes.footprint()
            + self.channels.footprint()
            + self.open_transfers.footprint()
            + self.nodes.footprint()
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
            IdentifierOwner::Pdo(name, node) if self.nodes.is_sent_elsewhere(name, node.into()) => {
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

    /// Bit rate in bit/s, from the bus file, otherwise from the capture.
    pub fn bit_rate(&self) -> Option<u32> {
        self.options.bus_file.bit_rate(&self.name).or(self.recorded_bit_rate)
    }

    /// Time in ns after which an SDO request without a response has timed out.
    pub(crate) fn sdo_silence(&self) -> i64 {
        self.options.sdo_silence
    }

    /// Service of an 11-bit identifier in the predefined connection set.
    pub(in crate::session) fn default_service(&mut self, id: CanId) -> IdentifierService {
        let CanId::Standard(id) = id else { return IdentifierService::Unclassified };
        let owner = crate::profile::connection_set().owner_of(id);
        self.service_of(owner)
    }

    /// New node-ID that a node accepted and that its present restart activates; at the boot sign of the node.
    pub fn pending_node_id(&self, id: NodeId) -> Option<PendingNodeId> {
        self.node_id_changes.pending_change(self.node(id)?)
    }
}
