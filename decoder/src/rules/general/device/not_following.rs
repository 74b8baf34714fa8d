//! Measured values that do not follow their set point.

use std::sync::Arc;

use super::followed_messages::FollowedMessages;
use crate::event::{
    DecodedPdo, EffectiveState, Event, EventKind, FrameRange, J1939Message, Kind, ModeChange, SetPoint,
};
use crate::finding::FindingSubject;
use crate::frame::CanId;
use crate::profile::{IntegerPosition, ObjectMeaning, PayloadLayout, as_integer};
use crate::rules::general::facts::is_sent_on_change;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{BySlot, FrameNeed, PdoSubset, Rule, RuleContext, RulePolicy};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A measured value deviates from the effective set point that the profile pairs with it by more than
    /// `percent` of full scale, and does not approach it. Open-loop modes, calibrations, ramps and set points
    /// with unknown conditions are exempt, and so are states of the device in which the profile excludes it, such
    /// as float, hand operation and emergency stop. So is an output with another set point that is followed or not
    /// measured, because that one may limit the value. A measured value counts until its TPDO is missing for
    /// three of its usual intervals; a TPDO that is sent on change only keeps its value.
    ///
    /// # Why it matters
    /// The machine does not follow its commands. Something sticks, leaks, or is limited by another
    /// controller.
    ///
    /// # Source
    /// Pairs of set point and measured value: device manual.
    ///
    /// # What to look at first
    /// Check pressure, flow and the sensor of the measured value. Check the limits of other controllers.
    ///
    /// # Mutation
    /// set the measured value in a TPDO to 0
    "not-following", Warning, "measured value not following its set point",
    kinds: [Kind::Pdo, Kind::SetPoint, Kind::BootUp, Kind::Mode, Kind::J1939Message],
    pdos: PdoSubset::Transmitted,
    needs: "an effective set point and a measured value that the profile pairs with it",
    is_timing: true,
    word: "FOLLOW",
    tolerances: &[
        define_tolerance("percent", 10.0, "%", "of full scale, permitted deviation from the set point"),
        define_tolerance("valve-ms", 500.0, "ms", "permitted duration of a deviation for a valve (CiA 408)"),
        define_tolerance("pump-ms", 1_500.0, "ms", "permitted duration of a deviation for other devices"),
    ],
}

/// Maximum number of pairs per bus; further ones are not checked.
const PAIR_LIMIT: usize = 1024;

/// Profile of valves, which follow faster than pumps.
const VALVES: &str = "cia408";

/// Share of the tolerance by which a value must approach its set point to count as following.
const NEARER: f64 = 0.2;

/// Set point and its measured value.
struct SetPointPair {
    node: NodeId,
    set_point: ObjectAddress,
    channel: Option<u8>,
    name: String,
    unit: String,
    time: i64,
    target: Option<f64>,
    actual: Option<f64>,
    full_scale: Option<f64>,
    /// The commanded state, or the reported one, excludes that the value follows.
    is_exempt: [bool; 2],
    /// Start of the deviation, and its initial size.
    since: Option<(i64, f64)>,
    frame: u64,
    /// Identifier of the PDO with the measured value.
    source: Option<CanId>,
    is_reported: bool,
    /// A wake-up is scheduled.
    is_queued: bool,
}

/// Fields of a layout that are paired with a set point.
#[derive(Default)]
struct PairedFields {
    layout: Option<Arc<PayloadLayout>>,
    node: Option<NodeId>,
    /// Index of the field, index of its pair, and position of its raw number.
    fields: Vec<(usize, usize, Option<IntegerPosition>)>,
    /// Generation of the pairs at the last look-up.
    generation: u64,
}

struct NotFollowing {
    share: f64,
    valve: i64,
    pump: i64,
    pairs: Vec<SetPointPair>,
    paired: BySlot<PairedFields>,
    messages: FollowedMessages,
    /// Number of changes of `pairs`; after a change, unchanged payloads are checked once more.
    generation: u64,
    /// Outputs in an open-loop mode; without a channel, the whole device.
    open_loop: Vec<(NodeId, Option<u8>)>,
}

fn new(policy: &RulePolicy) -> NotFollowing {
    NotFollowing {
        share: policy.tolerance_value(&DECLARATION, "percent") / 100.0,
        valve: policy.tolerance_ns(&DECLARATION, "valve-ms"),
        pump: policy.tolerance_ns(&DECLARATION, "pump-ms"),
        pairs: Vec::new(),
        paired: BySlot::default(),
        messages: FollowedMessages::default(),
        generation: 0,
        open_loop: Vec::new(),
    }
}

impl NotFollowing {
    fn set_point(&mut self, event: &Event, id: NodeId, emitted: &SetPoint, context: &mut RuleContext<'_>) {
        let Some(node) = context.event_node(event) else { return };
        // A state that follows the control word confirms the assumed contents of the PDOs.
        let is_certain = !emitted.assumed || node.device_states().next().is_some();
        let acts =
            emitted.effective == EffectiveState::Yes && is_certain && !self.is_open_loop(id, emitted.channel);
        let known = self.pairs.iter().position(|pair| pair.node == id && pair.set_point == emitted.object);
        let place = match known {
            Some(place) => place,
            None if self.pairs.len() < PAIR_LIMIT => {
                let is_valve = node.device().extends.iter().any(|standard| standard == VALVES);
                self.pairs.push(SetPointPair {
                    node: id,
                    set_point: emitted.object,
                    channel: emitted.channel,
                    name: String::new(),
                    unit: String::new(),
                    time: if is_valve { self.valve } else { self.pump },
                    target: None,
                    actual: None,
                    full_scale: None,
                    is_exempt: [false; 2],
                    since: None,
                    frame: 0,
                    source: None,
                    is_reported: false,
                    is_queued: false,
                });
                self.generation += 1;
                context.ask_again();
                self.pairs.len() - 1
            }
            None => return,
        };
        let share = self.share;
        let Some(pair) = self.pairs.get_mut(place) else { return };
        pair.target = emitted.to.number.filter(|_| acts);
        // The previous deviation belongs to another set point.
        pair.since = None;
        pair.judge_pair(place, share, event.frames.last, context);
    }

    /// Updates the open-loop outputs after a mode change, if the profile defines open-loop modes.
    fn on_mode(&mut self, event: &Event, id: NodeId, mode: &ModeChange, context: &RuleContext<'_>) {
        let Some(node) = context.event_node(event) else { return };
        let entry = node.device().dictionary.find_object(mode.object).and_then(|found| found.entry);
        let Some(entry) = entry.filter(|entry| !entry.open_loop.is_empty()) else { return };
        let value = node.meaning(mode.object).zip(node.store().get(mode.object));
        let value = value.and_then(|(meaning, held)| as_integer(&meaning.decode(&held.value)));
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

    /// Handles a J1939 message that commands a device or reports its measured values.
    #[cold]
    fn on_message(&mut self, event: &Event, message: &J1939Message, context: &mut RuleContext<'_>) {
        let Some(fields) = self.messages.followed_message(message, context.bus) else { return };
        let Some(node) = fields.node else { return };
        let is_open_loop = fields.is_open_loop(message);
        for (place, pair) in self.pairs.iter_mut().enumerate().filter(|(_, pair)| pair.node == node) {
            let [commanded, reported] = &mut pair.is_exempt;
            *(if fields.is_command { commanded } else { reported }) = is_open_loop;
            let measured = fields.measured.iter().find(|(_, of)| *of == pair.set_point);
            let field = measured.and_then(|(field, _)| message.layout.as_ref()?.fields.get(*field));
            if let Some((field, raw)) = field.and_then(|it| Some((it, it.extract_bits(message.payload())?)))
                && let Some(meaning) = &field.meaning
            {
                pair.actual = meaning.scaled_value(&field.convert_raw(raw));
                if pair.full_scale.is_none() {
                    pair.learn_meaning(meaning);
                }
            }
            pair.judge_pair(place, self.share, event.frames.last, context);
        }
    }

    /// Whether a PDO may contain values that are paired with a set point.
    fn may_have_pairs(&self, pdo: &DecodedPdo, event: &Event, context: &RuleContext<'_>) -> bool {
        let Some(layout) = &pdo.layout else { return false };
        let paired = context.traffic.current_slot().and_then(|slot| self.paired.get(slot.place));
        paired.is_none_or(|paired| {
            !paired.fields.is_empty() || !paired.is_current(layout, event.node, self.generation)
        })
    }

    fn on_pdo(&mut self, event: &Event, pdo: &DecodedPdo, context: &mut RuleContext<'_>) {
        let (Some(layout), Some(slot), Some(node)) =
            (&pdo.layout, context.traffic.current_slot(), event.node)
        else {
            return;
        };
        let Some(paired) = self.paired.entry_of(slot) else { return };
        if !paired.is_current(layout, Some(node), self.generation) {
            paired.learn_fields(layout, node, &self.pairs);
            paired.generation = self.generation;
        } else if event.routine {
            return;
        }
        for (field, place, cut) in &paired.fields {
            let (Some(field), Some(pair)) = (layout.fields.get(*field), self.pairs.get_mut(*place)) else {
                continue;
            };
            let raw = match cut {
                Some(cut) => cut.number(pdo.first_word(), usize::from(pdo.length)).map(i64::cast_unsigned),
                None => field.extract_bits(pdo.payload()),
            };
            let (Some(meaning), Some(raw)) = (&field.meaning, raw) else { continue };
            pair.actual = meaning.scaled_value(&field.convert_raw(raw));
            pair.source = Some(pdo.cob_id);
            if pair.full_scale.is_none() {
                pair.learn_meaning(meaning);
            }
            pair.judge_pair(*place, self.share, event.frames.last, context);
        }
    }
}

impl PairedFields {
    fn is_current(&self, layout: &Arc<PayloadLayout>, node: Option<NodeId>, generation: u64) -> bool {
        self.layout.as_ref().is_some_and(|known| Arc::ptr_eq(known, layout))
            && self.generation == generation
            && self.node == node
    }

    #[cold]
    fn learn_fields(&mut self, layout: &Arc<PayloadLayout>, node: NodeId, pairs: &[SetPointPair]) {
        let fields = layout.fields.iter().enumerate().filter_map(|(place, field)| {
            let of = field.meaning.as_deref()?.of?;
            let pair = pairs.iter().position(|pair| pair.node == node && pair.set_point == of)?;
            Some((place, pair, IntegerPosition::position_of(field)))
        });
        self.fields = fields.collect();
        (self.layout, self.node) = (Some(Arc::clone(layout)), Some(node));
    }
}

/// Largest value of a measured quantity.
fn full_scale(meaning: &ObjectMeaning) -> Option<f64> {
    let scale = meaning.scale.filter(|scale| !scale.is_reciprocal)?;
    if let Some((_, value)) = scale.full_scale {
        return Some(value);
    }
    if let Some([least, most]) = meaning.limits {
        return Some(least.abs().max(most.abs()));
    }
    let [least, most] = meaning.range?;
    #[expect(clippy::cast_precision_loss, reason = "a range of a few digits")]
    let ends = [least, most].map(|raw| (raw as f64 * scale.factor + scale.offset).abs());
    Some(ends[0].max(ends[1]))
}

impl SetPointPair {
    #[cold]
    fn learn_meaning(&mut self, meaning: &ObjectMeaning) {
        self.full_scale = full_scale(meaning).filter(|scale| *scale > 0.0);
        self.name.clone_from(&meaning.name);
        self.unit.clone_from(&meaning.unit);
    }

    /// Deviation and its limit.
    fn deviation_and_limit(&self, share: f64) -> Option<(f64, f64)> {
        if self.is_exempt != [false; 2] {
            return None;
        }
        Some(((self.actual? - self.target?).abs(), self.full_scale? * share))
    }

    fn judge_pair(&mut self, place: usize, share: f64, frame: u64, context: &mut RuleContext<'_>) {
        self.frame = frame;
        let Some((off, most)) = self.deviation_and_limit(share) else { return self.on_following(context) };
        if off <= most {
            self.on_following(context);
            return context.count_pass();
        }
        let comes_nearer = self.since.is_some_and(|(_, at_first)| off < at_first - most * NEARER);
        if !std::mem::replace(&mut self.is_queued, true) {
            context.wake_at(context.now.saturating_add(self.time), place as u64);
        }
        if self.since.is_none() || comes_nearer {
            self.since = Some((context.now, off));
        }
    }

    /// Whether the TPDO with the measured value ended. One that is sent on change only keeps its value.
    #[cold]
    fn is_source_lost(&self, context: &RuleContext<'_>) -> bool {
        let slot = self.source.and_then(|id| context.pdos_of(id));
        let Some((slot, usual)) = slot.and_then(|slot| Some((slot, slot.median?))) else { return false };
        slot.has_ended(usual, context.now) && !is_sent_on_change(slot, context)
    }

    fn on_following(&mut self, context: &mut RuleContext<'_>) {
        self.since = None;
        if std::mem::take(&mut self.is_reported) {
            context.close_condition(Some(self.node), FindingSubject::Object(self.set_point));
        }
    }
}

impl Rule for NotFollowing {
    fn frame_need(&self, event: &Event, context: &RuleContext<'_>) -> FrameNeed {
        let is_needed = match &event.kind {
            EventKind::Pdo(pdo) => self.may_have_pairs(pdo, event, context),
            _ => !self.pairs.is_empty(),
        };
        if is_needed { FrameNeed::EACH } else { FrameNeed::NOTHING }
    }

    fn wants_pdos(&self) -> bool {
        !self.pairs.is_empty()
    }

    #[inline]
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Pdo(pdo), _) if !self.pairs.is_empty() => self.on_pdo(event, pdo, context),
            (EventKind::J1939Message(message), _) if !self.pairs.is_empty() => {
                self.on_message(event, message, context);
            }
            (EventKind::SetPoint(point), Some(node)) => self.set_point(event, node, point, context),
            (EventKind::BootUp { .. }, Some(node)) => {
                for pair in self.pairs.iter_mut().filter(|pair| pair.node == node) {
                    (pair.target, pair.actual, pair.full_scale) = (None, None, None);
                    pair.is_exempt = [false; 2];
                    pair.on_following(context);
                }
                self.generation += 1;
                context.ask_again();
            }
            (EventKind::Mode(mode), Some(node)) => self.on_mode(event, node, mode, context),
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(place) = usize::try_from(token).ok() else { return };
        let Some(pair) = self.pairs.get_mut(place) else { return };
        pair.is_queued = false;
        let Some((since, _)) = pair.since else { return };
        if pair.is_source_lost(context) {
            // A measured value whose source ended is unknown.
            pair.actual = None;
            return pair.on_following(context);
        }
        if pair.is_reported {
            pair.is_queued = true;
            return context.wake_at(context.now.saturating_add(pair.time), token);
        }
        let Some(pair) = self.pairs.get(place) else { return };
        let due = since.saturating_add(pair.time);
        let limits = self.pairs.iter().any(|other| {
            let is_same = (other.node, other.channel) == (pair.node, pair.channel);
            // A set point without a measured value may also limit.
            is_same
                && other.target.is_some()
                && other.deviation_and_limit(self.share).is_none_or(|(off, most)| off <= most)
        });
        if due > context.now || limits {
            let again = if limits { context.now.saturating_add(pair.time) } else { due };
            context.wake_at(again, token);
            if let Some(pair) = self.pairs.get_mut(place) {
                pair.is_queued = true;
            }
            return;
        }
        let (Some((off, most)), Some(target), Some(actual)) =
            (pair.deviation_and_limit(self.share), pair.target, pair.actual)
        else {
            return;
        };
        let began = context.timestamp_of(since);
        let alarm = context.fail_at(context.now, Some(pair.node), FrameRange::one(pair.frame));
        let alarm =
            alarm.with_subject(FindingSubject::Object(pair.set_point)).with_measure(off).started_at(began);
        alarm.report_finding(|| {
            let (name, unit) = (&pair.name, &pair.unit);
            format!(
                "{name} {actual:.1} {unit}, set point {target:.1} {unit} (max deviation {most:.1} {unit})"
            )
        });
        if let Some(pair) = self.pairs.get_mut(place) {
            (pair.is_reported, pair.is_queued) = (true, true);
            context.wake_at(context.now.saturating_add(pair.time), token);
        }
    }
}
