//! What can be asked of a bus, and its nodes by node-ID.

use std::sync::Arc;

use super::Bus;
use super::belief::Standing;
use super::device::GateState;
use super::j1939::Cadence;
use super::node::Node;
use super::routes::Service;
use super::timers::Subject;
use crate::frame::{BusIndex, CanId, Timestamp};
use crate::profile::dbc::Parameter;
use crate::profile::{Meaning, NothingKnown, Resolver, plain_device};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::sdo::Side;
use crate::wire::j1939::{J1939Id, Pgn};

impl Bus {
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
        self.belief.is_believed()
    }

    /// Whether the 29-bit frames are believed to be J1939.
    pub fn is_j1939(&self) -> bool {
        self.j1939.is_believed()
    }

    /// Whether an address is in the middle of a transfer of several packets that can be about a group.
    pub fn is_transferring(&self, source: u8, pgn: Pgn) -> bool {
        self.transports.has_of(source, pgn)
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
    pub(super) fn meaning(&self, id: NodeId, object: ObjectAddress) -> Option<Meaning> {
        match self.node(id) {
            Some(node) => node.meaning(object),
            None => Resolver::new(&plain_device().dictionary, &NothingKnown).meaning(object),
        }
    }

    /// Identifier of the SYNC that came last.
    pub fn last_sync(&self) -> Option<CanId> {
        self.sync.id
    }

    /// What an identifier means now, for people: `TPDO1 of 5`, `SDO response of 15`.
    pub fn describe_id(&self, id: CanId) -> String {
        match self.routes.find(id).and_then(|slot| self.routes.slot(slot)).map(|slot| slot.service) {
            Some(Service::IsoTp(link)) => self.uds.pairs().describe(link),
            Some(Service::J1939(_)) if !self.j1939.is_doubted() => self.describe_group(id),
            _ if !self.belief.is_believed() => String::new(),
            None | Some(Service::Unclassified | Service::J1939(_)) => String::new(),
            Some(Service::Named(name)) => name.to_owned(),
            Some(Service::Nmt) => "NMT".to_owned(),
            Some(Service::Sync) => "SYNC".to_owned(),
            Some(Service::Time) => "TIME".to_owned(),
            Some(Service::Emcy(node)) => format!("EMCY of {}", node.number()),
            Some(Service::Pdo(name, node)) => format!("{name} of {}", node.number()),
            Some(Service::ErrorControl(node)) => format!("heartbeat, guarding of {}", node.number()),
            Some(Service::TestMarker) => "conformance test".to_owned(),
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

    /// The filter that shows the events of an identifier.
    pub fn filter_of_id(&self, id: CanId) -> String {
        let service = self.routes.find(id).and_then(|slot| self.routes.slot(slot)).map(|slot| slot.service);
        let is_believed = self.belief.is_believed();
        match service {
            Some(Service::J1939(id)) if !self.j1939.is_doubted() => filter_of_group(id),
            Some(Service::Nmt) if is_believed => "kind == \"nmt-command\"".to_owned(),
            Some(Service::Sync) if is_believed => "kind == \"sync\"".to_owned(),
            Some(Service::Time) if is_believed => "kind == \"time\"".to_owned(),
            Some(Service::Lss(_)) if is_believed => "kind == \"lss\"".to_owned(),
            Some(Service::TestMarker) => "kind == \"test-case\"".to_owned(),
            Some(Service::ErrorControl(node)) if is_believed => {
                const KINDS: &str = r#""heartbeat", "guard-request", "guard-reply", "boot-up", "nmt-state""#;
                format!("node == {} && kind in {{{KINDS}, \"node-lost\", \"node-back\"}}", node.number())
            }
            _ => format!("can.id == 0x{id}"),
        }
    }

    /// Why it is not taken for CANopen; `None` where it is, or nothing speaks against it yet.
    pub fn doubt(&self) -> Option<String> {
        (self.belief.standing() == Standing::Doubted).then(|| self.belief.reason())
    }

    /// Whether a request of UDS was answered on it.
    pub fn is_uds(&self) -> bool {
        self.uds.is_spoken()
    }

    /// What a user may tell of identifiers that nobody explained, where their frames look like UDS.
    pub fn unnamed_uds(&self) -> Option<String> {
        self.unnamed.hint()
    }

    /// Bytes of its own, stores shared with checkpoints apart.
    pub fn footprint(&self) -> usize {
        size_of::<Self>()
            + self.routes.footprint()
            + self.timers.footprint()
            + self.channels.footprint()
            + self.claims.footprint()
            + self.uds.footprint()
            + self.transports.footprint()
            + self.nodes.iter().map(Node::footprint).sum::<usize>()
    }

    /// The node with this number, made if new.
    #[inline]
    pub(super) fn node_mut(&mut self, id: NodeId) -> Option<&mut Node> {
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
    pub(super) fn given_name(&self, id: NodeId) -> Option<Arc<str>> {
        let named = self.options.node_names.iter().find(|(named, _)| *named == id);
        let name = named.map(|(_, name)| name.as_str());
        name.or_else(|| self.options.bus_file.name(&self.name, id)).map(Into::into)
    }

    /// Gives a node another node-ID; the node that had it loses it. What was learnt of its identifiers
    /// stays with it, the defaults follow the node-ID.
    pub(super) fn move_node(&mut self, from: NodeId, to: NodeId) {
        let place = |bus: &Self, id: NodeId| bus.node_by_id.get(id.place()).copied().unwrap_or(0);
        let (moved, replaced) = (place(self, from), place(self, to));
        for (place, id) in [(moved, to), (replaced, from)] {
            if let Some(node) = usize::from(place).checked_sub(1).and_then(|place| self.nodes.get_mut(place))
            {
                node.id = id;
            }
            if let Some(slot) = self.node_by_id.get_mut(id.place()) {
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
}

/// Messages of management and transport are events of a kind, with the group they are about.
fn filter_of_group(id: J1939Id) -> String {
    let sender = format!("source_address == 0x{:02X}", id.source);
    let kind = match id.pgn {
        Pgn::ACKNOWLEDGEMENT => "acknowledgement",
        Pgn::REQUEST => "j1939-request",
        Pgn::TP_CM | Pgn::TP_DT | Pgn::ETP_CM | Pgn::ETP_DT => "j1939-transfer",
        Pgn::ADDRESS_CLAIMED => "address-claim",
        Pgn::COMMANDED_ADDRESS => "commanded-address",
        pgn => return format!("pgn == {} && {sender}", pgn.number()),
    };
    format!("kind == \"{kind}\" && {sender}")
}
