//! Changes of node-ID that a device has accepted; they take effect at its next boot-up.

use super::node::Node;
use super::restart::RestartType;
use crate::event::NodeIdSource;
use crate::profile::{ObjectRole, ValueStorage, WriteEffect, as_integer};
use crate::wire::NodeId;

/// A new node-ID that the present restart of its node activates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PendingNodeId {
    /// New node-ID.
    pub to: u8,
    /// Source of the new node-ID.
    pub by: NodeIdSource,
}

/// Last accepted change per service.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct NodeIdChanges {
    /// Previous node-ID, if it was inquired, and new node-ID.
    pub(in crate::session) by_lss: Option<(Option<u8>, u8)>,
    /// The LSS slave stored its configuration since.
    pub(in crate::session) is_lss_stored: bool,
    /// Previous and new node-ID.
    pub(in crate::session) by_uds: Option<(NodeId, NodeId)>,
}

impl NodeIdChanges {
    /// Removes and returns the change by LSS if its new node-ID is `id`.
    pub(in crate::session) fn take_by_lss(&mut self, id: NodeId) -> Option<(Option<u8>, u8)> {
        self.by_lss.take_if(|(_, to)| id == NodeId::Canopen(*to))
    }

    /// Removes the change by UDS if its new node-ID is `id`; returns the previous node-ID.
    pub(in crate::session) fn take_by_uds(&mut self, id: NodeId) -> Option<NodeId> {
        self.by_uds.take_if(|(_, to)| *to == id).map(|(from, _)| from)
    }

    /// New node-ID that a node accepted and that its present restart activates; at the boot sign of the node.
    pub(in crate::session) fn pending_change(&self, node: &Node) -> Option<PendingNodeId> {
        // CiA 305 §3.9.3: NMT reset communication activates the node-ID, other restarts load the stored one.
        let is_activated = self.is_lss_stored || node.restart == RestartType::Communication;
        let by_lss =
            self.by_lss.filter(|(from, _)| from.map(NodeId::Canopen) == Some(node.id) && is_activated);
        let by_uds = self.by_uds.filter(|(from, _)| *from == node.id);
        let found = [
            by_lss.map(|(_, to)| (to, NodeIdSource::Lss)),
            by_uds.map(|(_, to)| (to.number(), NodeIdSource::Uds)),
            node.node_id_object().map(|to| (to, NodeIdSource::Object)),
        ];
        let (to, by) = found.into_iter().flatten().next()?;
        Some(PendingNodeId { to, by })
    }
}

impl Node {
    /// Written node-ID object that the present restart activates.
    fn node_id_object(&self) -> Option<u8> {
        self.store.all_waiting().find_map(|(object, waiting)| {
            let entry = self.device.dictionary.find_object(object)?.entry?;
            let is_kept = self.restart == RestartType::Communication
                || entry.storage == ValueStorage::EachWrite
                || entry.storage == ValueStorage::Save && self.saved;
            let is_restored =
                self.restart.applies_value(waiting.effect) && waiting.effect != WriteEffect::Unknown;
            let meaning = self
                .meaning(object)
                .filter(|it| it.role == Some(ObjectRole::NodeId) && is_restored && is_kept)?;
            let to = u8::try_from(as_integer(&meaning.decode(&waiting.value))?).ok()?;
            (to != self.id.number()).then_some(to)
        })
    }
}
