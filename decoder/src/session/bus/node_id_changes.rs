//! Changes of node-ID that a device has accepted; they take effect at its next boot-up.

use crate::wire::NodeId;

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
}
