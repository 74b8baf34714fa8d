//! What a rule knows of a node when it judges: whether conditions are proven, or proven not to hold.

use super::attached::{Attached, Known};
use super::happening::{masked, show};
use crate::profile::device::{Condition, GateStatus};
use crate::rules::NodeMap;
use crate::rules::context::{SETTLING, confirmed_state};
use crate::session::{Bus, Node};
use crate::wire::NodeId;
use crate::wire::canopen::{NmtState, ObjectAddress};

/// A measured value holds for so long, in nanoseconds.
const MEASURED: i64 = 2_000_000_000;

/// A node that sent nothing for so long is not there, in nanoseconds.
const ALONE: i64 = 10_000_000_000;

/// Whether something holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Proof {
    /// It is proven to.
    Holds,
    /// It is proven not to.
    Fails,
    /// Nothing tells.
    Unknown,
}

impl Proof {
    const fn of(holds: bool) -> Self {
        if holds { Self::Holds } else { Self::Fails }
    }

    /// Of both: it fails where one does.
    const fn and(self, other: Self) -> Self {
        match (self, other) {
            (Self::Fails, _) | (_, Self::Fails) => Self::Fails,
            (Self::Holds, Self::Holds) => Self::Holds,
            _ => Self::Unknown,
        }
    }
}

/// A node with what its rules remember of it, and the other nodes of its bus.
#[derive(Clone, Copy)]
pub(super) struct Scene<'a> {
    pub(super) bus: &'a Bus,
    pub(super) id: NodeId,
    pub(super) node: &'a Node,
    pub(super) own: &'a Known,
    pub(super) others: &'a NodeMap<Box<Attached>>,
    /// Time in the clock of the rules.
    pub(super) now: i64,
}

impl Scene<'_> {
    /// Whether all conditions hold, for an output of the device.
    pub(super) fn all(&self, conditions: &[Condition], channel: Option<u8>) -> Proof {
        self.of(conditions.iter(), channel)
    }

    /// The same of some of them.
    pub(super) fn of<'c>(
        &self,
        mut conditions: impl Iterator<Item = &'c Condition>,
        channel: Option<u8>,
    ) -> Proof {
        conditions
            .try_fold(Proof::Holds, |proof, condition| match proof.and(self.holds(condition, channel)) {
                Proof::Fails => Err(Proof::Fails),
                proof => Ok(proof),
            })
            .unwrap_or_else(|fails| fails)
    }

    /// A condition that is proven not to hold: the object it is about, and what there is instead.
    pub(super) fn unmet(
        &self,
        conditions: &[Condition],
        channel: Option<u8>,
    ) -> Option<(Option<ObjectAddress>, String)> {
        let failed = conditions.iter().find(|condition| self.holds(condition, channel) == Proof::Fails)?;
        let object = match failed {
            Condition::Object { object, .. } | Condition::Inside { object, .. } => Some(object.object),
            _ => None,
        };
        Some((object, self.instead(failed, channel)))
    }

    fn holds(&self, condition: &Condition, channel: Option<u8>) -> Proof {
        match condition {
            Condition::Nmt(wanted) => match confirmed_state(self.bus, self.id) {
                Some(state) => Proof::of(state == wanted.state()),
                None => Proof::Unknown,
            },
            Condition::Object { object, mask, values, negated } => match self.value(object.object) {
                Some(raw) => Proof::of(values.contains(masked(raw, *mask)) != *negated),
                None => Proof::Unknown,
            },
            Condition::Inside { object, range: [least, most] } => match self.value(object.object) {
                Some(raw) => Proof::of((*least..=*most).contains(&raw)),
                None => Proof::Unknown,
            },
            Condition::State(_) if self.own.is_settling(channel, self.now, SETTLING) => Proof::Unknown,
            Condition::Other(conditions) => self.other(&conditions.0),
            Condition::Alone => Proof::of(self.is_alone()),
            _ => match condition.evaluate(&self.node.facts(self.bus.now()), channel) {
                GateStatus::Open => Proof::Holds,
                GateStatus::Closed => Proof::Fails,
                GateStatus::Unknown | GateStatus::Invisible => Proof::Unknown,
            },
        }
    }

    /// The number an object holds, where that is sure: what the bus showed last.
    pub(super) fn value(&self, object: ObjectAddress) -> Option<i64> {
        let watched = self.own.plan.watched(object);
        let is_measured = watched.is_some_and(|(_, watched)| watched.is_measured);
        let sent = watched.and_then(|(place, _)| self.own.seen.get(place));
        let sent = sent.filter(|sent| !is_measured || self.now.saturating_sub(sent.time) <= MEASURED);
        // What the node holds may have come by other ways, and later.
        let is_later = |frame| self.node.store().seen(object).is_some_and(|entry| entry.origin.frame > frame);
        if let Some(sent) = sent.filter(|sent| !is_later(sent.frame)) {
            return Some(sent.raw);
        }
        let stored = self.node.proven(object).filter(|(_, origin)| {
            let time = origin.time.map(|stamp| self.bus.monotonic(stamp));
            !is_measured || time.is_none_or(|time| self.bus.now().saturating_sub(time) <= MEASURED)
        });
        match (sent, stored) {
            (Some(sent), Some((raw, origin))) => Some(if origin.frame > sent.frame { raw } else { sent.raw }),
            (Some(sent), None) => Some(sent.raw),
            (None, stored) => stored.map(|(raw, _)| raw),
        }
    }

    /// Whether one other node of the same profile meets all conditions.
    fn other(&self, conditions: &[Condition]) -> Proof {
        let mut all = Proof::Fails;
        for (id, own) in self.others.iter().filter(|(id, _)| *id != self.id) {
            let own = &own.known;
            let Some(node) = self.bus.node(id).filter(|_| own.plan.device.id == self.own.plan.device.id)
            else {
                continue;
            };
            match (Scene { id, node, own, ..*self }).all(conditions, None) {
                Proof::Holds => return Proof::Holds,
                Proof::Unknown => all = Proof::Unknown,
                Proof::Fails => {}
            }
        }
        all
    }

    fn is_alone(&self) -> bool {
        let is_heard = |node: &Node| {
            let (frame, stamp) = node.last_seen();
            let age = stamp.map_or(0, |stamp| self.bus.now().saturating_sub(self.bus.monotonic(stamp)));
            frame != 0 && age <= ALONE
        };
        let mut nodes = self.bus.nodes().filter(|node| node.id() != self.id && node.id().canopen().is_some());
        !nodes.any(is_heard)
    }

    /// Whether the node is sure to send and receive PDOs.
    pub(super) fn is_operational(&self) -> bool {
        let confirmed = confirmed_state(self.bus, self.id) == Some(NmtState::Operational);
        confirmed && !self.node.is_lost()
    }

    /// What there is instead of a condition that does not hold.
    fn instead(&self, condition: &Condition, channel: Option<u8>) -> String {
        match condition {
            Condition::Nmt(_) => self.node.nmt().map_or("", |nmt| nmt.state.name()).to_owned(),
            Condition::Object { object, .. } | Condition::Inside { object, .. } => self.shown(object.object),
            Condition::State(_) => {
                let mut states = self.node.device_states();
                let own = states.find(|(of, _)| channel.is_none() || of.is_none() || *of == channel);
                own.map_or_else(String::new, |(_, state)| format!("state {}", state.name))
            }
            Condition::Sync => "no SYNC".to_owned(),
            Condition::NoError => {
                let codes: Vec<_> =
                    self.node.active_errors().iter().map(|code| format!("EMCY {code:04X}")).collect();
                codes.join(", ")
            }
            Condition::NoProcedure => {
                let names: Vec<_> = self.node.procedures().map(|it| it.name.as_str()).collect();
                format!("{} runs", names.join(", "))
            }
            Condition::Other(_) => "no other one is ready".to_owned(),
            Condition::Alone => "there are other nodes".to_owned(),
            Condition::Younger(_) | Condition::Invisible => String::new(),
        }
    }

    /// An object with its value: `5208:01 = 1`.
    pub(super) fn shown(&self, object: ObjectAddress) -> String {
        let value = self.value(object);
        let raw = value.unwrap_or_default();
        match self.node.meaning(object) {
            Some(meaning) => format!("{object} is {}", show(&meaning, raw)),
            None => format!("{object} is {raw}"),
        }
    }
}
