//! A measured value does not follow its set point.

use std::sync::Arc;

use crate::event::{Effective, Event, EventKind, FrameRange, ModeChange, Pdo, SetPoint};
use crate::finding::About;
use crate::profile::{Carrier, Cut, Layout, Meaning, integer};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{BySlot, Context, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A measured value stays away from the set point that the device's profile pairs with it, by more than a share of
    /// full scale, while that set point acts, and does not come nearer. Nothing is judged in open-loop modes, where
    /// calibrations or ramps run, where a condition of the set point is not known, and where another set point of
    /// the same output is followed, or is not measured: that one may limit.
    ///
    /// # Why it matters
    /// The machine does not do what is commanded: something sticks, leaks, or is limited by another controller.
    ///
    /// # Source
    /// Pairs of set point and measured value: the device's manual.
    ///
    /// # What to look at first
    /// Pressure and flow that are there at all, limits of other controllers, the sensor of the measured value.
    ///
    /// # Mutation
    /// set the measured value in a TPDO to 0
    "not-following", Warning, "a measured value does not follow its set point",
    kinds: ["tpdo", "set-point", "boot-up", "mode"],
    is_timing: true,
    word: "FOLLOW",
    tolerances: &[
        tolerance("percent", 10.0, "%", "of full scale between set point and measured value"),
        tolerance("valve-ms", 500.0, "ms", "for which a valve (CiA 408) may be off"),
        tolerance("pump-ms", 1_500.0, "ms", "for which any other device may be off"),
    ],
}

/// Pairs remembered on a bus; further ones are not judged.
const PAIR_LIMIT: usize = 1024;

/// What comes nearer by this part of the tolerance is on its way.
const NEARER: f64 = 0.2;

/// A set point and what follows it.
struct Pair {
    node: NodeId,
    set_point: ObjectAddress,
    channel: Option<u8>,
    name: String,
    unit: String,
    time: i64,
    target: Option<f64>,
    actual: Option<f64>,
    full_scale: Option<f64>,
    /// Off since then, by so much at first.
    since: Option<(i64, f64)>,
    frame: u64,
    is_told: bool,
    /// A wake is asked for.
    is_queued: bool,
}

/// Fields of a layout that follow a set point.
#[derive(Default)]
struct Paired {
    layout: Option<Arc<Layout>>,
    node: Option<NodeId>,
    /// Their places, those of the pairs they belong to, and where their numbers lie.
    fields: Vec<(usize, usize, Option<Cut>)>,
    /// Which pairs there were when it was looked at last.
    generation: u64,
}

struct NotFollowing {
    share: f64,
    valve: i64,
    pump: i64,
    pairs: Vec<Pair>,
    paired: BySlot<Paired>,
    /// Counts up with the pairs: a payload that stays as it is is looked at once more.
    generation: u64,
    /// Outputs whose mode closes no loop; without a channel the whole device.
    open_loop: Vec<(NodeId, Option<u8>)>,
}

fn new(policy: &Policy) -> NotFollowing {
    NotFollowing {
        share: policy.tolerance(&DECLARATION, "percent") / 100.0,
        valve: policy.nanoseconds(&DECLARATION, "valve-ms"),
        pump: policy.nanoseconds(&DECLARATION, "pump-ms"),
        pairs: Vec::new(),
        paired: BySlot::default(),
        generation: 0,
        open_loop: Vec::new(),
    }
}

impl NotFollowing {
    fn set_point(&mut self, event: &Event, id: NodeId, told: &SetPoint, context: &mut Context<'_>) {
        let (Carrier::Pdo(_), Some(node)) = (&told.carrier, context.node(event)) else { return };
        // A state that follows the control word shows that the contents of the PDOs are as assumed.
        let is_sure = !told.assumed || node.device_states().next().is_some();
        let acts = told.effective == Effective::Yes && is_sure && !self.is_open_loop(id, told.channel);
        let known = self.pairs.iter().position(|pair| pair.node == id && pair.set_point == told.object);
        let place = match known {
            Some(place) => place,
            None if self.pairs.len() < PAIR_LIMIT => {
                let is_valve = node.device().extends.iter().any(|standard| standard == "cia408");
                self.pairs.push(Pair {
                    node: id,
                    set_point: told.object,
                    channel: told.channel,
                    name: String::new(),
                    unit: String::new(),
                    time: if is_valve { self.valve } else { self.pump },
                    target: None,
                    actual: None,
                    full_scale: None,
                    since: None,
                    frame: 0,
                    is_told: false,
                    is_queued: false,
                });
                self.generation += 1;
                self.pairs.len() - 1
            }
            None => return,
        };
        let share = self.share;
        let Some(pair) = self.pairs.get_mut(place) else { return };
        pair.target = told.to.number.filter(|_| acts);
        // What was measured before belongs to another set point.
        pair.since = None;
        pair.judge(place, share, event.frames.last, context);
    }

    /// A mode that says by the profile whether the loop is closed; others say nothing of it.
    fn mode(&mut self, event: &Event, id: NodeId, mode: &ModeChange, context: &Context<'_>) {
        let Some(node) = context.node(event) else { return };
        let entry = node.device().dictionary.find(mode.object).and_then(|found| found.entry);
        let Some(entry) = entry.filter(|entry| !entry.open_loop.is_empty()) else { return };
        let value = node.meaning(mode.object).zip(node.store().get(mode.object));
        let value = value.and_then(|(meaning, held)| integer(&meaning.decode(&held.value)));
        let place = (id, mode.channel);
        self.open_loop.retain(|known| *known != place);
        if value.is_some_and(|value| entry.open_loop.contains(&value)) && self.open_loop.len() < PAIR_LIMIT {
            self.open_loop.push(place);
        }
    }

    fn is_open_loop(&self, id: NodeId, channel: Option<u8>) -> bool {
        let is_of = |of: &(NodeId, Option<u8>)| of.0 == id && (of.1.is_none() || of.1 == channel);
        self.open_loop.iter().any(is_of)
    }

    fn pdo(&mut self, event: &Event, pdo: &Pdo, context: &mut Context<'_>) {
        let (Some(layout), Some(slot), Some(node)) = (&pdo.layout, context.traffic.current(), event.node)
        else {
            return;
        };
        let Some(paired) = self.paired.of(slot) else { return };
        let is_known = paired.layout.as_ref().is_some_and(|known| Arc::ptr_eq(known, layout))
            && paired.generation == self.generation
            && paired.node == Some(node);
        if !is_known {
            paired.learn(layout, node, &self.pairs);
            paired.generation = self.generation;
        } else if event.routine {
            return;
        }
        for (field, place, cut) in &paired.fields {
            let (Some(field), Some(pair)) = (layout.fields.get(*field), self.pairs.get_mut(*place)) else {
                continue;
            };
            let raw = match cut {
                Some(cut) => cut.number(pdo.word(), usize::from(pdo.length)).map(i64::cast_unsigned),
                None => field.extract(pdo.payload()),
            };
            let (Some(meaning), Some(raw)) = (&field.meaning, raw) else { continue };
            pair.actual = meaning.scaled(&field.value(raw));
            if pair.full_scale.is_none() {
                pair.learn(meaning);
            }
            pair.judge(*place, self.share, event.frames.last, context);
        }
    }
}

impl Paired {
    #[cold]
    fn learn(&mut self, layout: &Arc<Layout>, node: NodeId, pairs: &[Pair]) {
        let fields = layout.fields.iter().enumerate().filter_map(|(place, field)| {
            let of = field.meaning.as_deref()?.of?;
            let pair = pairs.iter().position(|pair| pair.node == node && pair.set_point == of)?;
            Some((place, pair, Cut::of(field)))
        });
        self.fields = fields.collect();
        (self.layout, self.node) = (Some(Arc::clone(layout)), Some(node));
    }
}

/// The largest quantity of a measured value.
fn full_scale(meaning: &Meaning) -> Option<f64> {
    let scale = meaning.scale?;
    if let Some((_, value)) = scale.full_scale {
        return Some(value);
    }
    if let Some([least, most]) = meaning.limits {
        return Some(least.abs().max(most.abs()));
    }
    let [least, most] = meaning.range?;
    #[expect(clippy::cast_precision_loss, reason = "a range of a few digits")]
    let raw = least.unsigned_abs().max(most.unsigned_abs()) as f64;
    Some(raw * scale.factor.abs())
}

impl Pair {
    #[cold]
    fn learn(&mut self, meaning: &Meaning) {
        self.full_scale = full_scale(meaning).filter(|scale| *scale > 0.0);
        self.name.clone_from(&meaning.name);
        self.unit.clone_from(&meaning.unit);
    }

    /// How far it is off, and how far it may be.
    fn off(&self, share: f64) -> Option<(f64, f64)> {
        Some(((self.actual? - self.target?).abs(), self.full_scale? * share))
    }

    fn judge(&mut self, place: usize, share: f64, frame: u64, context: &mut Context<'_>) {
        self.frame = frame;
        let Some((off, most)) = self.off(share) else { return self.follows(context) };
        if off <= most {
            self.follows(context);
            return context.pass();
        }
        let comes_nearer = self.since.is_some_and(|(_, at_first)| off < at_first - most * NEARER);
        if !std::mem::replace(&mut self.is_queued, true) {
            context.wake_at(context.now.saturating_add(self.time), place as u64);
        }
        if self.since.is_none() || comes_nearer {
            self.since = Some((context.now, off));
        }
    }

    fn follows(&mut self, context: &mut Context<'_>) {
        self.since = None;
        if std::mem::take(&mut self.is_told) {
            context.close(Some(self.node), About::Object(self.set_point));
        }
    }
}

impl Rule for NotFollowing {
    fn wants_pdos(&self) -> bool {
        !self.pairs.is_empty()
    }

    #[inline]
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Pdo(pdo), _) if !self.pairs.is_empty() => self.pdo(event, pdo, context),
            (EventKind::SetPoint(point), Some(node)) => self.set_point(event, node, point, context),
            (EventKind::BootUp { .. }, Some(node)) => {
                for pair in self.pairs.iter_mut().filter(|pair| pair.node == node) {
                    (pair.target, pair.actual, pair.full_scale) = (None, None, None);
                    pair.follows(context);
                }
                self.generation += 1;
            }
            (EventKind::Mode(mode), Some(node)) => self.mode(event, node, mode, context),
            _ => {}
        }
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let Some(place) = usize::try_from(token).ok() else { return };
        let Some(pair) = self.pairs.get_mut(place) else { return };
        pair.is_queued = false;
        let Some(pair) = self.pairs.get(place).filter(|pair| !pair.is_told) else { return };
        let Some((since, _)) = pair.since else { return };
        let due = since.saturating_add(pair.time);
        let limits = self.pairs.iter().any(|other| {
            let is_same = (other.node, other.channel) == (pair.node, pair.channel);
            // What is not measured may limit too.
            is_same && other.target.is_some() && other.off(self.share).is_none_or(|(off, most)| off <= most)
        });
        if due > context.now || limits {
            let again = if limits { context.now.saturating_add(pair.time) } else { due };
            context.wake_at(again, token);
            if let Some(pair) = self.pairs.get_mut(place) {
                pair.is_queued = true;
            }
            return;
        }
        let (Some((off, _)), Some(target), Some(actual)) = (pair.off(self.share), pair.target, pair.actual)
        else {
            return;
        };
        let alarm = context.fail_at(context.now, Some(pair.node), FrameRange::one(pair.frame));
        let alarm = alarm.about(About::Object(pair.set_point)).measure(off).ongoing();
        alarm.say(|| {
            let (name, unit, time) = (&pair.name, &pair.unit, pair.time / 1_000_000);
            format!(
                "{name} {actual:.1} {unit}, set point {target:.1} {unit}, for {time} ms and not coming nearer"
            )
        });
        if let Some(pair) = self.pairs.get_mut(place) {
            pair.is_told = true;
        }
    }
}
