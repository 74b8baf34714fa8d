//! PDOs and J1939 messages: what of each identifier the rules look at, worked out once.

use std::sync::Arc;

use super::attached::SeenValue;
use super::carried::{Load, Payload, Use};
use super::dispatch::{Judged, Now, waits_for};
use super::frames;
use super::happening::{Came, Happening, Way};
use super::judge;
use super::plan::Plan;
use super::{DeviceRules, at};
use crate::event::{Event, J1939Message, Pdo};
use crate::profile::device::{DeviceRule, Direction, Mapping, RuleKind, Trigger};
use crate::profile::{Device, Field, Layout, PdoDirection, PdoName};
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
    load: Load,
    /// Rules about requests for it.
    requests: Vec<usize>,
}

impl Pdos {
    /// What is known of identifiers may be wrong now.
    pub(super) fn forget(&mut self) {
        self.0.clear();
    }

    /// What is known of an identifier, unless its layout is another one by now.
    fn of(&self, place: usize, pdo: &Pdo) -> Option<&Slot> {
        let slot = self.0.get(place)?.as_ref()?;
        let is_same = match (&slot.layout, &pdo.layout) {
            (Some(known), Some(layout)) => Arc::ptr_eq(known, layout),
            (None, None) => true,
            _ => false,
        };
        is_same.then_some(slot)
    }

    fn put(&mut self, place: usize, slot: Slot) {
        if self.0.len() <= place {
            self.0.resize_with(place + 1, || None);
        }
        if let Some(known) = self.0.get_mut(place) {
            *known = Some(slot);
        }
    }
}

impl DeviceRules {
    pub(super) fn pdo(&mut self, pdo: &Pdo, event: &Event, context: &mut Context<'_>) {
        let Some(place) = context.traffic.current().map(|slot| slot.place) else { return };
        if self.pdos.of(place, pdo).is_none() {
            let slot = self.slot(pdo, event, context);
            self.pdos.put(place, slot);
        }
        let Some(slot) = self.pdos.0.get(place).and_then(Option::as_ref) else { return };
        for target in &slot.targets {
            at(&mut self.nodes, target.id, context.bus, |judged| judged.pdo(target, pdo, event, context));
        }
        if slot.is_reserved {
            let id = pdo.cob_id;
            self.reserved(Some(id), event, context, &|case, context| frames::pdo_id(case, pdo, context));
        }
    }

    /// What rules look at of an identifier.
    #[cold]
    fn slot(&self, pdo: &Pdo, event: &Event, context: &Context<'_>) -> Slot {
        let mut slot = Slot { layout: pdo.layout.clone(), ..Slot::default() };
        for (id, own) in self.nodes.iter().filter(|(id, _)| id.canopen().is_some()) {
            let plan = &own.known.plan;
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
            self.at(id, bus, |judged| {
                let is_sender = message.id.source == address;
                let is_receiver = message.id.destination == ALL || message.id.destination == address;
                let device = Arc::clone(&judged.own.known.plan.device);
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
    let numbers = |picks: &dyn Fn(&DeviceRule) -> bool| {
        let picked = plan.rules().filter(|(_, rule)| picks(rule));
        picked.map(|(number, _)| number).collect::<Vec<_>>()
    };
    let way = if name.direction == PdoDirection::Receive { Way::Received } else { Way::Sent };
    let load = Load::new(layout, way, numbers(&|rule| waits_for(rule, name)), plan);
    let requests = numbers(&|rule| is_own && rule.kind == RuleKind::RemoteLength);
    let is_empty = load.is_empty() && requests.is_empty();
    (!is_empty).then_some(Target { id, name, is_own, load, requests })
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
    #[inline]
    fn pdo(&mut self, target: &Target, pdo: &Pdo, event: &Event, context: &mut Context<'_>) {
        let now = Now::of(event);
        self.present(now, context);
        if pdo.is_request {
            for number in target.requests.iter().copied() {
                self.one(number, now, context, |case, _, context| frames::remote_length(case, pdo, context));
            }
            return;
        }
        let payload = Payload::new(pdo.layout.as_ref(), pdo.payload(), &pdo.bytes);
        self.carried(&Happening::Pdo(target.name), &target.load, &payload, event, context);
        if target.is_own && target.load.way == Way::Sent {
            self.own.known.heard = Some(context.now);
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
        let load = self.own.loads.take(message, way).unwrap_or_else(|| {
            let waits = |trigger: &Trigger| matches!(trigger, Trigger::Message(of) if of.name == name);
            let rules = self.numbers(|rule| super::plan::triggers(rule).any(waits));
            Load::new(message.layout.as_deref(), way, rules, &self.own.known.plan)
        });
        let carrier = Happening::Message(name, message.id.pgn);
        let payload = Payload::new(message.layout.as_ref(), message.payload(), &message.bytes);
        self.carried(&carrier, &load, &payload, event, context);
        self.own.loads.put(message, load);
        self.heard(context);
    }

    /// A PDO or message came: all its values first, since conditions see them together.
    fn carried(
        &mut self,
        carrier: &Happening<'_>,
        load: &Load,
        payload: &Payload<'_>,
        event: &Event,
        context: &mut Context<'_>,
    ) {
        let now = Now::of(event);
        let mut before = std::mem::take(&mut self.own.scratch);
        before.clear();
        let mut follows = false;
        let (time, frame, is_sent) = (context.now, event.frames.last, load.way == Way::Sent);
        for one in &load.uses {
            let (known, came) = (self.own.known.seen.raw(one.place), one.number(payload));
            if let Some(raw) = came {
                follows |= known != came && !one.stretches.is_empty();
                if one.decides {
                    self.own.known.seen.decides(known != came, self.node.store().changes());
                }
                self.own.known.seen.put(one.place, SeenValue { raw, time, frame, is_sent });
            }
            before.push((known, came));
        }
        for number in load.rules.iter().copied() {
            if !self.scene(time).rests(number) {
                self.one(number, now, context, |case, course, context| {
                    judge::happened(case, course, carrier, context);
                });
            }
        }
        for (one, (known, came)) in load.uses.iter().zip(before.iter().copied()) {
            let Some(raw) = came else { continue };
            for clause in &one.clauses {
                if clause.judges(known, raw) && !self.scene(time).rests(clause.number) {
                    self.value(one, clause.number, (known, raw), load.way, payload, now, context);
                }
            }
        }
        if follows {
            self.follow(load, &before, now, context);
        }
        self.own.scratch = before;
    }

    /// One value of a PDO or message, judged by one rule.
    #[expect(clippy::too_many_arguments, reason = "which value, how it came, who judges it")]
    fn value(
        &mut self,
        one: &Use,
        number: usize,
        (known, raw): (Option<i64>, i64),
        way: Way,
        payload: &Payload<'_>,
        now: Now<'_>,
        context: &mut Context<'_>,
    ) {
        let field = payload.layout.and_then(|layout| layout.fields.get(one.field));
        let (Some(object), Some(field)) = (field.and_then(Field::object), field) else { return };
        let before = known.or_else(|| self.node.proven(object).map(|(raw, _)| raw));
        let came = Came {
            object,
            way,
            raw: Some(raw),
            before,
            bytes: &[],
            meaning: field.meaning.as_deref(),
            is_fresh: before.is_none() && self.own.known.seen.is_fresh,
        };
        self.one(number, now, context, |case, course, context| {
            judge::happened(case, course, &Happening::Came(came), context);
        });
    }

    /// Values changed from which a `while` may hold or not.
    #[cold]
    fn follow(
        &mut self,
        load: &Load,
        before: &[(Option<i64>, Option<i64>)],
        now: Now<'_>,
        context: &mut Context<'_>,
    ) {
        let mut place = 0;
        while let Some(number) = self.own.known.plan.stretches.get(place).copied() {
            let mut values = load.uses.iter().zip(before);
            let is_concerned = values.any(|(one, (known, came))| {
                came.is_some() && known != came && one.stretches.contains(&number)
            });
            if is_concerned {
                self.one(number, now, context, judge::look_again);
            }
            place += 1;
        }
    }
}
