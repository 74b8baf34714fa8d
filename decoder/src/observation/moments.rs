//! Commands and restarts, which explain why messages end or begin.

use std::collections::BTreeMap;

use crate::event::{Event, EventKind, SdoDirection, SdoOutcome, SdoTransfer, StateCertainty, StateChange};
use crate::frame::BusIndex;
use crate::wire::NodeId;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::{NmtState, ObjectAddress};

/// Most restarts and commands of a capture.
const KEPT: usize = 1_024;

/// Time between the restarts of the nodes of a machine that is switched on, in ns.
const MACHINE: i64 = 3_000_000_000;

/// Time in ns in which the messages of a machine end that is switched off, and in which it starts.
const ENDING: i64 = 1_000_000_000;
const STARTING: i64 = 8_000_000_000;

/// Identity object (CiA 301 §7.5.2.19).
const IDENTITY: u16 = 0x1018;

/// Parameter group of address claims (SAE J1939-81 §4.2).
const CLAIM: u32 = 0xEE00;

/// What a node did, or what it was told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum NodeMoment {
    /// Boot-up (CiA 301 §7.2.8.3.3), or an address claim (SAE J1939-81 §4.2).
    Restart,
    /// An NMT command that ends messages: stop, enter pre-operational, reset.
    SwitchOff,
    /// NMT start.
    Start,
    /// A request for address claims (SAE J1939-81 §4.2.1).
    ClaimRequest,
    /// The recorder reports lost frames.
    LostFrames,
    /// A change from operational to another NMT state.
    LeftOperational,
    /// The clock of the recorder was set.
    ClockStep,
    /// End of a time without any frame of the bus.
    BusSilent,
}

/// Moments of all nodes of a capture.
#[derive(Debug, Clone, Default)]
pub(crate) struct NodeMoments {
    known: Vec<KnownMoment>,
    /// Last SDO transfer of each node.
    transfers: BTreeMap<(BusIndex, NodeId), LastTransfer>,
    /// Highest subindex of the identity (1018) that a client read from each node.
    identities: BTreeMap<(BusIndex, NodeId), u8>,
    bursts: Vec<ErrorBurst>,
}

/// Last SDO transfer with a node.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LastTransfer {
    pub(crate) object: Option<ObjectAddress>,
    pub(crate) is_upload: bool,
    /// The server accepted it.
    pub(crate) is_complete: bool,
    /// Monotonic time in ns, and frame.
    pub(crate) at: (i64, u64),
}

/// Error frames less than a second apart.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ErrorBurst {
    bus: BusIndex,
    /// Monotonic times of the first and the last one, in ns.
    pub(crate) times: (i64, i64),
    pub(crate) count: u64,
}

/// Time between error frames of one burst, in ns.
const BURST: i64 = 1_000_000_000;

/// Most bursts of a capture.
const BURSTS: usize = 64;

#[derive(Debug, Clone, Copy)]
struct KnownMoment {
    what: NodeMoment,
    bus: BusIndex,
    /// `None`: all nodes of the bus.
    node: Option<NodeId>,
    /// Monotonic time in ns.
    time: i64,
    frame: u64,
}

fn is_end_of_operation(change: &StateChange) -> bool {
    change.from == Some(NmtState::Operational)
        && change.to != NmtState::Operational
        && change.certainty == StateCertainty::Confirmed
}

impl NodeMoments {
    /// Records an event of a bus at a monotonic time.
    pub(crate) fn observe_event(&mut self, event: &Event, time: i64) {
        let (what, node) = match &event.kind {
            EventKind::SdoTransfer(transfer) => return self.note_transfer(event, transfer, time),
            EventKind::CanError(error) if !error.is_only_receive_overflow() => {
                return self.note_error(event.bus, time);
            }
            EventKind::BootUp { .. } | EventKind::AddressClaim(_) => (NodeMoment::Restart, event.node),
            EventKind::Emcy(emergency) if emergency.boot.is_some() => (NodeMoment::Restart, event.node),
            EventKind::J1939Request(request) if request.pgn.number() == CLAIM => {
                (NodeMoment::ClaimRequest, None)
            }
            EventKind::NmtState(change) if is_end_of_operation(change) => {
                (NodeMoment::LeftOperational, event.node)
            }
            EventKind::ClockStep { .. } => (NodeMoment::ClockStep, None),
            EventKind::BusSilent { .. } => (NodeMoment::BusSilent, None),
            EventKind::LostFrames { .. } => (NodeMoment::LostFrames, None),
            EventKind::NmtCommand { service, target, .. } => {
                let what = match service {
                    NmtService::Start => NodeMoment::Start,
                    NmtService::Unknown(_) => return,
                    _ => NodeMoment::SwitchOff,
                };
                (what, (*target != 0).then(|| NodeId::from(*target)))
            }
            _ => return,
        };
        if self.known.len() < KEPT {
            self.known.push(KnownMoment { what, bus: event.bus, node, time, frame: event.frames.last });
        }
    }

    fn note_transfer(&mut self, event: &Event, transfer: &SdoTransfer, time: i64) {
        let Some(node) = event.node else { return };
        let is_upload = transfer.direction == Some(SdoDirection::Upload);
        let is_complete = transfer.outcome == SdoOutcome::Complete;
        let last =
            LastTransfer { object: transfer.object, is_upload, is_complete, at: (time, event.frames.last) };
        self.transfers.insert((event.bus, node), last);
        if let Some(object) = transfer.object.filter(|object| is_upload && object.index == IDENTITY) {
            let read = self.identities.entry((event.bus, node)).or_default();
            *read = object.sub.max(*read);
        }
    }

    /// Whether a client read more of the identity of another node on the bus than of this one.
    pub(crate) fn is_identity_cut(&self, bus: BusIndex, node: NodeId) -> bool {
        let own = self.identities.get(&(bus, node)).copied().unwrap_or(0);
        let mut others = self.identities.iter().filter(|((of, other), _)| *of == bus && *other != node);
        others.any(|(_, read)| *read > own)
    }

    fn note_error(&mut self, bus: BusIndex, time: i64) {
        let has_room = self.bursts.len() < BURSTS;
        let last = self.bursts.iter_mut().rev().find(|burst| burst.bus == bus);
        match last.filter(|burst| time.saturating_sub(burst.times.1) <= BURST) {
            Some(burst) => {
                burst.times.1 = time;
                burst.count = burst.count.saturating_add(1);
            }
            None if has_room => {
                self.bursts.push(ErrorBurst { bus, times: (time, time), count: 1 });
            }
            None => {}
        }
    }

    /// Bursts of error frames on a bus.
    pub(crate) fn error_bursts(&self, bus: BusIndex) -> impl Iterator<Item = &ErrorBurst> {
        self.bursts.iter().filter(move |burst| burst.bus == bus)
    }

    /// The last SDO transfer with a node.
    pub(crate) fn last_transfer(&self, bus: BusIndex, node: NodeId) -> Option<&LastTransfer> {
        self.transfers.get(&(bus, node))
    }

    /// NMT commands on a bus that end messages: the node, or `None` for all, with monotonic time and frame.
    pub(crate) fn switch_offs(&self, bus: BusIndex) -> impl Iterator<Item = (Option<NodeId>, (i64, u64))> {
        let own =
            self.known.iter().filter(move |known| known.bus == bus && known.what == NodeMoment::SwitchOff);
        own.map(|known| (known.node, (known.time, known.frame)))
    }

    /// Whether a node was concerned between two monotonic times, both included.
    pub(crate) fn has_moment(
        &self,
        what: NodeMoment,
        (bus, node): (BusIndex, Option<NodeId>),
        (from, to): (i64, i64),
    ) -> bool {
        self.known.iter().any(|known| {
            known.what == what
                && known.bus == bus
                && (known.node.is_none() || node.is_none() || known.node == node)
                && (from..=to).contains(&known.time)
        })
    }

    /// Whether two nodes or more left the state operational between two monotonic times: a command that the capture lacks.
    pub(crate) fn is_common_stop(&self, bus: BusIndex, (from, to): (i64, i64)) -> bool {
        let stops = self.known.iter().filter(|known| {
            known.bus == bus && known.what == NodeMoment::LeftOperational && (from..=to).contains(&known.time)
        });
        let mut nodes: Vec<_> = stops.filter_map(|known| known.node).collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes.len() >= 2
    }

    /// Whether more than two thirds of the nodes, at least two, restarted around a monotonic time: the machine was switched on.
    pub(crate) fn is_machine_start(&self, bus: BusIndex, nodes: &[NodeId], time: i64) -> bool {
        let range = (time.saturating_sub(MACHINE), time.saturating_add(MACHINE));
        let restarted = nodes
            .iter()
            .filter(|node| self.has_moment(NodeMoment::Restart, (bus, Some(**node)), range))
            .count();
        restarted >= 2 && restarted * 3 > nodes.len() * 2
    }

    /// Starts of the whole machine after a silence of the bus: monotonic times from the last messages before it to the time at which
    /// the controller has started the nodes.
    pub(crate) fn machine_starts(&self, bus: BusIndex, nodes: &[NodeId]) -> Vec<(i64, i64)> {
        let silent =
            self.known.iter().filter(|known| known.bus == bus && known.what == NodeMoment::BusSilent);
        let started = silent.filter(|known| self.is_machine_start(bus, nodes, known.time));
        started
            .map(|known| (known.time.saturating_sub(ENDING), known.time.saturating_add(STARTING)))
            .collect()
    }

    /// Restarts of nodes on a bus, each with its monotonic time and frame.
    pub(crate) fn restarts(&self, bus: BusIndex) -> impl Iterator<Item = (NodeId, (i64, u64))> {
        let own =
            self.known.iter().filter(move |known| known.bus == bus && known.what == NodeMoment::Restart);
        own.filter_map(|known| Some((known.node?, (known.time, known.frame))))
    }
}
