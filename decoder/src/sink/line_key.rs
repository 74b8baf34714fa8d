//! Keys of cached lines, packed into integers: one comparison per line instead of one per field.

use crate::event::DecodedPdo;
use crate::frame::CanId;
use crate::session::Bus;
use crate::wire::NodeId;

/// Slots for PDOs; each predefined COB-ID (0x180 to 0x57F) of a bus has its own slot.
pub(super) const PDO_SLOTS: usize = 1024;

/// Distance between the slots of two buses.
pub(super) const BUS_SLOTS: usize = 83;

/// Slot of a PDO. Collisions are harmless but slow.
#[inline]
pub(super) fn pdo_slot(pdo: &DecodedPdo, bus: &Bus) -> usize {
    (pdo.cob_id.number() as usize + usize::from(bus.index().0) * BUS_SLOTS) % PDO_SLOTS
}

/// COB-ID, direction, number and node of a PDO, below 2^58.
#[inline]
pub(super) fn pdo_key(pdo: &DecodedPdo, node: Option<NodeId>) -> u64 {
    let id = match pdo.cob_id {
        CanId::Standard(id) => u64::from(id),
        CanId::Extended(id) => u64::from(id) | 1 << 29,
    };
    id | u64::from(pdo.name.is_sent()) << 30 | u64::from(pdo.name.number) << 31 | node_key(node) << 48
}

/// Node-ID or address with its type, below 2^10; 0 without a node.
#[inline]
pub(super) fn node_key(node: Option<NodeId>) -> u64 {
    match node {
        None => 0,
        Some(NodeId::Canopen(id)) => u64::from(id) | 1 << 8,
        Some(NodeId::J1939(address)) => u64::from(address) | 1 << 9,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::MAX_DATA;
    use crate::profile::{PdoDirection, PdoName};

    #[test]
    fn keys_differ_if_a_field_differs() {
        let pdo = |cob_id, direction, number| DecodedPdo {
            name: PdoName { direction, number },
            cob_id,
            is_request: false,
            length: 0,
            bytes: [0; MAX_DATA],
            layout: None,
        };
        let (sent, received) = (PdoDirection::Transmit, PdoDirection::Receive);
        let mut keys = vec![
            pdo_key(&pdo(CanId::from_standard(0x181), sent, 1), Some(NodeId::Canopen(1))),
            pdo_key(&pdo(CanId::from_extended(0x181), sent, 1), Some(NodeId::Canopen(1))),
            pdo_key(&pdo(CanId::from_extended(0x1FFF_FFFF), sent, 1), Some(NodeId::Canopen(1))),
            pdo_key(&pdo(CanId::from_standard(0x181), received, 1), Some(NodeId::Canopen(1))),
            pdo_key(&pdo(CanId::from_standard(0x181), sent, 512), Some(NodeId::Canopen(1))),
            pdo_key(&pdo(CanId::from_standard(0x181), sent, u16::MAX), Some(NodeId::Canopen(1))),
            pdo_key(&pdo(CanId::from_standard(0x181), sent, 1), Some(NodeId::J1939(1))),
            pdo_key(&pdo(CanId::from_standard(0x181), sent, 1), Some(NodeId::J1939(0))),
            pdo_key(&pdo(CanId::from_standard(0x181), sent, 1), None),
        ];
        let count = keys.len();
        keys.sort_unstable();
        keys.dedup();
        assert_eq!(keys.len(), count);
        assert!(keys.iter().all(|key| *key < 1 << 58));
    }
}
