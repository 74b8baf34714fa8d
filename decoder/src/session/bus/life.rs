//! How a node stands, for whoever shows it: set points as told last, starts, signs of life.

use std::sync::Arc;

use super::cadence::Cadence;
use super::node::Node;
use super::set_point::{SetPointState, StandingPoint};
use super::state::Bus;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Nanoseconds behind which the silence of a device says more than messages to it.
const SILENT: i64 = 1_000_000_000;

/// By what a node shows that it lives.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Watch {
    /// Its heartbeat.
    Heartbeat,
    /// Its answers to guarding.
    Guarding,
    /// A message it must get in time.
    Message(Arc<str>),
    /// It was not heard since it started.
    Boot,
    /// Any frame of it.
    Any,
}

/// The last sign of life, and when the next one is due.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sign {
    /// What is watched.
    pub by: Watch,
    /// Monotonic time of the last one.
    pub last: i64,
    /// Nanoseconds in which the next one comes, if known.
    pub expected: Option<i64>,
    /// Nanoseconds behind which it counts as lost.
    pub limit: Option<i64>,
}

impl Node {
    /// Set points told since the last start.
    pub fn set_points(&self) -> impl Iterator<Item = StandingPoint<'_>> {
        self.behaviour.set_points.iter().filter_map(SetPointState::standing)
    }

    /// Frame of its last start, and its monotonic time.
    pub fn started(&self) -> Option<(u64, i64)> {
        self.behaviour.boot.map(|boot| (boot.frame, boot.time))
    }

    /// First frame heard of it; 0 for none.
    pub fn first_seen(&self) -> u64 {
        self.first_frame
    }

    /// Whether a master guards it.
    pub fn is_guarded(&self) -> bool {
        self.guarding.seen
    }

    /// Last raw number of an object that travels in its PDOs and matters to what it does.
    pub fn word_of(&self, object: ObjectAddress) -> Option<u64> {
        self.behaviour.word(object)
    }
}

impl Bus {
    /// How a node shows that it lives; `None` if it was never heard.
    pub fn sign_of_life(&self, id: NodeId) -> Option<Sign> {
        let node = self.node(id).filter(|node| node.last_frame != 0)?;
        let (heartbeat, guarding) = (&node.heartbeat, &node.guarding);
        if let (Some(last), Some(expected)) = (heartbeat.last, heartbeat.expected()) {
            let limit = Some(expected.saturating_mul(2));
            return Some(Sign { by: Watch::Heartbeat, last, expected: Some(expected), limit });
        }
        if let Some(last) = guarding.last_reply {
            let number = |index| node.store.number(ObjectAddress::new(index, 0)).filter(|number| *number > 0);
            let time = number(0x100C).and_then(|time| i64::try_from(time).ok());
            let expected = time.map(|time| time.saturating_mul(1_000_000));
            let factor = number(0x100D).and_then(|factor| i64::try_from(factor).ok());
            let limit = expected.zip(factor).map(|(time, factor)| time.saturating_mul(factor));
            return Some(Sign { by: Watch::Guarding, last, expected, limit });
        }
        let rests = self.clock.now().saturating_sub(node.last_heard);
        let cadences = self.routes.cadences().filter(|cadence| cadence.limit().0 == id);
        let due = |cadence: &&Cadence| cadence.last().map(|last| last.saturating_add(cadence.limit().1));
        let first = cadences.filter(|cadence| cadence.last().is_some()).min_by_key(due);
        if let Some(cadence) = first.filter(|_| rests <= SILENT) {
            let (_, limit) = cadence.limit();
            let by = Watch::Message(Arc::clone(cadence.name()));
            return Some(Sign { by, last: cadence.last()?, expected: Some(limit), limit: Some(limit) });
        }
        let is_boot = node.started().is_some_and(|(frame, _)| frame == node.last_frame);
        let by = if is_boot { Watch::Boot } else { Watch::Any };
        Some(Sign { by, last: node.last_heard, expected: None, limit: None })
    }
}
