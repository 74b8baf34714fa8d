//! Nodes of a bus that have device rules.

use std::sync::Arc;

use super::node::NodeRules;
use super::node_judge::NodeJudge;
use super::plan::RulePlan;
use crate::event::{Event, EventKind, Kind, KindSet};
use crate::profile::device::DeviceRule;
use crate::profile::{DeviceProfile, plain_device};
use crate::rules::ledger::FindingLedger;
use crate::session::{Bus, Node};
use crate::wire::{NodeId, NodeMap};

/// Whether an event may change the device profile of a node.
pub(in crate::rules) fn may_attach(kind: &EventKind) -> bool {
    matches!(kind, EventKind::NodeIdentified(_) | EventKind::NodeIdChange { .. } | EventKind::AddressClaim(_))
}

/// Event kinds of [`may_attach`].
const ATTACHING: KindSet = KindSet::of(&[Kind::NodeIdentified, Kind::NodeIdChange, Kind::AddressClaim]);

/// Nodes with their rules.
#[derive(Default)]
pub(super) struct NodeRoster {
    pub(super) nodes: NodeMap<Box<NodeRules>>,
    pub(super) ids: Vec<NodeId>,
    /// Rule plans, one per device, and one per node with rules of its own.
    plans: Vec<Arc<RulePlan>>,
}

impl NodeRoster {
    /// Assigns the rules of its current device to each node.
    pub(super) fn attach_rules(&mut self, bus: &Bus, ledger: &mut FindingLedger) {
        for id in NodeId::all_ids() {
            let added = ledger.node_rules(bus.name(), id);
            let assigned = bus.node(id).filter(|node| node.assigned_by().is_some()).map(Node::device);
            let with_rules = assigned.filter(|device| !device.rules.is_empty());
            // The first frame of a node that is not assigned to a device does not call this function.
            let device = match with_rules {
                None if !added.is_empty() => Some(bus.node(id).map_or(plain_device(), Node::device)),
                device => device,
            };
            let is_same = match (self.nodes.get(id), device) {
                (Some(own), Some(device)) => Arc::ptr_eq(&own.record.plan.device, device),
                (None, None) => true,
                _ => false,
            };
            if is_same {
                continue;
            }
            self.nodes.remove(id);
            if let Some(device) = device {
                let plan = self.plan_for(device, added, ledger);
                self.nodes.insert(id, Box::new(NodeRules::new(&plan)));
            }
        }
        self.plans.retain(|plan| Arc::strong_count(plan) > 1);
        self.ids = self.nodes.iter().map(|(id, _)| id).collect();
    }

    fn plan_for(
        &mut self,
        device: &Arc<DeviceProfile>,
        added: Vec<Arc<DeviceRule>>,
        ledger: &mut FindingLedger,
    ) -> Arc<RulePlan> {
        let is_shared = |plan: &&Arc<RulePlan>| Arc::ptr_eq(&plan.device, device) && plan.added.is_empty();
        if let Some(known) = self.plans.iter().find(is_shared).filter(|_| added.is_empty()) {
            return Arc::clone(known);
        }
        let plan = Arc::new(RulePlan::new(device, added, ledger));
        self.plans.push(Arc::clone(&plan));
        plan
    }

    /// Event kinds that the rules need.
    pub(super) fn needed_kinds(&self) -> KindSet {
        self.nodes.iter().fold(ATTACHING, |kinds, (id, own)| {
            let (canopen, j1939) = own.record.plan.kinds;
            kinds.or(if id.canopen().is_some() { canopen } else { j1939 })
        })
    }

    /// Moves the state of rules to the new number of a node, without times.
    pub(super) fn move_node(&mut self, event: &Event) {
        let (from, to) = match &event.kind {
            EventKind::NodeIdChange { from: Some(from), to, .. } => {
                (NodeId::Canopen(*from), NodeId::Canopen(*to))
            }
            EventKind::AddressClaim(claim) => match claim.from {
                Some(from) => (NodeId::J1939(from), NodeId::J1939(claim.source)),
                None => return,
            },
            _ => return,
        };
        if from != to
            && to.is_valid()
            && let Some(mut own) = self.nodes.remove(from)
        {
            own.reset_measurements();
            // The new number is checked at its first frame.
            (own.is_present, own.record.present) = (false, None);
            self.nodes.insert(to, own);
        }
    }

    /// Forgets the last payloads of PDOs, but not their values.
    pub(super) fn drop_carriers(&mut self) {
        for id in &self.ids {
            if let Some(own) = self.nodes.get_mut(*id) {
                own.record.last.drop_carriers();
            }
        }
    }

    /// Calls a task for one node.
    #[inline]
    pub(super) fn judge_at(&mut self, id: NodeId, bus: &Bus, task: impl FnOnce(&mut NodeJudge<'_>)) {
        let (Some(node), Some(mut own)) = (bus.node(id), self.nodes.remove(id)) else { return };
        task(&mut NodeJudge { bus, id, node, own: &mut own, others: &self.nodes });
        self.nodes.insert(id, own);
    }

    /// Whether a node needs SYNC events: it has rules about SYNC, or has not sent a frame yet.
    pub(super) fn waits_for_sync(&self, id: NodeId) -> bool {
        self.nodes.get(id).is_some_and(|own| !own.is_present || !own.record.plan.syncs.is_empty())
    }
}
