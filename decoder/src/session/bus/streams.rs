//! Messages of a bus as streams: service, node, regularity.

use super::identifiers::IdentifierService;
use super::state::Bus;
use super::time::StreamRegularity;
use crate::profile::PdoDirection;
use crate::wire::NodeId;

/// Service of a stream that can be periodic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum StreamService {
    Sync,
    ErrorControl,
    TransmittedPdo,
    ReceivedPdo,
    J1939Message,
}

/// Messages with one identifier.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BusStream {
    pub(crate) service: StreamService,
    /// Node that the identifier belongs to; the consumer of a received PDO.
    pub(crate) node: Option<NodeId>,
    pub(crate) regularity: StreamRegularity,
}

impl BusStream {
    /// Sender; `None`: the controller.
    pub(crate) fn sender(&self) -> Option<NodeId> {
        self.node.filter(|_| self.service != StreamService::ReceivedPdo)
    }
}

impl Bus {
    /// Streams that can be periodic.
    pub(crate) fn streams(&self) -> impl Iterator<Item = BusStream> {
        self.routes.pulses().filter_map(|(service, pulse)| {
            let (service, node) = match service {
                IdentifierService::Sync => (StreamService::Sync, None),
                IdentifierService::ErrorControl(node) => (StreamService::ErrorControl, Some(node)),
                IdentifierService::Pdo(name, node) if name.direction == PdoDirection::Transmit => {
                    (StreamService::TransmittedPdo, Some(node))
                }
                IdentifierService::Pdo(_, node) => (StreamService::ReceivedPdo, Some(node)),
                IdentifierService::J1939(id) => (StreamService::J1939Message, Some(NodeId::J1939(id.source))),
                _ => return None,
            };
            Some(BusStream { service, node, regularity: pulse.regularity() })
        })
    }
}
