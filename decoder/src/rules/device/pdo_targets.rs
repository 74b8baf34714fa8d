//! Which rules of which nodes look at a PDO, computed once per identifier.

use std::sync::Arc;

use super::carrier::CarrierPlan;
use super::kinds::frames;
use super::node::NodeRules;
use super::plan::{RulePlan, waits_for};
use crate::event::{Event, Pdo};
use crate::profile::device::{DeviceRule, Mapping, RuleKind, UpdateSource};
use crate::profile::{Device, Layout, PdoDirection, PdoName};
use crate::rules::NodeMap;
use crate::session::Bus;
use crate::wire::NodeId;

/// Targets by the place of their identifier.
#[derive(Debug, Default)]
pub(super) struct PdoTargets(Vec<Option<IdentifierTargets>>);

/// Targets of one identifier.
#[derive(Debug, Default)]
pub(super) struct IdentifierTargets {
    layout: Option<Arc<Layout>>,
    pub(super) targets: Vec<PdoTarget>,
    /// A device reserves the identifier.
    pub(super) is_reserved: bool,
}

/// A node that produces a PDO, or consumes it.
#[derive(Debug)]
pub(super) struct PdoTarget {
    pub(super) id: NodeId,
    pub(super) name: PdoName,
    /// A PDO of the node, not of another node whose PDO it consumes.
    pub(super) is_own: bool,
    pub(super) plan: CarrierPlan,
    /// Rules about requests for it.
    pub(super) requests: Vec<usize>,
}

impl PdoTargets {
    /// Identifiers or rules may be others now.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Targets at a place; `None` if there are none for this layout yet.
    #[inline]
    pub(super) fn get(&self, place: usize, pdo: &Pdo) -> Option<&IdentifierTargets> {
        let known = self.0.get(place)?.as_ref()?;
        let is_same = match (&known.layout, &pdo.layout) {
            (Some(known), Some(layout)) => Arc::ptr_eq(known, layout),
            (None, None) => true,
            _ => false,
        };
        is_same.then_some(known)
    }

    pub(super) fn put(&mut self, place: usize, targets: IdentifierTargets) {
        if self.0.len() <= place {
            self.0.resize_with(place + 1, || None);
        }
        if let Some(known) = self.0.get_mut(place) {
            *known = Some(targets);
        }
    }
}

impl IdentifierTargets {
    /// Targets of the identifier of a PDO.
    #[cold]
    pub(super) fn new(pdo: &Pdo, event: &Event, nodes: &NodeMap<Box<NodeRules>>, bus: &Bus) -> Self {
        let mut all = Self { layout: pdo.layout.clone(), ..Self::default() };
        for (id, own) in nodes.iter().filter(|(id, _)| id.canopen().is_some()) {
            let plan = &own.record.plan;
            all.is_reserved |= plan.rules().any(|(_, rule)| frames::is_reserved(rule, pdo.cob_id));
            let is_own = event.node == Some(id);
            let names = plan.pdos.iter().copied().filter(|name| !is_own || *name != pdo.name);
            let consumed =
                names.filter(|name| bus.pdo_identifier(id, *name).is_some_and(|(of, _)| of == pdo.cob_id));
            let all_names = consumed.map(|name| (name, false)).chain(is_own.then_some((pdo.name, true)));
            all.targets.extend(all_names.filter_map(|(name, is_own)| target(id, plan, name, is_own, pdo)));
        }
        all
    }
}

/// A node's rules about a PDO; `None` if there are none.
fn target(id: NodeId, plan: &RulePlan, name: PdoName, is_own: bool, pdo: &Pdo) -> Option<PdoTarget> {
    let layout = pdo.layout.as_deref().filter(|layout| is_own && is_trusted(layout, &plan.device, pdo));
    let numbers = |picks: &dyn Fn(&DeviceRule) -> bool| {
        let picked = plan.rules().filter(|(_, rule)| picks(rule));
        picked.map(|(number, _)| number).collect::<Vec<_>>()
    };
    let is_received = name.direction == PdoDirection::Receive;
    let source = if is_received { UpdateSource::Received } else { UpdateSource::Sent };
    let plan = CarrierPlan::new(layout, source, numbers(&|rule| waits_for(rule, name)), plan);
    let requests = numbers(&|rule| is_own && rule.kind == RuleKind::RemoteLength);
    let is_empty = plan.is_empty() && requests.is_empty();
    (!is_empty).then_some(PdoTarget { id, name, is_own, plan, requests })
}

/// Whether the fields of a PDO are known: from the wire, the user or a fixed mapping, or as delivered if the length fits
/// and no mode decides.
fn is_trusted(layout: &Layout, device: &Device, pdo: &Pdo) -> bool {
    let mut specs = device.pdos.iter().filter(|spec| spec.pdo == pdo.name);
    !layout.assumed
        || layout.origin == "profile"
            && layout.bits == u16::from(pdo.length) * 8
            && specs.all(|spec| spec.mapping == Mapping::Default && spec.when.is_none())
}
