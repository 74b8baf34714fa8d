//! PDOs and J1939 messages at one node: calls only the rules that use their values.

use std::sync::Arc;

use super::carrier::{CarrierPayload, CarrierPlan, FieldEvidence, RuleField};
use super::kinds::{self, frames, messages};
use super::node::NodeRules;
use super::node_judge::{CheckOccasion, NodeJudge};
use super::pdo_targets::PdoTarget;
use super::plan::rule_triggers;
use super::progress::{FrameTime, PdoTask};
use super::values::LastValue;
use crate::event::{DecodedPdo, Event, J1939Message};
use crate::profile::device::{MessageDirection, ProfileTrigger, TriggerEvent, UpdateSource, ValueUpdate};
use crate::profile::{PdoName, SignalField};
use crate::rules::RuleContext;
use crate::wire::j1939::ALL;

impl NodeJudge<'_> {
    #[inline]
    pub(super) fn on_pdo(
        &mut self,
        target: &PdoTarget,
        pdo: &DecodedPdo,
        event: &Event,
        context: &mut RuleContext<'_>,
    ) {
        let occasion = CheckOccasion::occasion_of(event);
        self.note_presence(occasion, context);
        if pdo.is_request {
            for number in target.requests.iter().copied() {
                self.judge_one(number, occasion, context, |case, _, context| {
                    frames::judge_remote_length(case, pdo, context);
                });
            }
            return;
        }
        let payload = CarrierPayload::new(pdo.layout.as_ref(), pdo.payload(), &pdo.bytes);
        if !self.on_repeated_values(target, &payload, event, context) {
            let carrier = (TriggerEvent::Pdo(target.name), target.carrier);
            self.on_values(carrier, &target.plan, &payload, event, context);
        }
        if !target.plan.constants.is_empty() {
            self.on_fixed_bits(target, &payload, occasion, context);
        }
        if target.is_own && target.plan.source == UpdateSource::Sent {
            self.own.record.received = Some(context.now);
        }
    }

    /// Runs the rules about bits with a fixed content: at the first frame, and at each with another content.
    fn on_fixed_bits(
        &mut self,
        target: &PdoTarget,
        payload: &CarrierPayload<'_>,
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        let occasion = occasion.with_assumed_mapping(target.plan.is_fixed_assumed);
        let differing = target.plan.fixed.differing_bits(payload.word, payload.bytes.len());
        for number in target.plan.constants.iter().copied() {
            let is_new = self.own.progress.get(number).is_some_and(|progress| !progress.is_counting);
            if differing != 0 || is_new {
                self.judge_one(number, occasion, context, |case, progress, context| {
                    progress.is_counting = true;
                    messages::judge_fixed_bits(case, target.name, differing, context);
                });
            }
        }
    }

    /// Handles a message that this node sends or receives according to its profile.
    pub(super) fn on_message(
        &mut self,
        address: u8,
        message: &J1939Message,
        event: &Event,
        context: &mut RuleContext<'_>,
    ) {
        let is_sender = message.id.source == address;
        let is_receiver = message.id.destination == ALL || message.id.destination == address;
        if is_sender && self.own.record.plan.requested.iter().any(|(pgn, _)| *pgn == message.id.pgn.number())
        {
            self.on_group(message.id.pgn, CheckOccasion::occasion_of(event), context);
        }
        let device = Arc::clone(&self.own.record.plan.device);
        let spec = device.messages.iter().find(|spec| {
            let is_meant = match spec.direction {
                MessageDirection::Transmit => is_sender,
                MessageDirection::Receive => is_receiver && !is_sender,
            };
            is_meant && spec.is_for(message.id.pgn, address)
        });
        if let Some(spec) = spec {
            let source = if is_sender { UpdateSource::Sent } else { UpdateSource::Received };
            self.on_named_message(&spec.name, source, message, event, context);
        }
    }

    fn on_named_message(
        &mut self,
        name: &str,
        source: UpdateSource,
        message: &J1939Message,
        event: &Event,
        context: &mut RuleContext<'_>,
    ) {
        self.note_presence(CheckOccasion::occasion_of(event), context);
        let plan = self.own.carriers.take_plan(message, source).unwrap_or_else(|| {
            let waits =
                |trigger: &ProfileTrigger| matches!(trigger, ProfileTrigger::Message(of) if of.name == name);
            let rules = self.active_rules(|rule| rule_triggers(rule).any(waits));
            let evidence = |_: &SignalField| FieldEvidence::Certain;
            CarrierPlan::new(message.layout.as_deref(), &evidence, source, rules, &self.own.record.plan)
        });
        let payload = CarrierPayload::new(message.layout.as_ref(), message.payload(), &message.bytes);
        self.on_values((TriggerEvent::Message(name), None), &plan, &payload, event, context);
        self.own.carriers.put_plan(message, plan);
        self.note_last_frame(context);
    }

    /// Stores all values of a PDO or message before the rules run, since conditions see them together.
    fn on_values(
        &mut self,
        (carrier, number): (TriggerEvent<'_>, Option<u16>),
        plan: &CarrierPlan,
        payload: &CarrierPayload<'_>,
        event: &Event,
        context: &mut RuleContext<'_>,
    ) {
        let occasion = CheckOccasion::occasion_of(event);
        let mut numbers = std::mem::take(&mut self.own.scratch);
        numbers.clear();
        let mut follows = false;
        let (time, frame, is_sent) = (context.now, event.frames.last, plan.source == UpdateSource::Sent);
        for field in &plan.fields {
            if field.is_assumed {
                numbers.push((None, field.field_number(payload)));
                continue;
            }
            let (before, now) = (self.own.record.last.raw_value(field.place), field.field_number(payload));
            if let Some(raw) = now {
                follows |= before != now && !field.stretches.is_empty();
                if field.decides {
                    self.own.record.last.count_value(before != now, self.node.store().change_count());
                }
                let value = LastValue { raw, time, frame, is_sent };
                self.own.record.last.put_value(field.place, value, number.zip(field.cut));
            } else {
                self.own.record.last.keep_value(field.place);
            }
            numbers.push((before, now));
        }
        if let (Some(number), TriggerEvent::Pdo(name)) = (number, carrier) {
            let payload = (payload.word, payload.bytes.len());
            self.own.record.last.store_payload(number, payload, (time, frame));
            self.list_awake((number, name), plan, time);
        }
        self.exercise_values((carrier, plan, payload), &numbers, occasion, context);
        for number in plan.rules.iter().copied() {
            if !self.proven_facts(time).can_rest(number) {
                self.judge_one(number, occasion, context, |case, progress, context| {
                    kinds::judge_event(case, progress, &carrier, context);
                });
            }
        }
        for (field, (before, now)) in plan.fields.iter().zip(numbers.iter().copied()) {
            let Some(raw) = now else { continue };
            for clause in &field.clauses {
                if clause.needs_check(before, raw) && !self.proven_facts(time).can_rest(clause.number) {
                    self.judge_value(field, clause.number, (before, raw), (plan, payload), occasion, context);
                }
            }
        }
        if follows {
            self.follow_values(plan, &numbers, occasion, context);
        }
        self.own.scratch = numbers;
    }

    /// Counts the rules about events that must not occur, with which the PDO or message or one of its values is compared.
    fn exercise_values(
        &mut self,
        (carrier, plan, payload): (TriggerEvent<'_>, &CarrierPlan, &CarrierPayload<'_>),
        numbers: &[(Option<i64>, Option<i64>)],
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        let is_open = |number: &usize| self.own.progress.get(*number).is_some_and(|it| !it.is_exercised);
        if !plan.forbidding.iter().any(is_open) {
            return;
        }
        self.exercise_rules(&plan.forbidding, &carrier, occasion, context);
        for (field, (before, now)) in plan.fields.iter().zip(numbers) {
            if let Some(raw) = now
                && let Some(update) = self.value_update(field, (*before, *raw), (plan, payload))
            {
                self.exercise_rules(&plan.forbidding, &TriggerEvent::Value(update), occasion, context);
            }
        }
    }

    /// Determines which rules about a PDO do not rest, until conditions may change.
    fn list_awake(&mut self, (number, name): (u16, PdoName), plan: &CarrierPlan, time: i64) {
        let age = self.proven_facts(time).proof_age();
        let Some(carrier) = self.own.record.last.carrier_mut(number) else { return };
        let mut awake = std::mem::take(&mut carrier.awake);
        if awake.age != Some(age) {
            let rests = |number: usize| self.proven_facts(time).can_rest(number);
            awake.age = Some(age);
            awake.rules.clear();
            let rules = plan.rules.iter().copied().filter(|rule| !rests(*rule));
            awake.rules.extend(rules.map(|rule| (rule, self.task_of(rule, name))));
            awake.clauses.clear();
            for (place, field) in plan.fields.iter().enumerate() {
                let clauses = field.clauses.iter().enumerate();
                let each = clauses.filter(|(_, clause)| clause.is_for_each() && !rests(clause.number));
                awake.clauses.extend(each.map(|(clause, _)| (place, clause)));
            }
        }
        if let Some(carrier) = self.own.record.last.carrier_mut(number) {
            carrier.awake = awake;
        }
    }

    /// What a PDO does to a rule that does not rest before values change.
    fn task_of(&self, number: usize, name: PdoName) -> PdoTask {
        let record = &self.own.record;
        let (Some((rule, _)), Some(proof)) = (record.plan.active_rule(number), record.proofs.get(number))
        else {
            return PdoTask::Evaluate;
        };
        let is_lasting = rule.during.0.is_empty() || proof.may_rest && proof.during.are_all;
        match kinds::task_of(rule, name) {
            PdoTask::Count if !is_lasting => PdoTask::Evaluate,
            task => task,
        }
    }

    /// Runs a rule on a PDO.
    #[inline]
    fn run_task(
        &mut self,
        (number, task): (usize, PdoTask),
        name: PdoName,
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        if task == PdoTask::Evaluate {
            return self.judge_one(number, occasion, context, |case, progress, context| {
                kinds::judge_event(case, progress, &TriggerEvent::Pdo(name), context);
            });
        }
        let is_operational = task == PdoTask::Count && self.proven_facts(context.now).is_operational();
        let NodeRules { record, progress, .. } = &mut *self.own;
        let (Some((_, place)), Some(progress)) = (record.plan.active_rule(number), progress.get_mut(number))
        else {
            return;
        };
        if task == PdoTask::Count {
            progress.has_begun = true;
            if is_operational {
                let moment = FrameTime { time: context.now, frame: occasion.frames.last };
                kinds::count_pdo(progress, moment);
            }
        } else if kinds::on_answer(progress) {
            let before = std::mem::replace(&mut context.rule, place);
            context.count_pass();
            context.rule = before;
        }
    }

    /// Runs the rules on a PDO without a change that concerns conditions or rules about changes; `false`, without any
    /// effect, for all others.
    #[inline]
    fn on_repeated_values(
        &mut self,
        target: &PdoTarget,
        payload: &CarrierPayload<'_>,
        event: &Event,
        context: &mut RuleContext<'_>,
    ) -> bool {
        let (plan, time) = (&target.plan, context.now);
        let (Some(number), Some(watched)) = (target.carrier, plan.watched) else { return false };
        let (age, length) = (self.proven_facts(time).proof_age(), payload.bytes.len());
        let moment = (time, event.frames.last);
        let last = &mut self.own.record.last;
        let Some(before) = last.repeat_payload(number, (payload.word, length), watched, age, moment) else {
            return false;
        };
        let occasion = CheckOccasion::occasion_of(event);
        // The rules do not change the lists.
        let mut place = 0;
        while let Some(rule) =
            self.own.record.last.awake_rules(number).and_then(|it| it.rules.get(place)).copied()
        {
            self.run_task(rule, target.name, occasion, context);
            place += 1;
        }
        let mut next = 0;
        while let Some((place, clause)) =
            self.own.record.last.awake_rules(number).and_then(|it| it.clauses.get(next)).copied()
        {
            next += 1;
            let Some(field) = plan.fields.get(place) else { continue };
            let (Some(clause), Some(cut)) = (field.clauses.get(clause), field.cut) else { continue };
            let (before, now) = (cut.number(before, length), cut.number(payload.word, length));
            let Some(raw) = now.filter(|raw| clause.needs_check(before, *raw)) else { continue };
            self.judge_value(field, clause.number, (before, raw), (plan, payload), occasion, context);
        }
        true
    }

    /// Runs one rule on one value of a PDO or message.
    fn judge_value(
        &mut self,
        watched: &RuleField,
        number: usize,
        (before, raw): (Option<i64>, i64),
        (plan, payload): (&CarrierPlan, &CarrierPayload<'_>),
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        let Some(update) = self.value_update(watched, (before, raw), (plan, payload)) else { return };
        let occasion = occasion.with_assumed_mapping(watched.is_assumed);
        self.judge_one(number, occasion, context, |case, progress, context| {
            kinds::judge_event(case, progress, &TriggerEvent::Value(update), context);
        });
    }

    /// Value of a field in a PDO or message as an update of its object.
    fn value_update<'p>(
        &self,
        watched: &RuleField,
        (before, raw): (Option<i64>, i64),
        (plan, payload): (&CarrierPlan, &CarrierPayload<'p>),
    ) -> Option<ValueUpdate<'p>> {
        let field = payload.layout.and_then(|layout| layout.fields.get(watched.field))?;
        let object = field.object()?;
        let before = before.or_else(|| self.node.proven_value(object).map(|(raw, _)| raw));
        Some(ValueUpdate {
            object,
            source: plan.source,
            raw: Some(raw),
            before,
            bytes: &[],
            meaning: field.meaning.as_deref(),
            is_fresh: before.is_none() && self.own.record.last.is_fresh,
        })
    }

    /// Updates the rules whose `while` depends on a changed value.
    #[cold]
    fn follow_values(
        &mut self,
        plan: &CarrierPlan,
        numbers: &[(Option<i64>, Option<i64>)],
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        let mut place = 0;
        while let Some(number) = self.own.record.plan.stretches.get(place).copied() {
            let mut values = plan.fields.iter().zip(numbers);
            let is_concerned = values.any(|(field, (before, now))| {
                now.is_some() && before != now && field.stretches.contains(&number)
            });
            if is_concerned {
                self.judge_one(number, occasion, context, kinds::follow_while);
            }
            place += 1;
        }
    }
}
