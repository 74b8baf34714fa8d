//! New node-IDs that a node accepted and that a restart activates.

use super::{Bus, Node, RestartType};
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

impl Bus {
    /// New node-ID that a node accepted and that its present restart activates; at the boot sign of the node.
    pub fn pending_node_id(&self, id: NodeId) -> Option<PendingNodeId> {
        let node = self.node(id)?;
        let changes = &self.node_id_changes;
        // CiA 305 §3.9.3: NMT reset communication activates the node-ID, other restarts load the stored one.
        let is_activated = changes.is_lss_stored || node.restart == RestartType::Communication;
        let by_lss = changes.by_lss.filter(|(from, _)| from.map(NodeId::Canopen) == Some(id) && is_activated);
        let by_uds = changes.by_uds.filter(|(from, _)| *from == id);
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
