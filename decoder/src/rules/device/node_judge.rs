//! Runs the device rules of one node on an event.

use std::sync::Arc;

use super::case::RuleCase;
use super::facts::ProvenFacts;
use super::kinds::{self, address, frames, messages, reports};
use super::node::NodeRules;
use super::plan::concerns_rule;
use super::progress::{FrameTime, RuleProgress};
use super::transfer::update_of;
use crate::event::{
    BootCause, DtcAction, Emergency, Event, EventKind, FrameRange, MessageGap, SdoOutcome, SdoTransfer,
};
use crate::profile::device::{DeviceRule, LssEvent, RuleKind, TriggerEvent, UpdateSource, ValueUpdate};
use crate::profile::{PdoName, as_integer, lss_names};
use crate::rules::RuleContext;
use crate::rules::context::MAPPING_ASSUMED;
use crate::session::{Bus, Node};
use crate::wire::canopen::lss::LssContent;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::j1939::Pgn;
use crate::wire::{NodeId, NodeMap};

/// Error register.
const REGISTER: ObjectAddress = ObjectAddress::new(0x1001, 0);

/// A node with its rules, and the other nodes with rules.
pub(super) struct NodeJudge<'a> {
    pub(super) bus: &'a Bus,
    pub(super) id: NodeId,
    pub(super) node: &'a Node,
    pub(super) own: &'a mut NodeRules,
    pub(super) others: &'a NodeMap<Box<NodeRules>>,
}

/// The event to check with its frames; without an event at a deadline.
#[derive(Clone, Copy)]
pub(super) struct CheckOccasion<'a> {
    pub(super) event: Option<&'a Event>,
    pub(super) frames: FrameRange,
    /// Assumption on which the value to check depends.
    pub(super) assumed: Option<&'static str>,
}

impl<'a> CheckOccasion<'a> {
    pub(super) fn occasion_of(event: &'a Event) -> Self {
        Self { event: Some(event), frames: event.frames, assumed: None }
    }

    /// The same occasion for a value that depends on an assumed mapping, if it does.
    pub(super) fn with_assumed_mapping(self, is_assumed: bool) -> Self {
        Self { assumed: is_assumed.then_some(MAPPING_ASSUMED), ..self }
    }

    /// Occasion of an expired deadline.
    pub(super) fn of_time(bus: &Bus) -> Self {
        Self { event: None, frames: FrameRange::one(bus.last_frame()), assumed: None }
    }
}

impl NodeJudge<'_> {
    /// Indices of the active rules that `picks` selects.
    pub(super) fn active_rules(&self, picks: impl Fn(&DeviceRule) -> bool) -> Vec<usize> {
        self.own
            .record
            .plan
            .active_rules()
            .filter(|(_, rule)| picks(rule))
            .map(|(number, _)| number)
            .collect()
    }

    /// Facts at a monotonic time.
    #[inline]
    pub(super) fn proven_facts(&self, now: i64) -> ProvenFacts<'_> {
        let Self { bus, id, node, ref own, others } = *self;
        ProvenFacts { bus, id, node, own: &own.record, others, now }
    }

    /// Calls a task with one rule.
    #[inline]
    pub(super) fn judge_one(
        &mut self,
        number: usize,
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
        task: impl FnOnce(&RuleCase<'_>, &mut RuleProgress, &mut RuleContext<'_>),
    ) {
        let NodeRules { record, progress, .. } = &mut *self.own;
        let (Some((rule, place)), Some(progress)) =
            (record.plan.active_rule(number), progress.get_mut(number))
        else {
            return;
        };
        let own = &*record;
        let Self { bus, id, node, others, .. } = *self;
        let facts = ProvenFacts { bus, id, node, own, others, now: context.now };
        let before = std::mem::replace(&mut context.rule, place);
        let CheckOccasion { event, frames, assumed } = occasion;
        task(&RuleCase { facts, rule, number, event, frames, assumed }, progress, context);
        context.rule = before;
    }

    /// At the first frame of the node: passes the rules that the presence of the device alone exercises.
    #[inline]
    pub(super) fn note_presence(&mut self, occasion: CheckOccasion<'_>, context: &mut RuleContext<'_>) {
        if !self.own.is_present && self.node.last_seen().0 != 0 {
            self.pass_by_presence(occasion, context);
        }
    }

    #[cold]
    fn pass_by_presence(&mut self, occasion: CheckOccasion<'_>, context: &mut RuleContext<'_>) {
        self.own.is_present = true;
        self.own.record.present = Some(context.now);
        // The identifier of each frame is compared with the reserved ones.
        for number in self.active_rules(|rule| rule.kind == RuleKind::ReservedId) {
            self.judge_one(number, occasion, context, |_, _, context| context.count_pass());
        }
        for number in
            self.active_rules(|rule| matches!(rule.kind, RuleKind::NodeId | RuleKind::SourceAddress))
        {
            self.judge_one(number, occasion, context, |case, _, context| {
                address::judge_address(case, context);
            });
        }
    }

    /// Records the time of the node's last frame.
    pub(super) fn note_last_frame(&mut self, context: &RuleContext<'_>) {
        let (frame, stamp) = self.node.last_seen();
        if let Some(stamp) = stamp.filter(|_| frame != 0) {
            self.own.record.received = Some(self.bus.monotonic(stamp).saturating_sub(context.silence));
        }
    }

    /// Counts the rules about forbidden events that are compared with the event.
    pub(super) fn exercise_rules(
        &mut self,
        rules: &[usize],
        event: &TriggerEvent<'_>,
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        for number in rules.iter().copied() {
            if self.own.progress.get(number).is_some_and(|progress| !progress.is_exercised) {
                self.judge_one(number, occasion, context, |case, progress, context| {
                    kinds::exercise_never(case, progress, event, context);
                });
            }
        }
    }

    /// Runs all rules that the event concerns.
    fn judge_event(
        &mut self,
        event: &TriggerEvent<'_>,
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        let plan = Arc::clone(&self.own.record.plan);
        self.exercise_rules(&plan.forbidding, event, occasion, context);
        for number in self.active_rules(|rule| concerns_rule(rule, event)) {
            self.judge_one(number, occasion, context, |case, progress, context| {
                kinds::judge_event(case, progress, event, context);
            });
        }
    }

    /// Uses a precomputed list, since SYNC is frequent.
    fn on_sync(&mut self, occasion: CheckOccasion<'_>, context: &mut RuleContext<'_>) {
        if self.own.record.plan.syncs.is_empty() || self.bus.last_sync() != Some(self.node.sync()) {
            return;
        }
        let mut place = 0;
        while let Some(number) = self.own.record.plan.syncs.get(place).copied() {
            if !self.ends_count(number, context) {
                self.judge_one(number, occasion, context, |case, progress, context| {
                    kinds::judge_event(case, progress, &TriggerEvent::Sync, context);
                });
            }
            place += 1;
        }
    }

    /// Ends a count between SYNCs that is within its limit; `false`, without any effect, for all other rules.
    fn ends_count(&mut self, number: usize, context: &mut RuleContext<'_>) -> bool {
        let NodeRules { record, progress, .. } = &mut *self.own;
        let (Some((rule, place)), Some(progress)) =
            (record.plan.active_rule(number), progress.get_mut(number))
        else {
            return false;
        };
        let Some(passes) = kinds::end_count(rule, progress, context.now) else { return false };
        if passes {
            let before = std::mem::replace(&mut context.rule, place);
            context.count_pass();
            context.rule = before;
        }
        true
    }

    /// Updates all rules whose `while` may begin or end.
    fn follow_while(&mut self, occasion: CheckOccasion<'_>, context: &mut RuleContext<'_>) {
        let mut place = 0;
        while let Some(number) = self.own.record.plan.stretches.get(place).copied() {
            self.judge_one(number, occasion, context, kinds::follow_while);
            place += 1;
        }
    }

    /// Handles any event other than a PDO, a message or a frame.
    pub(super) fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let occasion = CheckOccasion::occasion_of(event);
        self.note_presence(occasion, context);
        match &event.kind {
            EventKind::Sync { .. } => return self.on_sync(occasion, context),
            EventKind::Lss { command, from_master, content } => {
                let lss = LssEvent {
                    service: lss_names().service_name(*command),
                    is_answer: !from_master,
                    value: lss_parameter(content),
                };
                return self.judge_event(&TriggerEvent::Lss(lss), occasion, context);
            }
            EventKind::GuardRequest => return self.judge_event(&TriggerEvent::Guard, occasion, context),
            EventKind::Heartbeat { state, .. } | EventKind::GuardReply { state, .. } => {
                let state = state.map_or("undefined", NmtState::name);
                return self.judge_event(&TriggerEvent::Reports(state), occasion, context);
            }
            EventKind::SdoTransfer(transfer) => self.on_transfer(transfer, occasion, context),
            EventKind::NmtCommand { service, .. } => self.on_command(*service, occasion, context),
            EventKind::NmtState(change) if change.to != NmtState::Operational => {
                self.own.record.last.forget_sent();
            }
            EventKind::NodeLost(_) => self.own.record.last.forget_sent(),
            EventKind::BootUp { cause, .. } => self.on_start(Some(*cause), occasion, context),
            EventKind::AddressClaim(_) => self.on_start(None, occasion, context),
            EventKind::Emcy(emergency) => {
                if emergency.boot.is_some() {
                    self.on_start(emergency.boot, occasion, context);
                }
                self.on_emcy(emergency, occasion, context);
            }
            EventKind::DeviceState(state) => {
                self.own.record.note_change(state.channel, context.now);
                self.judge_event(&TriggerEvent::State(state.channel, &state.to), occasion, context);
            }
            EventKind::UdsExchange(exchange) => {
                for number in self.active_rules(|rule| rule.kind == RuleKind::UdsServices) {
                    self.judge_one(number, occasion, context, |case, _, context| {
                        messages::judge_service(case, exchange, context);
                    });
                }
            }
            EventKind::J1939Transfer(transfer) => {
                if let Some(pgn) = transfer.pgn {
                    self.on_group(pgn, occasion, context);
                }
            }
            EventKind::MessageGap(gap) if gap.has_returned => self.on_gap_end(gap, occasion, context),
            EventKind::Dtc(dtc) if matches!(dtc.action, DtcAction::Raised | DtcAction::Recurred) => {
                self.judge_event(&TriggerEvent::Dtc(dtc.spn, dtc.fmi), occasion, context);
            }
            _ => {}
        }
        self.follow_while(occasion, context);
        self.note_last_frame(context);
    }

    /// Rules about a group that is sent on request only; none for most groups.
    fn requested_rules(&self, pgn: Pgn) -> Vec<usize> {
        let of_group = self.own.record.plan.requested.iter().filter(|(group, _)| *group == pgn.number());
        of_group.map(|(_, number)| *number).collect()
    }

    /// Handles a request for a group of this node.
    pub(super) fn on_request(&mut self, pgn: Pgn, event: &Event, context: &mut RuleContext<'_>) {
        for number in self.requested_rules(pgn) {
            self.judge_one(number, CheckOccasion::occasion_of(event), context, |_, progress, context| {
                progress.last = Some(FrameTime { time: context.now, frame: event.frames.last });
            });
        }
    }

    /// Runs the rules about groups that are sent on request only.
    pub(super) fn on_group(&mut self, pgn: Pgn, occasion: CheckOccasion<'_>, context: &mut RuleContext<'_>) {
        for number in self.requested_rules(pgn) {
            self.judge_one(number, occasion, context, |case, progress, context| {
                messages::judge_group(case, progress, pgn, context);
            });
        }
    }

    /// Runs the interval rules at the end of a gap, before the event of the message itself.
    fn on_gap_end(&mut self, gap: &MessageGap, occasion: CheckOccasion<'_>, context: &mut RuleContext<'_>) {
        let device = Arc::clone(&self.own.record.plan.device);
        let address = self.id.number();
        let Some(spec) = device.messages.iter().find(|spec| spec.is_for(gap.pgn, address)) else { return };
        let message = TriggerEvent::Message(&spec.name);
        for number in
            self.active_rules(|rule| rule.kind == RuleKind::MaxInterval && concerns_rule(rule, &message))
        {
            self.judge_one(number, occasion, context, |case, progress, context| {
                kinds::judge_event(case, progress, &message, context);
            });
        }
    }

    /// A reset command ends all measurements; not every device sends a boot-up after it.
    fn on_command(
        &mut self,
        service: NmtService,
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        self.judge_event(&TriggerEvent::Nmt(service.name()), occasion, context);
        if matches!(service, NmtService::ResetNode | NmtService::ResetCommunication) {
            self.own.reset_measurements();
            self.own.record.last.clear();
        }
    }

    fn on_emcy(&mut self, emergency: &Emergency, occasion: CheckOccasion<'_>, context: &mut RuleContext<'_>) {
        if let Some(code) = emergency.code {
            self.judge_event(&TriggerEvent::Emcy(code), occasion, context);
        }
        let is_about =
            |kind| matches!(kind, RuleKind::EmcyLength | RuleKind::EmcyCode | RuleKind::EmcyRegister);
        for number in self.active_rules(|rule| is_about(rule.kind)) {
            self.judge_one(number, occasion, context, |case, _, context| {
                reports::judge_emcy(case, emergency, context);
            });
        }
        // An EMCY contains the value of 1001 (CiA 301 §7.2.7.1).
        let Some(register) =
            emergency.register.filter(|_| self.own.record.plan.watched_object(REGISTER).is_some())
        else {
            return;
        };
        let (node, raw) = (self.node, Some(i64::from(register)));
        let meaning = node.meaning(REGISTER);
        let update = ValueUpdate {
            object: REGISTER,
            source: UpdateSource::Sent,
            raw,
            before: None,
            bytes: &[],
            meaning: meaning.as_ref(),
            is_fresh: false,
        };
        self.judge_event(&TriggerEvent::Value(update), occasion, context);
    }

    fn on_start(
        &mut self,
        cause: Option<BootCause>,
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        let is_commanded = matches!(cause, Some(BootCause::Commanded { .. }));
        self.judge_event(&TriggerEvent::Boot { is_commanded }, occasion, context);
        self.own.reset_measurements();
        self.own.record.last.clear();
        self.own.record.last.is_fresh = true;
    }

    fn on_transfer(
        &mut self,
        transfer: &SdoTransfer,
        occasion: CheckOccasion<'_>,
        context: &mut RuleContext<'_>,
    ) {
        for number in self.active_rules(|rule| rule.kind == RuleKind::AbortCode) {
            self.judge_one(number, occasion, context, |case, _, context| {
                reports::judge_abort(case, transfer, context);
            });
        }
        for number in self.active_rules(|rule| rule.kind == RuleKind::Expedited) {
            self.judge_one(number, occasion, context, |case, _, context| {
                frames::judge_transfer(case, transfer, context);
            });
        }
        let Some(object) = transfer.object else { return };
        let before = self.last_number(object);
        let Some(mut update) = update_of(transfer, before) else { return };
        update.is_fresh = before.is_none() && self.own.record.last.is_fresh;
        self.judge_event(&TriggerEvent::Value(update), occasion, context);
        if transfer.outcome == SdoOutcome::Complete
            && let Some(name) = PdoName::of_parameter(object.index)
        {
            self.own.on_reconfiguration(name);
        }
    }

    /// Last value of an object, also if it was written but takes effect only after a restart.
    fn last_number(&self, object: ObjectAddress) -> Option<i64> {
        if let Some(waiting) = self.node.store().waiting_value(object) {
            let meaning = self.node.meaning(object)?;
            return as_integer(&meaning.decode(&waiting.value));
        }
        let record = &self.own.record;
        let sent = record.plan.watched_object(object).and_then(|(place, _)| record.last.get(place));
        match (sent, self.node.proven_value(object)) {
            (Some(sent), Some((raw, origin))) => Some(if origin.frame > sent.frame { raw } else { sent.raw }),
            (sent, stored) => sent.map(|sent| sent.raw).or(stored.map(|(raw, _)| raw)),
        }
    }
}

/// Parameter byte after the LSS command specifier.
const fn lss_parameter(content: &LssContent) -> Option<u8> {
    match content {
        LssContent::Mode(value) | LssContent::NodeId(value) | LssContent::Result { code: value, .. } => {
            Some(*value)
        }
        LssContent::BitTiming { table, .. } => Some(*table),
        _ => None,
    }
}
