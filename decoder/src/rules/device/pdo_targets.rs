//! Dispatch table from PDOs to the rules of nodes, computed once per identifier.

use std::sync::Arc;

use super::carrier::{CarrierPlan, FieldEvidence};
use super::kinds::frames;
use super::node::NodeRules;
use super::plan::{RulePlan, waits_for};
use crate::event::{DecodedPdo, Event};
use crate::profile::device::{DeviceRule, MappingSource, PdoSpec, ProfileTrigger, RuleKind, UpdateSource};
use crate::profile::{DeviceProfile, LayoutOrigin, PayloadLayout, PdoDirection, PdoName, SignalField};
use crate::session::Bus;
use crate::wire::{NodeId, NodeMap};

/// Targets by index of the identifier.
#[derive(Debug, Default)]
pub(super) struct PdoTargets(Vec<Option<IdentifierTargets>>);

/// Targets of one identifier.
#[derive(Debug, Default)]
pub(super) struct IdentifierTargets {
    layout: Option<Arc<PayloadLayout>>,
    pub(super) targets: Vec<PdoTarget>,
    /// A device reserves the identifier.
    pub(super) is_reserved: bool,
}

/// A producer or consumer of a PDO.
#[derive(Debug)]
pub(super) struct PdoTarget {
    pub(super) id: NodeId,
    pub(super) name: PdoName,
    /// The PDO belongs to this node; false if the node consumes the PDO of another node.
    pub(super) is_own: bool,
    pub(super) plan: CarrierPlan,
    /// Index of the PDO in [`super::values::LastValues`], if its values are read from its last payload.
    pub(super) carrier: Option<u16>,
    /// Rules about remote requests for the PDO.
    pub(super) requests: Vec<usize>,
}

impl PdoTargets {
    /// Clears the table after a change of identifiers or rules.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// Targets by index of the identifier; None if not yet computed for this layout.
    #[inline]
    pub(super) fn get(&self, place: usize, pdo: &DecodedPdo) -> Option<&IdentifierTargets> {
        let known = self.0.get(place)?.as_ref()?;
        let is_same = match (&known.layout, &pdo.layout) {
            (Some(known), Some(layout)) => Arc::ptr_eq(known, layout),
            (None, None) => true,
            _ => false,
        };
        is_same.then_some(known)
    }

    pub(super) fn put_targets(&mut self, place: usize, targets: IdentifierTargets) {
        if self.0.len() <= place {
            self.0.resize_with(place + 1, || None);
        }
        if let Some(known) = self.0.get_mut(place) {
            *known = Some(targets);
        }
    }
}

impl IdentifierTargets {
    /// Whether no rule concerns the identifier.
    pub(super) const fn is_empty(&self) -> bool {
        self.targets.is_empty() && !self.is_reserved
    }

    /// Computes the targets for the identifier of a PDO.
    #[cold]
    pub(super) fn new(
        (place, pdo): (usize, &DecodedPdo),
        event: &Event,
        nodes: &mut NodeMap<Box<NodeRules>>,
        bus: &Bus,
    ) -> Self {
        let mut all = Self { layout: pdo.layout.clone(), ..Self::default() };
        for (id, own) in nodes.iter().filter(|(id, _)| id.canopen().is_some()) {
            let plan = &own.record.plan;
            all.is_reserved |= plan.active_rules().any(|(_, rule)| frames::is_reserved(rule, pdo.cob_id));
            let is_own = event.node == Some(id);
            let names = plan.pdos.iter().copied().filter(|name| !is_own || *name != pdo.name);
            let consumed =
                names.filter(|name| bus.pdo_identifier(id, *name).is_some_and(|(of, _)| of == pdo.cob_id));
            let all_names = consumed.map(|name| (name, false)).chain(is_own.then_some((pdo.name, true)));
            all.targets
                .extend(all_names.filter_map(|(name, is_own)| pdo_target(id, plan, name, is_own, pdo)));
        }
        for target in all.targets.iter_mut().filter(|target| target.plan.watched.is_some()) {
            let own = nodes.get_mut(target.id);
            target.carrier = own.and_then(|own| own.record.last.add_carrier(place, target.name));
        }
        all
    }
}

/// Rules of a node about a PDO; None if there are none.
fn pdo_target(
    id: NodeId,
    plan: &RulePlan,
    name: PdoName,
    is_own: bool,
    pdo: &DecodedPdo,
) -> Option<PdoTarget> {
    let layout = pdo.layout.as_deref().filter(|_| is_own);
    let device = &plan.device;
    let is_whole = layout.is_some_and(|layout| is_trusted(layout, device, pdo));
    let numbers = |picks: &dyn Fn(&DeviceRule) -> bool| {
        let picked = plan.active_rules().filter(|(_, rule)| picks(rule));
        picked.map(|(number, _)| number).collect::<Vec<_>>()
    };
    let is_received = name.direction == PdoDirection::Receive;
    let source = if is_received { UpdateSource::Received } else { UpdateSource::Sent };
    let constants =
        numbers(&|rule| rule.kind == RuleKind::Constant && rule.on.0.contains(&ProfileTrigger::Pdo(name)));
    let is_assumed = layout.is_some_and(|layout| is_default(layout, pdo));
    let evidence = |field: &SignalField| match () {
        () if is_whole || is_in_all_layouts(field, device, name) => FieldEvidence::Certain,
        () if is_assumed => FieldEvidence::Assumed,
        () => FieldEvidence::Unknown,
    };
    let plan = CarrierPlan::new(layout, &evidence, source, numbers(&|rule| waits_for(rule, name)), plan)
        .with_constants((layout.filter(|_| is_whole || is_assumed), !is_whole), constants);
    let requests = numbers(&|rule| is_own && rule.kind == RuleKind::RemoteLength);
    let is_empty = plan.is_empty() && requests.is_empty();
    (!is_empty).then_some(PdoTarget { id, name, is_own, plan, carrier: None, requests })
}

/// Whether a field is at the same place in all layouts of a PDO that the profile defines as fixed, so that its value is
/// certain in an unknown mode.
fn is_in_all_layouts(field: &SignalField, device: &DeviceProfile, name: PdoName) -> bool {
    let Some(object) = field.object() else { return false };
    let has_field = |spec: &PdoSpec| {
        let mut bit: u16 = 0;
        spec.mapping == MappingSource::Fixed
            && spec.fields.iter().any(|own| {
                let start = bit;
                bit = bit.saturating_add(own.bits);
                own.object.is_some_and(|of| of.object == object)
                    && (start, own.bits) == (field.bit, field.bits)
            })
    };
    let mut specs = device.pdos.iter().filter(|spec| spec.pdo == name).peekable();
    specs.peek().is_some() && specs.all(has_field)
}

/// Whether a mapping is the default of the profile, with the length of the PDO.
fn is_default(layout: &PayloadLayout, pdo: &DecodedPdo) -> bool {
    layout.origin == LayoutOrigin::Profile && layout.bits == u16::from(pdo.length) * 8
}

/// Whether the fields of a PDO are reliable: the mapping was seen on the wire, set by the user or is fixed. A
/// default mapping is reliable if the length matches and no mode selects the mapping.
fn is_trusted(layout: &PayloadLayout, device: &DeviceProfile, pdo: &DecodedPdo) -> bool {
    let mut specs = device.pdos.iter().filter(|spec| spec.pdo == pdo.name);
    !layout.assumed
        || is_default(layout, pdo)
            && specs.all(|spec| spec.mapping == MappingSource::Default && spec.when.is_none())
}
