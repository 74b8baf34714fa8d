//! Messages of a bus as streams: service, node, regularity.

use super::identifiers::IdentifierService;
use super::state::Bus;
use super::time::{PayloadChanges, PeriodChange, StreamBurst, StreamRegularity, StreamSilence, ValueJumps};
use crate::frame::CanId;
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
#[derive(Debug, Clone)]
pub(crate) struct BusStream {
    pub(crate) id: CanId,
    pub(crate) service: StreamService,
    /// Node that the identifier belongs to; the consumer of a received PDO.
    pub(crate) node: Option<NodeId>,
    pub(crate) regularity: StreamRegularity,
    /// Number of frames.
    pub(crate) count: u32,
    /// Longest of the last 32 to 64 intervals, in ns.
    pub(crate) longest: i64,
    /// Monotonic times of the first and the last frame, in ns.
    pub(crate) times: (i64, i64),
    /// Number of the last frame.
    pub(crate) last_frame: u64,
    /// Longer gaps, the first ones.
    pub(crate) silences: Vec<StreamSilence>,
    /// Changes of the period, the first ones.
    pub(crate) periods: Vec<PeriodChange>,
    /// Number of usual intervals since the last change of the period.
    pub(crate) present_count: u32,
    /// Number of elements of another sender with the same period, and time and frame of the first one.
    pub(crate) splits: (u32, (i64, u64)),
    pub(crate) burst: StreamBurst,
    pub(crate) jumps: Option<ValueJumps>,
    pub(crate) changes: PayloadChanges,
    /// Last payload, little-endian; 0 if it has more than eight bytes.
    pub(crate) payload: u64,
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
        self.routes.identifiers().filter_map(|(id, state)| {
            let pulse = state.intervals();
            if matches!(state.service, IdentifierService::J1939(id) if self.protocols.sends_fast_packets(id.pgn)) {
                return None;
            }
            let (service, node) = stream_service(state.service)?;
            let (history, regularity) = (pulse.history(), pulse.regularity());
            let regular = regularity.regular_count();
            Some(BusStream {
                id,
                service,
                node,
                regularity,
                count: pulse.count(),
                longest: pulse.longest_interval(),
                times: pulse.times(),
                last_frame: pulse.last_frame(),
                silences: history.map_or_else(Vec::new, |history| history.silences().to_vec()),
                periods: history.map_or_else(Vec::new, |history| history.changes().to_vec()),
                present_count: history.map_or(regular, |history| history.present_count(regular)),
                splits: history.map_or_else(Default::default, |history| history.splits()),
                burst: history.map_or_else(Default::default, |history| history.burst()),
                jumps: history.and_then(|history| history.value_jumps(pulse.payload_changes().count, pulse.count())),
                changes: pulse.payload_changes(),
                payload: state.last.word(),
            })
        })
    }
}

/// Service and node of an identifier that can be periodic.
fn stream_service(service: IdentifierService) -> Option<(StreamService, Option<NodeId>)> {
    Some(match service {
        IdentifierService::Sync => (StreamService::Sync, None),
        IdentifierService::ErrorControl(node) => (StreamService::ErrorControl, Some(node)),
        IdentifierService::Pdo(name, node) if name.direction == PdoDirection::Transmit => {
            (StreamService::TransmittedPdo, Some(node))
        }
        IdentifierService::Pdo(_, node) => (StreamService::ReceivedPdo, Some(node)),
        IdentifierService::J1939(id) => (StreamService::J1939Message, Some(NodeId::J1939(id.source))),
        _ => return None,
    })
}
