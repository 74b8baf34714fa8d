//! State of a node at a moment: NMT and device states, set points, gates.

use crate::event::{EffectiveState, SetPoint};
use crate::frame::BusIndex;
use crate::session::{Bus, GateState, GateStatus, NmtStatus, Node};
use crate::wire::NodeId;

/// State of a node at a moment.
#[derive(Debug, Clone)]
pub struct NodeState {
    /// Bus of the node.
    pub bus: BusIndex,
    /// Node-ID or J1939 address.
    pub node: NodeId,
    /// NMT state, if known.
    pub nmt: Option<NmtStatus>,
    /// States reported by the device, with the channel if there are several.
    pub states: Vec<(Option<u8>, String)>,
    /// Whether the node has been silent for longer than its monitoring time.
    pub lost: bool,
    /// Codes of active errors.
    pub errors: Vec<u16>,
    /// SPN and FMI of active diagnostic trouble codes.
    pub dtcs: Vec<(u32, u8)>,
    /// Set points received.
    pub set_points: Vec<PointState>,
}

/// State of a set point.
#[derive(Debug, Clone)]
pub struct PointState {
    /// Last set point received.
    pub point: SetPoint,
    /// Whether the set point has an effect.
    pub effective: EffectiveState,
    /// Gates, sorted: closed, open, unknown, invisible.
    pub gates: Vec<GateState>,
}

impl NodeState {
    /// Current state of a node with its set points.
    pub(super) fn current_state(bus: &Bus, id: NodeId, points: &[SetPoint]) -> Self {
        let node = bus.node(id);
        let states = node.into_iter().flat_map(Node::device_states);
        let gates = bus.gates(id);
        Self {
            bus: bus.index(),
            node: id,
            nmt: node.and_then(Node::nmt),
            states: states.map(|(channel, state)| (channel, state.name.clone())).collect(),
            lost: node.is_some_and(Node::is_lost),
            errors: node.map_or_else(Vec::new, |node| node.active_errors().to_vec()),
            dtcs: node.map_or_else(Vec::new, |node| node.active_dtcs().collect()),
            set_points: points.iter().map(|point| PointState::new(point, &gates)).collect(),
        }
    }

    /// Whether a gate of any set point is closed.
    pub(crate) fn has_closed_gate(&self) -> bool {
        self.set_points.iter().any(|point| point.effective == EffectiveState::No)
    }

    /// Closed gates without duplicates.
    pub fn closed_gates(&self) -> Vec<&GateState> {
        let mut closed: Vec<&GateState> = Vec::new();
        let gates = self.set_points.iter().flat_map(|point| &point.gates);
        for gate in gates.filter(|gate| gate.status == GateStatus::Closed) {
            if !closed.iter().any(|known| known.gate == gate.gate && known.text == gate.text) {
                closed.push(gate);
            }
        }
        closed
    }
}

impl PointState {
    fn new(point: &SetPoint, gates: &[GateState]) -> Self {
        let mut gates: Vec<_> = gates.iter().filter(|gate| gate.set_point == point.object).cloned().collect();
        gates.sort_by_key(|gate| match gate.status {
            GateStatus::Closed => 0,
            GateStatus::Open => 1,
            GateStatus::Unknown => 2,
            GateStatus::Invisible => 3,
        });
        let any = |status| gates.iter().any(|gate| gate.status == status);
        let effective = match () {
            () if gates.is_empty() => point.effective,
            () if any(GateStatus::Closed) => EffectiveState::No,
            () if any(GateStatus::Unknown) => EffectiveState::Unknown,
            () => EffectiveState::Yes,
        };
        Self { point: point.clone(), effective, gates }
    }

    /// Whether `other` has the same gates in the same state.
    pub(crate) fn has_equal_gates(&self, other: &Self) -> bool {
        let seen = |point: &Self| {
            let gates = point.gates.iter().map(|gate| (gate.gate.clone(), gate.status, gate.detail.clone()));
            gates.collect::<Vec<_>>()
        };
        self.effective == other.effective && seen(self) == seen(other)
    }
}
