//! Gates: conditions under which a set point takes effect.

use super::node::Node;
use super::reception::{ReceptionObstacle, SYNC_GATE, reception_obstacles};
use super::set_point::{GateVerdict, GatedSetPoint};
use crate::event::EffectiveState;
use crate::frame::CanId;
use crate::profile::ValueCarrier;
use crate::profile::device::{DeviceCondition, Gate, GateFallback, GateStatus, PdoEffect};
use crate::wire::canopen::ObjectAddress;

/// Highest transmission type that waits for SYNC (CiA 301 §7.5.2.35).
const LAST_SYNCHRONOUS: u64 = 240;

/// State of one gate for one set point.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GateState {
    /// Object of the set point.
    pub set_point: ObjectAddress,
    /// Name of the set point.
    pub name: String,
    /// Name of the gate.
    pub gate: String,
    /// Result of the evaluation.
    pub status: GateStatus,
    /// Fact that decided: `state FAULT HOLD`, `5208:01 = 1`.
    pub detail: String,
    /// Effect of the closed gate, from the profile.
    pub text: String,
    /// Action that opens the gate, from the profile.
    pub check: String,
    /// Section of the manual.
    pub source: String,
}

impl GateState {
    /// What to do about the closed gate: the action that opens it, else its name with its effect.
    pub fn gate_advice(&self) -> String {
        match (self.check.as_str(), self.text.as_str()) {
            ("", "") => self.gate.clone(),
            ("", text) => format!("{}: {text}", self.gate),
            (check, _) => check.to_owned(),
        }
    }
}

impl Node {
    /// Whether an RPDO takes effect at the next SYNC; the profile overrides the transmission type.
    pub(in crate::session) fn waits_for_sync(&self, carrier: &ValueCarrier) -> bool {
        let ValueCarrier::Pdo(name) = *carrier else { return false };
        let spec = self.device.pdos.iter().find(|spec| spec.pdo == name);
        match spec.map(|spec| spec.effect).unwrap_or_default() {
            PdoEffect::AtSync => true,
            PdoEffect::AtOnce => false,
            PdoEffect::ByType => {
                let kind = self.store.number(ObjectAddress::new(name.communication_index(), 2));
                kind.is_some_and(|kind| kind <= LAST_SYNCHRONOUS)
            }
        }
    }

    /// All gates of all set points received, sorted by set point, closed ones first.
    pub(in crate::session) fn all_gates(
        &self,
        now: i64,
        consumers: impl Fn(CanId) -> String,
    ) -> Vec<GateState> {
        let mut all: Vec<GateState> = Vec::new();
        for point in &self.behaviour.set_points {
            let subject = point.gated_subject();
            let gates = SetPointGates::new(self, subject, now);
            for obstacle in gates.obstacles() {
                let commands = obstacle.id.map(|id| format!(", commands arrive on {id}h, {}", consumers(id)));
                all.push(GateState {
                    set_point: subject.object,
                    name: point.object_title().to_owned(),
                    gate: obstacle.gate.to_owned(),
                    status: obstacle.status,
                    detail: obstacle.detail + &commands.unwrap_or_default(),
                    text: String::new(),
                    check: obstacle.check.to_owned(),
                    source: obstacle.source.to_owned(),
                });
            }
            for gate in gates.gates() {
                let (status, detail) = gates.status_with_detail(gate);
                all.push(GateState {
                    set_point: subject.object,
                    name: point.object_title().to_owned(),
                    gate: gate.name.clone(),
                    status,
                    detail,
                    text: gate.text.clone(),
                    check: gate.check.clone(),
                    source: gate.source.clone(),
                });
            }
        }
        all.sort_by_key(|gate| (gate.set_point, gate.status != GateStatus::Closed));
        all
    }
}

/// Gates of one set point of a node at one time.
pub(in crate::session) struct SetPointGates<'a> {
    node: &'a Node,
    subject: GatedSetPoint<'a>,
    now: i64,
}

impl<'a> SetPointGates<'a> {
    /// Gates of a set point at the monotonic time `now`.
    pub(in crate::session) fn new(node: &'a Node, subject: GatedSetPoint<'a>, now: i64) -> Self {
        Self { node, subject, now }
    }

    /// Reasons for which the RPDO is not processed. A profile with a SYNC gate of its own decides about SYNC.
    fn obstacles(&self) -> Vec<ReceptionObstacle> {
        let mut conditions = self.gates().flat_map(|gate| gate.open.0.iter());
        let has_sync_gate = conditions.any(|condition| matches!(condition, DeviceCondition::Sync));
        let obstacles = reception_obstacles(self.node, self.subject);
        obstacles.into_iter().filter(|it| !(has_sync_gate && it.gate == SYNC_GATE)).collect()
    }

    fn gates(&self) -> impl Iterator<Item = &'a Gate> + use<'a> {
        let subject = self.subject;
        self.node.device.gates.iter().filter(move |gate| {
            gate.is_for(subject.object, subject.channel)
                && gate.pdo.is_none_or(|pdo| *subject.carrier == ValueCarrier::Pdo(pdo))
        })
    }

    /// Evaluates all gates of a set point.
    pub(in crate::session) fn gate_verdict(&self) -> GateVerdict {
        let (mut closed, mut unknown, mut invisible) = (Vec::new(), Vec::new(), Vec::new());
        let mut any = false;
        for obstacle in self.obstacles() {
            let list = if obstacle.status == GateStatus::Closed { &mut closed } else { &mut unknown };
            list.push(obstacle.gate.to_owned());
        }
        for gate in self.gates() {
            any = true;
            match self.gate_status(gate) {
                GateStatus::Closed => closed.push(gate.name.clone()),
                GateStatus::Unknown => unknown.push(gate.name.clone()),
                GateStatus::Invisible if gate.open.0.contains(&DeviceCondition::Invisible) => {
                    invisible.push(gate.name.clone());
                }
                GateStatus::Invisible | GateStatus::Open => {}
            }
        }
        match (closed.is_empty(), unknown.is_empty() && any) {
            (false, _) => GateVerdict { effective: EffectiveState::No, gates: closed, invisible },
            (true, true) => GateVerdict { effective: EffectiveState::Yes, gates: Vec::new(), invisible },
            (true, false) => GateVerdict { effective: EffectiveState::Unknown, gates: unknown, invisible },
        }
    }

    /// Evaluates one gate for a set point.
    fn gate_status(&self, gate: &Gate) -> GateStatus {
        let facts = self.node.facts_of(self.subject, self.now);
        let status = |open: &DeviceCondition| {
            with_otherwise(gate, open.evaluate_condition(&facts, self.subject.channel))
        };
        gate.open.0.iter().map(status).fold(GateStatus::Open, GateStatus::and)
    }

    /// Evaluates one gate and returns the fact that decided.
    fn status_with_detail(&self, gate: &Gate) -> (GateStatus, String) {
        let facts = self.node.facts_of(self.subject, self.now);
        let mut worst = (GateStatus::Open, String::new());
        for condition in &gate.open.0 {
            let found = condition.evaluate_condition(&facts, self.subject.channel);
            let status = with_otherwise(gate, found);
            let both = worst.0.and(status);
            if both != worst.0 || worst.1.is_empty() {
                worst = (both, facts.deciding_fact(condition, self.subject.channel, found));
            }
        }
        worst
    }
}

/// Applies `otherwise` of the gate to the result of a condition.
fn with_otherwise(gate: &Gate, status: GateStatus) -> GateStatus {
    match (status, gate.otherwise) {
        (GateStatus::Closed, GateFallback::Unknown) => GateStatus::Unknown,
        (status, _) => status,
    }
}
