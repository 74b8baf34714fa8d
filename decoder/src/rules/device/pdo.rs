//! PDOs and J1939 messages: what of each identifier the rules look at, worked out once.

use std::sync::Arc;

use super::DeviceRules;
use super::attached::SeenValue;
use super::dispatch::{Judged, Now, waits_for};
use super::frames;
use super::happening::{Came, Happening, Way};
use super::judge;
use super::plan::Plan;
use crate::event::{Event, J1939Message, Pdo};
use crate::profile::device::{Direction, Mapping, RuleKind, Trigger};
use crate::profile::{Device, Layout, PdoDirection, PdoName, integer};
use crate::rules::Context;
use crate::wire::NodeId;
use crate::wire::j1939::ALL;

/// What rules look at, by identifier.
#[derive(Debug, Default)]
pub(super) struct Pdos(Vec<Option<Slot>>);

/// One identifier.
#[derive(Debug, Default)]
struct Slot {
    layout: Option<Arc<Layout>>,
    targets: Vec<Target>,
    is_reserved: bool,
}

/// A node that sends a PDO, or listens to it.
#[derive(Debug)]
struct Target {
    id: NodeId,
    name: PdoName,
    /// Its own: else another node's that it listens to.
    is_own: bool,
    /// Fields of the layout that count, and the places of their objects in the plan.
    uses: Vec<(usize, usize)>,
    /// Rules that wait for the PDO.
    rules: Vec<usize>,
    /// Rules about requests for it.
    requests: Vec<usize>,
}

impl Pdos {
    /// What is known of identifiers may be wrong now.
    pub(super) fn forget(&mut self) {
        self.0.clear();
    }
}

impl DeviceRules {
    pub(super) fn pdo(&mut self, pdo: &Pdo, event: &Event, context: &mut Context<'_>) {
        let Some(place) = context.traffic.current().map(|slot| slot.place) else { return };
        if self.pdos.0.len() <= place {
            self.pdos.0.resize_with(place + 1, || None);
        }
        let known = self.pdos.0.get_mut(place).and_then(Option::take);
        let same = known.filter(|slot| match (&slot.layout, &pdo.layout) {
            (Some(known), Some(layout)) => Arc::ptr_eq(known, layout),
            (None, None) => true,
            _ => false,
        });
        let slot = same.unwrap_or_else(|| self.slot(pdo, event, context));
        let bus = context.bus;
        for target in &slot.targets {
            self.at(target.id, bus, &mut |judged| judged.pdo(target, pdo, event, context));
        }
        if slot.is_reserved {
            let id = pdo.cob_id;
            self.reserved(Some(id), event, context, &|case, context| frames::pdo_id(case, pdo, context));
        }
        if let Some(known) = self.pdos.0.get_mut(place) {
            *known = Some(slot);
        }
    }

    /// What rules look at of an identifier.
    #[cold]
    fn slot(&self, pdo: &Pdo, event: &Event, context: &Context<'_>) -> Slot {
        let mut slot = Slot { layout: pdo.layout.clone(), ..Slot::default() };
        for (id, own) in self.nodes.iter().filter(|(id, _)| id.canopen().is_some()) {
            let plan = &own.plan;
            slot.is_reserved |= plan.rules().any(|(_, rule)| frames::reserves(rule, pdo.cob_id));
            let is_own = event.node == Some(id);
            let names = plan.pdos.iter().copied().filter(|name| !is_own || *name != pdo.name);
            let listened = names
                .filter(|name| context.bus.pdo_identifier(id, *name).is_some_and(|(of, _)| of == pdo.cob_id));
            let all = listened.map(|name| (name, false)).chain(is_own.then_some((pdo.name, true)));
            slot.targets.extend(all.filter_map(|(name, is_own)| target(id, plan, name, is_own, pdo)));
        }
        slot
    }

    pub(super) fn message(&mut self, message: &J1939Message, event: &Event, context: &mut Context<'_>) {
        let bus = context.bus;
        for place in 0..self.ids.len() {
            let Some(id) = self.ids.get(place).copied() else { return };
            let Some(address) = id.j1939() else { continue };
            self.at(id, bus, &mut |judged| {
                let is_sender = message.id.source == address;
                let is_receiver = message.id.destination == ALL || message.id.destination == address;
                let device = Arc::clone(&judged.own.plan.device);
                let spec = device.messages.iter().find(|spec| {
                    let is_meant = match spec.direction {
                        Direction::Transmit => is_sender,
                        Direction::Receive => is_receiver && !is_sender,
                    };
                    is_meant && spec.concerns(message.id.pgn, address)
                });
                if let Some(spec) = spec {
                    let way = if is_sender { Way::Sent } else { Way::Received };
                    judged.message((&spec.name, way), message, event, context);
                }
            });
        }
    }
}

/// What a node's rules look at of a PDO; `None` where that is nothing.
fn target(id: NodeId, plan: &Plan, name: PdoName, is_own: bool, pdo: &Pdo) -> Option<Target> {
    let layout = pdo.layout.as_deref().filter(|layout| is_own && is_trusted(layout, &plan.device, pdo));
    let uses: Vec<_> = layout.map_or_else(Vec::new, |layout| uses(layout, plan));
    let rules: Vec<_> =
        plan.rules().filter(|(_, rule)| waits_for(rule, name)).map(|(number, _)| number).collect();
    let requests: Vec<_> = plan
        .rules()
        .filter(|(_, rule)| is_own && rule.kind == RuleKind::RemoteLength)
        .map(|(number, _)| number)
        .collect();
    let is_empty = uses.is_empty() && rules.is_empty() && requests.is_empty();
    (!is_empty).then_some(Target { id, name, is_own, uses, rules, requests })
}

/// Fields of a layout whose objects count, with the places of these in the plan.
fn uses(layout: &Layout, plan: &Plan) -> Vec<(usize, usize)> {
    let fields = layout.fields.iter().enumerate();
    fields.filter_map(|(place, field)| Some((place, plan.watched(field.object()?)?.0))).collect()
}

/// Whether the fields of a PDO are known: told, given or fixed, or as delivered where the length fits and no mode
/// decides.
fn is_trusted(layout: &Layout, device: &Device, pdo: &Pdo) -> bool {
    let mut specs = device.pdos.iter().filter(|spec| spec.pdo == pdo.name);
    !layout.assumed
        || layout.origin == "profile"
            && layout.bits == u16::from(pdo.length) * 8
            && specs.all(|spec| spec.mapping == Mapping::Default && spec.when.is_none())
}

impl Judged<'_> {
    fn pdo(&mut self, target: &Target, pdo: &Pdo, event: &Event, context: &mut Context<'_>) {
        let now = Now::of(event);
        self.present(now, context);
        if pdo.is_request {
            for number in target.requests.iter().copied() {
                self.one(number, now, context, &mut |case, _, context| {
                    frames::remote_length(case, pdo, context);
                });
            }
            return;
        }
        let way = if target.name.direction == PdoDirection::Receive { Way::Received } else { Way::Sent };
        let layout = pdo.layout.as_deref().map(|layout| (layout, pdo.payload()));
        let carrier = Happening::Pdo(target.name);
        self.carried(&carrier, &target.rules, way, layout, &target.uses, event, context);
        if target.is_own && way == Way::Sent {
            self.own.heard = Some(context.now);
        }
    }

    fn message(
        &mut self,
        (name, way): (&str, Way),
        message: &J1939Message,
        event: &Event,
        context: &mut Context<'_>,
    ) {
        self.present(Now::of(event), context);
        let waits = |trigger: &Trigger| matches!(trigger, Trigger::Message(of) if of.name == name);
        let rules = self.numbers(|rule| super::plan::triggers(rule).any(waits));
        let layout = message.layout.as_deref();
        let uses = layout.map_or_else(Vec::new, |layout| uses(layout, &self.own.plan));
        let carrier = Happening::Message(name, message.id.pgn);
        let layout = layout.map(|layout| (layout, message.payload()));
        self.carried(&carrier, &rules, way, layout, &uses, event, context);
        self.heard(context);
    }

    /// A PDO or message came: all its values first, since conditions see them together.
    #[expect(clippy::too_many_arguments, reason = "what came, what it carries, who waits for it")]
    fn carried(
        &mut self,
        carrier: &Happening<'_>,
        rules: &[usize],
        way: Way,
        layout: Option<(&Layout, &[u8])>,
        uses: &[(usize, usize)],
        event: &Event,
        context: &mut Context<'_>,
    ) {
        let now = Now::of(event);
        let mut before = std::mem::take(&mut self.own.scratch);
        before.clear();
        let mut changed = false;
        for (field, place) in uses.iter().copied() {
            let known = self.own.seen.get(place).map(|value| value.raw);
            let came = layout.and_then(|(layout, payload)| {
                let field = layout.fields.get(field)?;
                integer(&field.value(field.extract(payload)?))
            });
            if let Some(raw) = came {
                let decides = || self.own.plan.at(place).is_some_and(|watched| watched.is_condition);
                changed |= known != Some(raw) && decides();
                let (time, frame) = (context.now, event.frames.last);
                self.own.seen.put(place, SeenValue { raw, time, frame, is_sent: way == Way::Sent });
            }
            before.push((known, came));
        }
        for number in rules.iter().copied() {
            self.one(number, now, context, &mut |case, course, context| {
                judge::happened(case, course, carrier, context);
            });
        }
        for ((field, place), (known, came)) in uses.iter().copied().zip(before.iter().copied()) {
            let field = layout.and_then(|(layout, _)| layout.fields.get(field));
            let (Some(raw), Some(field)) = (came, field) else { continue };
            self.value(place, field, (known, raw), way, now, context);
        }
        if changed {
            self.look_again(now, context);
        }
        self.own.scratch = before;
    }

    /// One value of a PDO or message.
    fn value(
        &mut self,
        place: usize,
        field: &crate::profile::Field,
        (known, raw): (Option<i64>, i64),
        way: Way,
        now: Now<'_>,
        context: &mut Context<'_>,
    ) {
        let plan = Arc::clone(&self.own.plan);
        let Some(watched) = plan.at(place).filter(|watched| !watched.rules.is_empty()) else { return };
        let before = known.or_else(|| self.node.proven(watched.object).map(|(raw, _)| raw));
        let came = Came {
            object: watched.object,
            way,
            raw: Some(raw),
            before,
            bytes: &[],
            meaning: field.meaning.as_deref(),
            is_fresh: before.is_none() && self.own.seen.is_fresh,
        };
        for number in watched.rules.iter().copied() {
            self.one(number, now, context, &mut |case, course, context| {
                judge::happened(case, course, &Happening::Came(came), context);
            });
        }
    }
}
