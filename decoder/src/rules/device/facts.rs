//! Proven facts about a node: values from the current PDO, and older values of all other objects.

use super::describe::show_number;
use super::node::{JudgedNode, NodeRules};
use crate::profile::DecidingNumber;
use crate::profile::device::DeviceFacts;
use crate::rules::context::{SETTLING, confirmed_state};
use crate::session::{Bus, Node};
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::{NodeId, NodeMap};

/// Maximum age of a proven measured value, in ns.
const MEASURED: i64 = 2_000_000_000;

/// Silence after which a node counts as absent, in ns.
const ALONE: i64 = 10_000_000_000;

/// A node with the shared state of its rules, and the other nodes of the bus.
#[derive(Clone, Copy)]
pub(super) struct ProvenFacts<'a> {
    pub(super) bus: &'a Bus,
    pub(super) id: NodeId,
    pub(super) node: &'a Node,
    pub(super) own: &'a JudgedNode,
    pub(super) others: &'a NodeMap<Box<NodeRules>>,
    /// Monotonic time, as in [`crate::rules::Context::now`].
    pub(super) now: i64,
}

impl ProvenFacts<'_> {
    /// Proven value of an object: the last one seen on the bus.
    pub(super) fn proven_value(&self, object: ObjectAddress) -> Option<i64> {
        let watched = self.own.plan.watched_object(object);
        let is_measured = watched.is_some_and(|(_, watched)| watched.is_measured);
        let sent = watched.and_then(|(place, _)| self.own.last.get(place));
        let sent = sent.filter(|sent| !is_measured || self.now.saturating_sub(sent.time) <= MEASURED);
        // The store of the node may contain a later value from another service.
        let is_later =
            |frame| self.node.store().seen_value(object).is_some_and(|entry| entry.origin.frame > frame);
        if let Some(sent) = sent.filter(|sent| !is_later(sent.frame)) {
            return Some(sent.raw);
        }
        let stored = self.node.proven_value(object).filter(|(_, origin)| {
            let time = origin.time.map(|stamp| self.bus.monotonic(stamp));
            !is_measured || time.is_none_or(|time| self.bus.now().saturating_sub(time) <= MEASURED)
        });
        match (sent, stored) {
            (Some(sent), Some((raw, origin))) => Some(if origin.frame > sent.frame { raw } else { sent.raw }),
            (Some(sent), None) => Some(sent.raw),
            (None, stored) => stored.map(|(raw, _)| raw),
        }
    }

    /// Whether the node is confirmed to send and receive PDOs.
    pub(super) fn is_operational(&self) -> bool {
        let confirmed = confirmed_state(self.bus, self.id) == Some(NmtState::Operational);
        confirmed && !self.node.is_lost()
    }

    /// Object with its value: `5208:01 is 1`.
    pub(super) fn value_text(&self, object: ObjectAddress) -> String {
        let value = self.proven_value(object);
        let raw = value.unwrap_or_default();
        match self.node.meaning(object) {
            Some(meaning) => format!("{object} is {}", show_number(&meaning, raw)),
            None => format!("{object} is {raw}"),
        }
    }
}

impl DeviceFacts for ProvenFacts<'_> {
    fn nmt_state(&self) -> Option<NmtState> {
        confirmed_state(self.bus, self.id)
    }

    fn object_number(&self, object: ObjectAddress) -> Option<DecidingNumber> {
        self.proven_value(object).map(|raw| DecidingNumber { raw, assumed: false })
    }

    /// None shortly after a change: a PDO may still contain the previous state.
    fn reported_state(&self, channel: Option<u8>) -> Option<&str> {
        if self.own.is_settling(channel, self.now, SETTLING) {
            return None;
        }
        self.node.node_facts(self.bus.now()).machine_state(channel).map(|state| state.name.as_str())
    }

    fn is_commanded(&self, channel: Option<u8>, states: &[String]) -> bool {
        self.node.node_facts(self.bus.now()).is_commanded(channel, states)
    }

    fn sync_age(&self) -> Option<i64> {
        self.node.node_facts(self.bus.now()).sync_age()
    }

    fn has_error(&self) -> bool {
        self.node.node_facts(self.bus.now()).has_error()
    }

    fn is_taken_over(&self) -> bool {
        self.node.node_facts(self.bus.now()).is_taken_over()
    }

    /// Always false: rules check PDOs and messages when they arrive.
    fn is_overdue(&self) -> bool {
        false
    }

    fn other_nodes(&self) -> Option<impl Iterator<Item = Self>> {
        let others = self.others.iter().filter(|(id, _)| *id != self.id);
        Some(others.filter_map(|(id, other)| {
            let own = &other.record;
            let node = self.bus.node(id).filter(|_| own.plan.device.id == self.own.plan.device.id)?;
            Some(ProvenFacts { id, node, own, ..*self })
        }))
    }

    fn is_alone(&self) -> Option<bool> {
        let is_received = |node: &Node| {
            let (frame, stamp) = node.last_seen();
            let age = stamp.map_or(0, |stamp| self.bus.now().saturating_sub(self.bus.monotonic(stamp)));
            frame != 0 && age <= ALONE
        };
        let mut nodes = self.bus.nodes().filter(|node| node.id() != self.id && node.id().canopen().is_some());
        Some(!nodes.any(is_received))
    }
}
