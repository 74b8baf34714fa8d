//! The rules devices bring: `[[rule]]` of their profiles.
//!
//! ```text
//! Event ─DeviceRules─▶ nodes it concerns ─▶ Happening ─judge─▶ one file a family of kinds ─▶ Context
//! ```
//!
//! A device's rules come to life where a node is known to be that device. What a kind of statement means is told in
//! `profile/device/rule.rs`; nothing here knows a device.

mod attached;
mod carried;
mod conditions;
mod counts;
mod dispatch;
mod frames;
mod happening;
mod info;
mod judge;
mod order;
mod pdo;
mod plan;
mod proofs;
mod times;
mod values;

use std::sync::Arc;

use attached::Attached;
use conditions::Scene;
use dispatch::{Judged, Now};
use plan::Plan;

use super::ledger::Ledger;
use super::{Context, NodeMap, Rule};
use crate::event::{Event, EventKind};
use crate::profile::Device;
use crate::profile::device::RuleKind;
use crate::query::KindSet;
use crate::session::{Bus, Node};
use crate::wire::NodeId;

/// Whether an event may make another device of a node.
pub(super) fn attaches(kind: &EventKind) -> bool {
    matches!(kind, EventKind::NodeIdentified(_) | EventKind::NodeIdChange { .. } | EventKind::AddressClaim(_))
}

/// Names of the same kinds.
const ATTACHING: [&str; 3] = ["node-identified", "node-id-change", "address-claim"];

/// The rules of all devices of a bus.
pub(super) struct DeviceRules {
    nodes: NodeMap<Box<Attached>>,
    /// The nodes among them.
    ids: Vec<NodeId>,
    plans: Vec<Arc<Plan>>,
    pdos: pdo::Pdos,
}

impl DeviceRules {
    /// The rules of the devices a bus is known to have.
    pub(super) fn new(bus: &Bus, ledger: &mut Ledger) -> Self {
        let mut rules = Self {
            nodes: NodeMap::default(),
            ids: Vec::new(),
            plans: Vec::new(),
            pdos: pdo::Pdos::default(),
        };
        rules.attach(bus, ledger);
        rules
    }

    /// Gives each node the rules of the device it is now.
    fn attach(&mut self, bus: &Bus, ledger: &mut Ledger) {
        for id in NodeId::all() {
            let device = bus.node(id).filter(|node| node.assigned().is_some()).map(Node::device);
            let device = device.filter(|device| !device.rules.is_empty());
            let same = match (self.nodes.get(id), device) {
                (Some(own), Some(device)) => Arc::ptr_eq(&own.known.plan.device, device),
                (None, None) => true,
                _ => false,
            };
            if same {
                continue;
            }
            self.nodes.remove(id);
            if let Some(device) = device {
                let plan = self.plan(device, ledger);
                self.nodes.insert(id, Box::new(Attached::new(&plan)));
            }
        }
        self.plans.retain(|plan| Arc::strong_count(plan) > 1);
        self.ids = self.nodes.iter().map(|(id, _)| id).collect();
        self.pdos.forget();
    }

    /// The plan of a device, made if new.
    fn plan(&mut self, device: &Arc<Device>, ledger: &mut Ledger) -> Arc<Plan> {
        if let Some(known) = self.plans.iter().find(|plan| Arc::ptr_eq(&plan.device, device)) {
            return Arc::clone(known);
        }
        let plan = Arc::new(Plan::new(device, ledger));
        self.plans.push(Arc::clone(&plan));
        plan
    }

    /// Kinds of events they look at.
    pub(super) fn wanted(&self) -> KindSet {
        let attaching = KindSet::by_name(|name| ATTACHING.contains(&name));
        self.nodes.iter().fold(attaching, |kinds, (id, own)| {
            let (canopen, j1939) = own.known.plan.kinds;
            kinds.or(if id.canopen().is_some() { canopen } else { j1939 })
        })
    }

    /// A node has another number; what its rules remember goes with it, times apart.
    fn follow(&mut self, event: &Event) {
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
            own.withdraw();
            self.nodes.insert(to, own);
        }
    }

    /// Judges at one node.
    fn at(&mut self, id: NodeId, bus: &Bus, judged: impl FnOnce(&mut Judged<'_>)) {
        at(&mut self.nodes, id, bus, judged);
    }
}

/// Judges at one node.
#[inline]
fn at(nodes: &mut NodeMap<Box<Attached>>, id: NodeId, bus: &Bus, judged: impl FnOnce(&mut Judged<'_>)) {
    let (Some(node), Some(mut own)) = (bus.node(id), nodes.remove(id)) else { return };
    judged(&mut Judged { bus, id, node, own: &mut own, others: nodes });
    nodes.insert(id, own);
}

impl Rule for DeviceRules {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if attaches(&event.kind) {
            self.follow(event);
            self.attach(context.bus, context.ledger);
        }
        match &event.kind {
            EventKind::Pdo(pdo) => self.pdo(pdo, event, context),
            EventKind::J1939Message(message) => self.message(message, event, context),
            EventKind::Frame(undecoded) => {
                let frame = &undecoded.frame;
                self.reserved(Some(frame.id), event, context, &|case, context| {
                    frames::frame(case, frame, context);
                });
            }
            _ => self.other(event, context),
        }
    }

    fn kinds(&self) -> Option<KindSet> {
        Some(self.wanted())
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let Some(id) = self.ids.iter().copied().find(|id| id.place() as u64 == token >> 16) else { return };
        let Ok(number) = usize::try_from(token & 0xFFFF) else { return };
        let bus = context.bus;
        self.at(id, bus, |judged| {
            judged.one(number, Now::passed(bus), context, judge::due);
        });
    }

    fn finish(&mut self, context: &mut Context<'_>) {
        let bus = context.bus;
        for id in self.ids.clone() {
            self.at(id, bus, |judged| {
                judged.heard(context);
                for number in judged.numbers(|rule| rule.kind == RuleKind::MaxInterval) {
                    judged.one(number, Now::passed(bus), context, times::still_missing);
                }
            });
        }
    }
}
