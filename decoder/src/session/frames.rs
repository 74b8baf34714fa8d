//! Whose a frame is.

use super::Bus;
use super::routes::Service;
use super::uds::Link;
use crate::frame::Frame;
use crate::wire::NodeId;
use crate::wire::j1939::ALL;

/// Who has to do with a frame.
enum Concern {
    /// A node, as its sender or receiver.
    Node(NodeId),
    /// One sends to another.
    Between(NodeId, NodeId),
    /// Every CANopen node of the bus.
    Everybody,
    /// Nobody that is known.
    Nobody,
}

impl Bus {
    /// The node a frame is from or for, as far as its identifier tells by now: of a J1939 message who sends it.
    pub fn node_of(&self, frame: &Frame) -> Option<NodeId> {
        match self.concern(frame) {
            Concern::Node(node) | Concern::Between(node, _) => Some(node),
            Concern::Everybody | Concern::Nobody => None,
        }
    }

    /// Whether a frame is from a node or for it: SYNC, TIME and commands to all nodes are for each CANopen node, J1939
    /// messages to all are from their sender only.
    pub fn concerns(&self, frame: &Frame, node: NodeId) -> bool {
        match self.concern(frame) {
            Concern::Node(known) => known == node,
            Concern::Between(one, other) => one == node || other == node,
            Concern::Everybody => node.canopen().is_some(),
            Concern::Nobody => false,
        }
    }

    fn concern(&self, frame: &Frame) -> Concern {
        let slot = self.routes.find(frame.id).and_then(|slot| self.routes.slot(slot));
        let address = |address: u16| u8::try_from(address).map(NodeId::J1939);
        match slot.map(|slot| slot.service) {
            Some(Service::Emcy(node) | Service::Pdo(_, node) | Service::ErrorControl(node)) => {
                Concern::Node(node)
            }
            Some(Service::Sdo(_, channel)) => self
                .channels
                .server(channel)
                .map_or(Concern::Nobody, |node| Concern::Node(NodeId::Canopen(node))),
            Some(Service::Nmt) => match frame.data().get(1) {
                None | Some(0) => Concern::Everybody,
                Some(node) => Concern::Node(NodeId::Canopen(*node)),
            },
            Some(Service::Sync | Service::Time | Service::Lss(_)) => Concern::Everybody,
            Some(Service::J1939(id)) if id.destination == ALL => Concern::Node(NodeId::J1939(id.source)),
            Some(Service::J1939(id)) => {
                Concern::Between(NodeId::J1939(id.source), NodeId::J1939(id.destination))
            }
            Some(Service::IsoTp(Link::Addressed { source, target, .. })) => {
                match (address(source), address(target)) {
                    (Ok(source), Ok(target)) => Concern::Between(source, target),
                    (Ok(node), _) | (_, Ok(node)) => Concern::Node(node),
                    _ => Concern::Nobody,
                }
            }
            None
            | Some(Service::Unclassified | Service::Named(_) | Service::TestMarker | Service::IsoTp(_)) => {
                Concern::Nobody
            }
        }
    }
}
