//! Gates: conditions under which a set point takes effect.

use super::node::Node;
use super::set_point::GatedSetPoint;
use crate::event::EffectiveState;
use crate::frame::CanId;
use crate::profile::ValueCarrier;
use crate::profile::device::{DeviceCondition, Gate, GateFallback, GateStatus, PdoEffect};
use crate::session::bus::objects::{INVALID, OriginKind, nonzero_identifier};
use crate::wire::canopen::ObjectAddress;

/// Name of the gate of the COB-ID of an RPDO, which every device has.
const COB_ID: &str = "RPDO COB-ID";

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

/// Result of all gates of a set point.
pub(in crate::session) struct GateVerdict {
    pub(in crate::session) effective: EffectiveState,
    /// Names of the closed gates; if none is closed, of the unknown ones.
    pub(in crate::session) gates: Vec<String>,
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
            if let Some((detail, id)) = self.find_contradiction(subject) {
                let detail = format!("{detail}, commands arrive on {id}h, {}", consumers(id));
                all.push(GateState {
                    set_point: subject.object,
                    name: point.object_title().to_owned(),
                    gate: COB_ID.to_owned(),
                    status: GateStatus::Closed,
                    detail,
                    text: String::new(),
                    check: "send the commands on the configured COB-ID, or configure the one that is sent"
                        .to_owned(),
                    source: "CiA 301 §7.5.2.35".to_owned(),
                });
            }
            for gate in self.gates_of(subject) {
                let (status, detail) = self.status_with_detail(gate, subject, now);
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

    /// Contradiction between the configured COB-ID of an RPDO and the identifier on which it arrives
    /// (CiA 301 §7.5.2.35: bit 31 marks a PDO that is not valid). A set point received before the COB-ID was
    /// written remains in force.
    fn find_contradiction(&self, subject: GatedSetPoint<'_>) -> Option<(String, CanId)> {
        let (ValueCarrier::Pdo(name), Some((id, frame))) = (subject.carrier, subject.id) else { return None };
        let cob_id = self.configured_cob_id(*name)?;
        let object = ObjectAddress::new(name.communication_index(), 1);
        if cob_id & INVALID != 0 {
            return Some((format!("{object} = {cob_id:X}h (bit 31: not valid)"), id));
        }
        let origin = self.store.seen_value(object)?.origin;
        let is_later = origin.kind != OriginKind::Download || frame > origin.frame;
        let is_other = is_later && nonzero_identifier(cob_id) != Some(id);
        is_other.then(|| (format!("{object} = {cob_id:X}h"), id))
    }

    fn gates_of<'a>(&'a self, subject: GatedSetPoint<'a>) -> impl Iterator<Item = &'a Gate> {
        self.device.gates.iter().filter(move |gate| {
            gate.is_for(subject.object, subject.channel)
                && gate.pdo.is_none_or(|pdo| *subject.carrier == ValueCarrier::Pdo(pdo))
        })
    }

    /// Evaluates all gates of a set point.
    pub(in crate::session) fn gate_verdict(&self, subject: GatedSetPoint<'_>, now: i64) -> GateVerdict {
        let (mut closed, mut unknown, mut any) = (Vec::new(), Vec::new(), false);
        if self.find_contradiction(subject).is_some() {
            closed.push(COB_ID.to_owned());
        }
        for gate in self.gates_of(subject) {
            any = true;
            match self.gate_status(gate, subject, now) {
                GateStatus::Closed => closed.push(gate.name.clone()),
                GateStatus::Unknown => unknown.push(gate.name.clone()),
                GateStatus::Open | GateStatus::Invisible => {}
            }
        }
        match (closed.is_empty(), unknown.is_empty() && any) {
            (false, _) => GateVerdict { effective: EffectiveState::No, gates: closed },
            (true, true) => GateVerdict { effective: EffectiveState::Yes, gates: Vec::new() },
            (true, false) => GateVerdict { effective: EffectiveState::Unknown, gates: unknown },
        }
    }

    /// Evaluates one gate for a set point.
    fn gate_status(&self, gate: &Gate, subject: GatedSetPoint<'_>, now: i64) -> GateStatus {
        let facts = self.facts_of(subject, now);
        let status =
            |open: &DeviceCondition| with_otherwise(gate, open.evaluate_condition(&facts, subject.channel));
        gate.open.0.iter().map(status).fold(GateStatus::Open, GateStatus::and)
    }

    /// Evaluates one gate and returns the fact that decided.
    fn status_with_detail(&self, gate: &Gate, subject: GatedSetPoint<'_>, now: i64) -> (GateStatus, String) {
        let facts = self.facts_of(subject, now);
        let mut worst = (GateStatus::Open, String::new());
        for condition in &gate.open.0 {
            let found = condition.evaluate_condition(&facts, subject.channel);
            let status = with_otherwise(gate, found);
            let both = worst.0.and(status);
            if both != worst.0 || worst.1.is_empty() {
                worst = (both, facts.deciding_fact(condition, subject.channel, found));
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
