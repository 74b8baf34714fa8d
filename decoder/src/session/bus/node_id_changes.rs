//! Changes of node-ID that a device accepted and that are in force from its next boot-up on.

use crate::wire::NodeId;

/// The last accepted change by each service.
#[derive(Debug, Clone, Copy, Default)]
pub(in crate::session) struct NodeIdChanges {
    /// Node-ID before, if it was inquired, and the new one.
    pub(in crate::session) by_lss: Option<(Option<u8>, u8)>,
    /// Node-ID before, and the new one.
    pub(in crate::session) by_uds: Option<(NodeId, NodeId)>,
}

impl NodeIdChanges {
    /// Takes the change by LSS if it leads to `id`: node-ID before, if it was inquired, and the new one.
    pub(in crate::session) fn take_by_lss(&mut self, id: NodeId) -> Option<(Option<u8>, u8)> {
        self.by_lss.take_if(|(_, to)| id == NodeId::Canopen(*to))
    }

    /// Takes the change by UDS if it leads to `id`: the node-ID before.
    pub(in crate::session) fn take_by_uds(&mut self, id: NodeId) -> Option<NodeId> {
        self.by_uds.take_if(|(_, to)| *to == id).map(|(from, _)| from)
    }
}
