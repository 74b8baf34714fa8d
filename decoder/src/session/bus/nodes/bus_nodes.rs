//! All nodes of a bus, by node-ID or address.

use std::sync::Arc;

use super::node::Node;
use super::pdo_users::PdoUsers;
use crate::frame::CanId;
use crate::profile::device::{MessageDirection, MessageSpec};
use crate::profile::{DeviceProfile, EntryResolver, NoValues, ObjectMeaning, PdoName, plain_device};
use crate::session::bus::objects::{nonzero_identifier, predefined_identifier};
use crate::session::options::SessionOptions;
use crate::wire::canopen::ObjectAddress;
use crate::wire::j1939::{ALL, J1939Id, J1939Name};
use crate::wire::{NODE_PLACES, NodeId};

/// Sender or receiver of a message whose profile describes the message.
pub(in crate::session) struct ConcernedDevice {
    pub(in crate::session) node: NodeId,
    pub(in crate::session) device: Arc<DeviceProfile>,
    /// Index in the message list of the profile.
    pub(in crate::session) place: usize,
}

impl ConcernedDevice {
    pub(in crate::session) fn message_spec(&self) -> Option<&MessageSpec> {
        self.device.messages.get(self.place)
    }
}

/// Nodes of one bus.
#[derive(Debug, Clone)]
pub struct BusNodes {
    list: Vec<Node>,
    /// Index in `list` + 1, by [`NodeId::table_place`]; 0 = no node.
    by_id: Box<[u16; NODE_PLACES]>,
    pdo_users: PdoUsers,
    /// Names from the user.
    options: Arc<SessionOptions>,
    bus_name: Arc<str>,
}

impl BusNodes {
    /// Table without nodes, for a bus with this name.
    pub(in crate::session) fn new(options: &Arc<SessionOptions>, bus_name: &Arc<str>) -> Self {
        Self {
            list: Vec::new(),
            by_id: Box::new([0; NODE_PLACES]),
            pdo_users: PdoUsers::default(),
            options: Arc::clone(options),
            bus_name: Arc::clone(bus_name),
        }
    }

    /// Node with this node-ID or address.
    pub(in crate::session) fn node(&self, id: NodeId) -> Option<&Node> {
        self.node_at(id.table_place())
    }

    /// All nodes in the order of their first frames.
    pub(in crate::session) fn all(&self) -> &[Node] {
        &self.list
    }

    /// All nodes in ascending order, CANopen first.
    pub(in crate::session) fn in_order(&self) -> impl Iterator<Item = &Node> {
        let known = self.by_id.iter().filter(|index| **index > 0);
        known.filter_map(|index| self.list.get(usize::from(*index).checked_sub(1)?))
    }

    /// The same as [`Self::all`], mutable.
    pub(in crate::session) fn all_mut(&mut self) -> &mut [Node] {
        &mut self.list
    }

    /// Changes the node-ID of a node; a node that has it already is replaced. Returns the moved node.
    pub(in crate::session) fn change_id(&mut self, from: NodeId, to: NodeId) -> Option<&mut Node> {
        let place = |id: NodeId| self.by_id.get(id.table_place()).copied().unwrap_or(0);
        let (moved, replaced) = (place(from), place(to));
        for (place, id) in [(moved, to), (replaced, from)] {
            if let Some(node) = usize::from(place).checked_sub(1).and_then(|place| self.list.get_mut(place)) {
                node.id = id;
            }
            if let Some(slot) = self.by_id.get_mut(id.table_place()) {
                *slot = place;
            }
        }
        // The entry of the replaced node is now empty and has the old node-ID.
        if let Some(node) = usize::from(replaced).checked_sub(1).and_then(|place| self.list.get_mut(place)) {
            *node = Node::new(from, None);
        }
        self.list.get_mut(usize::from(moved).checked_sub(1)?)
    }

    /// Bytes held, without stores shared with checkpoints.
    pub(in crate::session) fn footprint(&self) -> usize {
        self.list.iter().map(Node::footprint).sum()
    }

    /// Node with this node-ID; if it has no frame, the node that had it before a change of its node-ID.
    pub fn present_or_former(&self, id: NodeId) -> Option<&Node> {
        let present = self.node(id);
        let former = || self.list.iter().find(|node| node.previous_id == Some(id));
        present.filter(|node| node.last_frame > 0).or_else(former).or(present)
    }

    /// Present meaning of an object of a node; as in CiA 301 for an unknown node.
    pub(in crate::session) fn meaning(&self, id: NodeId, object: ObjectAddress) -> Option<ObjectMeaning> {
        match self.node(id) {
            Some(node) => node.meaning(object),
            None => EntryResolver::new(&plain_device().dictionary, &NoValues).resolve_meaning(object),
        }
    }

    /// Node with this node-ID or address, created on first use.
    #[inline]
    pub(in crate::session) fn node_mut(&mut self, id: NodeId) -> Option<&mut Node> {
        let place = match *self.by_id.get(id.table_place())? {
            0 => self.add_node(id)?,
            place => place,
        };
        self.list.get_mut(usize::from(place) - 1)
    }

    /// Node with this node-ID or address, if it exists.
    #[inline]
    pub(in crate::session) fn known_node_mut(&mut self, id: NodeId) -> Option<&mut Node> {
        self.node_at_mut(id.table_place())
    }

    /// Node by the index of its node-ID in tables by node, if it exists.
    #[inline]
    pub(in crate::session) fn node_at(&self, place: usize) -> Option<&Node> {
        let index = *self.by_id.get(place)?;
        self.list.get(usize::from(index).checked_sub(1)?)
    }

    /// The same, mutable.
    #[inline]
    pub(in crate::session) fn node_at_mut(&mut self, place: usize) -> Option<&mut Node> {
        let index = *self.by_id.get(place)?;
        self.list.get_mut(usize::from(index).checked_sub(1)?)
    }

    /// Creates a node; returns its index + 1.
    #[cold]
    fn add_node(&mut self, id: NodeId) -> Option<u16> {
        let place = u16::try_from(self.list.len() + 1).ok()?;
        let name = self.given_name(id);
        self.list.push(Node::new(id, name));
        *self.by_id.get_mut(id.table_place())? = place;
        Some(place)
    }

    /// Name from the user for a node-ID or address.
    pub(in crate::session) fn given_name(&self, id: NodeId) -> Option<Arc<str>> {
        let named = self.options.node_names.iter().find(|(named, _)| *named == id);
        let name = named.map(|(_, name)| name.as_str());
        name.or_else(|| self.options.bus_file.name(&self.bus_name, id)).map(Into::into)
    }

    /// Number in the object store of a node.
    pub(in crate::session) fn object_number(&self, id: NodeId, address: ObjectAddress) -> Option<u64> {
        self.node(id)?.store().number(address)
    }

    /// Address of the device with a NAME.
    pub(in crate::session) fn address_of(&self, name: J1939Name) -> Option<u8> {
        self.list.iter().find(|node| node.j1939_name() == Some(name)).and_then(|node| node.id().j1939())
    }

    /// Configured users of an identifier: TPDOs that send it and RPDOs that receive it.
    pub fn pdo_users(&self, id: CanId) -> Vec<(PdoName, NodeId)> {
        let of_node = |node: &Node| {
            let names = node.configured_pdos().filter(|(_, cob_id)| nonzero_identifier(*cob_id) == Some(id));
            names.map(|(name, _)| (name, node.id())).collect::<Vec<_>>()
        };
        self.list.iter().flat_map(of_node).collect()
    }

    /// Other configured users of the identifier of a PDO. `None` if only its own node is known and the
    /// configuration does not contradict that.
    pub(crate) fn other_users(&self, id: CanId) -> Option<&[(PdoName, NodeId)]> {
        self.pdo_users.other_users(id)
    }

    /// Whether a TPDO is configured with a valid identifier other than the predefined one.
    pub(in crate::session) fn is_sent_elsewhere(&self, name: PdoName, id: NodeId) -> bool {
        let configured =
            self.node(id).filter(|_| name.is_sent()).and_then(|node| node.configured_cob_id(name));
        let configured = configured.and_then(nonzero_identifier);
        configured.is_some_and(|configured| Some(configured) != predefined_identifier(name, id))
    }

    /// Updates the users of all identifiers after a COB-ID changed.
    #[cold]
    pub(in crate::session) fn refresh_pdo_users(&mut self) {
        self.pdo_users = PdoUsers::of_nodes(&self.list);
    }

    /// Text of the known consumers of an identifier: `received by RPDO1 of 7/07`, `no known consumer`.
    pub(in crate::session) fn consumers_text(&self, id: CanId) -> String {
        let all = self.pdo_users(id).into_iter().filter(|(name, _)| !name.is_sent());
        let names: Vec<_> = all.map(|(name, node)| format!("{name} of {}", node.label())).collect();
        if names.is_empty() {
            "no known consumer".to_owned()
        } else {
            format!("received by {}", names.join(", "))
        }
    }

    /// Device whose profile describes a message: the sender, otherwise a receiver.
    pub(in crate::session) fn concerned_device(&self, id: J1939Id) -> Option<ConcernedDevice> {
        let find = |node: NodeId, direction: MessageDirection| {
            let address = node.j1939()?;
            let known = self.node(node).filter(|known| known.assigned.is_some())?;
            let mut messages = known.device.messages.iter();
            let place =
                messages.position(|spec| spec.direction == direction && spec.is_for(id.pgn, address))?;
            Some(ConcernedDevice { node, device: Arc::clone(&known.device), place })
        };
        if let Some(sender) = find(NodeId::J1939(id.source), MessageDirection::Transmit) {
            return Some(sender);
        }
        if id.destination != ALL {
            return find(NodeId::J1939(id.destination), MessageDirection::Receive);
        }
        let assigned = self.list.iter().filter(|node| node.assigned.is_some());
        assigned.map(|node| node.id).find_map(|node| find(node, MessageDirection::Receive))
    }
}
