//! Role of a node: a slave executes NMT commands, the controller sends them.

use crate::frame::CanId;
use crate::session::Bus;
use crate::wire::NodeId;

/// Identifiers of a slave in the predefined connection set (CiA 301 §7.3.3): four TPDOs, SDO response.
const SLAVE_SERVICES: [u16; 5] = [0x180, 0x280, 0x380, 0x480, 0x580];

/// Whether a node is presumably the controller of its bus: it sends NMT error control only, it is not guarded, and no device is
/// assigned to it. NMT commands to all nodes do not concern their sender, which may have a heartbeat of its own.
///
/// A slave that is never configured, never started and never read looks the same.
pub(crate) fn is_controller(bus: &Bus, node: NodeId) -> bool {
    let NodeId::Canopen(id) = node else { return false };
    let Some(known) = bus.node(node) else { return false };
    let is_slave_service =
        |base| bus.identifiers().find_slot(CanId::from_standard(base + u16::from(id))).is_some();
    known.assigned_by().is_none() && !known.is_guarded() && !SLAVE_SERVICES.into_iter().any(is_slave_service)
}
