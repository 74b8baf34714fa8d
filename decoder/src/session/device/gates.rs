//! Gates: whether a set point acts, and what keeps it from acting.

use crate::event::Effective;
use crate::profile::device::{Condition, Gate, Otherwise};
use crate::profile::{Carrier, PdoDirection, PdoName};
use crate::session::node::Node;
use crate::wire::canopen::ObjectAddress;

/// A SYNC this long ago still counts as coming, and for so long a set point waits for one, in nanoseconds.
pub(super) const SYNC_AGE: i64 = 1_000_000_000;

/// How a gate stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GateStatus {
    /// It lets the set point act.
    Open,
    /// It keeps it from acting.
    Closed,
    /// Nothing tells.
    Unknown,
    /// The bus never shows it; it does not count.
    Invisible,
}

impl GateStatus {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Closed => "closed",
            Self::Unknown => "unknown",
            Self::Invisible => "not on the bus",
        }
    }
}

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
pub(super) struct Verdict {
    pub(super) effective: Effective,
    /// Names of those that are closed, or of those nothing is known of.
    pub(super) gates: Vec<String>,
}

/// A set point as gates see it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Subject<'a> {
    pub(super) object: ObjectAddress,
    pub(super) channel: Option<u8>,
    pub(super) carrier: &'a Carrier,
}

const fn judged(holds: bool) -> GateStatus {
    if holds { GateStatus::Open } else { GateStatus::Closed }
}

/// How a value judges. A default that was never seen may let a set point act, but proves no obstacle.
fn value(object: ObjectAddress, raw: i64, assumed: bool, holds: bool) -> (GateStatus, String) {
    let doubt = if assumed { "?" } else { "" };
    let status = if assumed && !holds { GateStatus::Unknown } else { judged(holds) };
    (status, format!("{object} = {raw}{doubt}"))
}

impl Node {
    /// All gates of all set points seen, closed ones first.
    pub(in crate::session) fn gates(&self, now: i64) -> Vec<GateState> {
        let mut all: Vec<GateState> = Vec::new();
        for point in &self.behaviour.set_points {
            let subject = point.subject();
            for gate in self.gates_of(subject) {
                let (status, detail) = self.stands(gate, subject, now);
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
    pub(super) fn verdict(&self, subject: Subject<'_>, now: i64) -> Verdict {
        let (mut closed, mut unknown, mut any) = (Vec::new(), Vec::new(), false);
        for gate in self.gates_of(subject) {
            any = true;
            match self.stands(gate, subject, now).0 {
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

    fn stands(&self, gate: &Gate, subject: Subject<'_>, now: i64) -> (GateStatus, String) {
        let mut worst = (GateStatus::Open, String::new());
        for condition in &gate.open.0 {
            let (status, detail) = self.holds(condition, subject, now);
            let status = match (status, gate.otherwise) {
                (GateStatus::Closed, Otherwise::Unknown) => GateStatus::Unknown,
                (status, _) => status,
            };
            let is_worse = matches!(
                (worst.0, status),
                (GateStatus::Open | GateStatus::Invisible, GateStatus::Unknown | GateStatus::Closed)
                    | (GateStatus::Unknown, GateStatus::Closed)
                    | (GateStatus::Open, GateStatus::Invisible)
            );
            if is_worse || worst.1.is_empty() {
                worst = (if is_worse { status } else { worst.0 }, detail);
            }
        }
        worst
    }

    /// Whether a condition holds for an output of the device, of those that no other node and no certainty of the
    /// NMT state has a part in: `Closed` if it does not.
    pub fn meets(&self, condition: &Condition, channel: Option<u8>, now: i64) -> GateStatus {
        let carrier = Carrier::Pdo(PdoName { direction: PdoDirection::Receive, number: 1 });
        self.holds(condition, Subject { object: ObjectAddress::default(), channel, carrier: &carrier }, now).0
    }

    /// Whether a condition holds: `Closed` if it does not.
    pub(super) fn holds(
        &self,
        condition: &Condition,
        subject: Subject<'_>,
        now: i64,
    ) -> (GateStatus, String) {
        match condition {
            Condition::Nmt(wanted) => match self.nmt {
                Some(nmt) => (judged(nmt.state == wanted.state()), nmt.state.name().to_owned()),
                None => (GateStatus::Unknown, "NMT state not seen".into()),
            },
            Condition::Object { object, mask, values, negated } => {
                let Some((raw, assumed)) = self.raw(object.object) else {
                    return (GateStatus::Unknown, format!("{} not seen", object.object));
                };
                let masked = if *mask == u64::MAX { raw } else { (raw.cast_unsigned() & mask).cast_signed() };
                let holds = values.contains(masked) != *negated;
                value(object.object, raw, assumed, holds)
            }
            Condition::Inside { object, range: [least, most] } => {
                let Some((raw, assumed)) = self.raw(object.object) else {
                    return (GateStatus::Unknown, format!("{} not seen", object.object));
                };
                value(object.object, raw, assumed, (least..=most).contains(&&raw))
            }
            Condition::State(states) => self.in_state(states, subject.channel),
            Condition::Sync => {
                let age = self.behaviour.sync.map(|sync| now.saturating_sub(sync.time));
                (judged(age.is_some_and(|age| age <= SYNC_AGE)), "SYNC".into())
            }
            Condition::NoError => {
                let codes: Vec<_> = self.errors().collect();
                (judged(codes.is_empty()), codes.join(", "))
            }
            Condition::NoProcedure => {
                let running = self.behaviour.running.iter().find_map(|running| self.takes_over(running));
                (judged(running.is_none()), running.unwrap_or_default().to_owned())
            }
            // A PDO is judged when it comes; of messages it is known which are overdue.
            Condition::Younger(_) => match subject.carrier {
                Carrier::Message(name) if self.behaviour.overdue.contains(name) => {
                    (GateStatus::Closed, format!("{name} overdue"))
                }
                _ => (GateStatus::Open, String::new()),
            },
            Condition::Invisible => (GateStatus::Invisible, String::new()),
            // Of other nodes only rules know.
            Condition::Other(_) | Condition::Alone => (GateStatus::Unknown, String::new()),
        }
    }

    /// Whether the machine of a channel reports one of the states; unknown while it is on its way there.
    fn in_state(&self, states: &[String], channel: Option<u8>) -> (GateStatus, String) {
        let machines = self.device.machines.iter().enumerate();
        let mut own =
            machines.filter(|(_, it)| it.channel.is_none() || channel.is_none() || it.channel == channel);
        let Some((place, _)) = own.next() else { return (GateStatus::Unknown, "no state machine".into()) };
        match self.reported_state(place) {
            None => (GateStatus::Unknown, "state not reported yet".into()),
            Some(state) if states.contains(&state.name) => (GateStatus::Open, state.name.clone()),
            Some(state) if self.is_commanded(place, states) => {
                (GateStatus::Unknown, format!("{}, on its way", state.name))
            }
            Some(state) => (GateStatus::Closed, state.name.clone()),
        }
    }

    /// Raw number of an object: seen in a PDO, in the store, or as delivered.
    pub(super) fn raw(&self, object: ObjectAddress) -> Option<(i64, bool)> {
        if let Some(word) = self.behaviour.word(object) {
            return Some((word.cast_signed(), false));
        }
        let number = self.resolver().number(object)?;
        Some((number.raw, number.assumed))
    }
}
