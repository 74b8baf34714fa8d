//! Gates: whether a set point acts, and what keeps it from acting.

use super::node::Node;
use super::set_point::Subject;
use crate::event::Effective;
use crate::profile::Carrier;
use crate::profile::device::{Condition, Gate, GateStatus, Otherwise};
use crate::wire::canopen::ObjectAddress;

/// One gate of one set point.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GateState {
    /// Set point.
    pub set_point: ObjectAddress,
    /// Its name.
    pub name: String,
    /// Name of the gate.
    pub gate: String,
    /// How it stands.
    pub status: GateStatus,
    /// What it found: `state FAULT HOLD`, `5208:01 = 1`.
    pub detail: String,
    /// What a closed gate means.
    pub text: String,
    /// What to do about it.
    pub check: String,
    /// Section of the manual.
    pub source: String,
}

/// What a set point's gates amount to.
pub(in crate::session) struct Verdict {
    pub(in crate::session) effective: Effective,
    /// Names of those that are closed, or of those nothing is known of.
    pub(in crate::session) gates: Vec<String>,
}

impl Node {
    /// All gates of all set points seen, closed ones first.
    pub(in crate::session) fn gates(&self, now: i64) -> Vec<GateState> {
        let mut all: Vec<GateState> = Vec::new();
        for point in &self.behaviour.set_points {
            let subject = point.subject();
            for gate in self.gates_of(subject) {
                let (status, detail) = self.status_with_detail(gate, subject, now);
                all.push(GateState {
                    set_point: subject.object,
                    name: point.title().to_owned(),
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

    fn gates_of<'a>(&'a self, subject: Subject<'a>) -> impl Iterator<Item = &'a Gate> {
        self.device.gates.iter().filter(move |gate| {
            gate.concerns(subject.object, subject.channel)
                && gate.pdo.is_none_or(|pdo| *subject.carrier == Carrier::Pdo(pdo))
        })
    }

    /// Whether a set point acts.
    pub(in crate::session) fn verdict(&self, subject: Subject<'_>, now: i64) -> Verdict {
        let (mut closed, mut unknown, mut any) = (Vec::new(), Vec::new(), false);
        for gate in self.gates_of(subject) {
            any = true;
            match self.status(gate, subject, now) {
                GateStatus::Closed => closed.push(gate.name.clone()),
                GateStatus::Unknown => unknown.push(gate.name.clone()),
                GateStatus::Open | GateStatus::Invisible => {}
            }
        }
        match (closed.is_empty(), unknown.is_empty() && any) {
            (false, _) => Verdict { effective: Effective::No, gates: closed },
            (true, true) => Verdict { effective: Effective::Yes, gates: Vec::new() },
            (true, false) => Verdict { effective: Effective::Unknown, gates: unknown },
        }
    }

    /// Status of a gate of a set point.
    fn status(&self, gate: &Gate, subject: Subject<'_>, now: i64) -> GateStatus {
        let facts = self.facts_of(subject, now);
        let status = |open: &Condition| with_otherwise(gate, open.evaluate(&facts, subject.channel));
        gate.open.0.iter().map(status).fold(GateStatus::Open, GateStatus::and)
    }

    /// The same, with the fact that decided it.
    fn status_with_detail(&self, gate: &Gate, subject: Subject<'_>, now: i64) -> (GateStatus, String) {
        let facts = self.facts_of(subject, now);
        let mut worst = (GateStatus::Open, String::new());
        for condition in &gate.open.0 {
            let found = condition.evaluate(&facts, subject.channel);
            let status = with_otherwise(gate, found);
            let both = worst.0.and(status);
            if both != worst.0 || worst.1.is_empty() {
                worst = (both, facts.detail(condition, subject.channel, found));
            }
        }
        worst
    }
}

/// Status of a gate by that of one of its conditions.
fn with_otherwise(gate: &Gate, status: GateStatus) -> GateStatus {
    match (status, gate.otherwise) {
        (GateStatus::Closed, Otherwise::Unknown) => GateStatus::Unknown,
        (status, _) => status,
    }
}
