//! Status of a node for display: set points, boot signs, signs of life.

use std::sync::Arc;

use super::nodes::{EmittedSetPoint, Node, SetPointState};
use super::state::Bus;
use super::time::Cadence;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Silence in ns after which the last frame of a device is shown instead of messages to it.
const SILENT: i64 = 1_000_000_000;

/// Sign of life of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LifeWatch {
    /// Heartbeat message.
    Heartbeat,
    /// Guarding response.
    Guarding,
    /// A message that the node must receive within a time limit.
    Message(Arc<str>),
    /// Boot sign, without any frame after it.
    Boot,
    /// Any frame of the node.
    Any,
}

/// Last sign of life, and the time until the next one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LifeSign {
    /// Type of the sign of life.
    pub by: LifeWatch,
    /// Monotonic time of the last sign, in ns.
    pub last: i64,
    /// Time until the next sign, in ns; `None` if unknown.
    pub expected: Option<i64>,
    /// Time after which the node is lost, in ns; `None` if unknown.
    pub limit: Option<i64>,
}

impl Node {
    /// Set points received since the last boot.
    pub fn set_points(&self) -> impl Iterator<Item = EmittedSetPoint<'_>> {
        self.behaviour.set_points.iter().filter_map(SetPointState::emitted_set_point)
    }

    /// Frame and monotonic time of the last boot.
    pub fn last_boot(&self) -> Option<(u64, i64)> {
        self.behaviour.boot.map(|boot| (boot.frame, boot.time))
    }

    /// Whether the bus file states that the node was present before the first frame.
    pub fn was_present(&self) -> bool {
        self.was_present
    }

    /// First frame of the node; 0 for none.
    pub fn first_seen(&self) -> u64 {
        self.first_frame
    }

    /// Whether an NMT master sends guarding requests to it.
    pub fn is_guarded(&self) -> bool {
        self.guarding.seen
    }
}

impl Bus {
    /// Last sign of life of a node; `None` if it never sent a frame.
    pub fn sign_of_life(&self, id: NodeId) -> Option<LifeSign> {
        let node = self.node(id).filter(|node| node.last_frame != 0)?;
        let (heartbeat, guarding) = (&node.heartbeat, &node.guarding);
        if let (Some(last), Some(expected)) = (heartbeat.last, heartbeat.expected_interval()) {
            let limit = Some(expected.saturating_mul(2));
            return Some(LifeSign { by: LifeWatch::Heartbeat, last, expected: Some(expected), limit });
        }
        if let Some(last) = guarding.last_reply {
            let number = |index| node.store.number(ObjectAddress::new(index, 0)).filter(|number| *number > 0);
            let time = number(0x100C).and_then(|time| i64::try_from(time).ok());
            let expected = time.map(|time| time.saturating_mul(1_000_000));
            let factor = number(0x100D).and_then(|factor| i64::try_from(factor).ok());
            let limit = expected.zip(factor).map(|(time, factor)| time.saturating_mul(factor));
            return Some(LifeSign { by: LifeWatch::Guarding, last, expected, limit });
        }
        let rests = self.clock.now().saturating_sub(node.last_received);
        let cadences = self.routes.cadences().filter(|cadence| cadence.max_interval().0 == id);
        let due = |cadence: &&Cadence| {
            cadence.last_reception().map(|last| last.saturating_add(cadence.max_interval().1))
        };
        let first = cadences.filter(|cadence| cadence.last_reception().is_some()).min_by_key(due);
        if let Some(cadence) = first.filter(|_| rests <= SILENT) {
            let (_, limit) = cadence.max_interval();
            let by = LifeWatch::Message(Arc::clone(cadence.name()));
            return Some(LifeSign {
                by,
                last: cadence.last_reception()?,
                expected: Some(limit),
                limit: Some(limit),
            });
        }
        let is_boot = node.last_boot().is_some_and(|(frame, _)| frame == node.last_frame);
        let by = if is_boot { LifeWatch::Boot } else { LifeWatch::Any };
        Some(LifeSign { by, last: node.last_received, expected: None, limit: None })
    }
}
