//! Judges an event of the bus at one node by the rules of its device.

use std::sync::Arc;

use super::case::RuleCase;
use super::facts::ProvenFacts;
use super::kinds::{self, frames};
use super::node::NodeRules;
use super::plan::concerns;
use super::progress::RuleProgress;
use super::transfer::update_of;
use crate::event::{DtcAction, Event, EventKind, FrameRange, MessageGap, Outcome, SdoTransfer};
use crate::profile::device::{DeviceRule, LssEvent, RuleKind, TriggerEvent};
use crate::profile::{PdoName, integer, lss};
use crate::rules::{Context, NodeMap};
use crate::session::{Bus, Node};
use crate::wire::NodeId;
use crate::wire::canopen::lss::Content;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::{NmtState, ObjectAddress};

/// A node, and the other nodes with rules.
pub(super) struct NodeJudge<'a> {
    pub(super) bus: &'a Bus,
    pub(super) id: NodeId,
    pub(super) node: &'a Node,
    pub(super) own: &'a mut NodeRules,
    pub(super) others: &'a NodeMap<Box<NodeRules>>,
}

/// The event that is judged and its frames; without event a time that passed.
#[derive(Clone, Copy)]
pub(super) struct Occasion<'a> {
    pub(super) event: Option<&'a Event>,
    pub(super) frames: FrameRange,
}

impl<'a> Occasion<'a> {
    pub(super) fn of(event: &'a Event) -> Self {
        Self { event: Some(event), frames: event.frames }
    }

    /// A time that passed.
    pub(super) fn of_time(bus: &Bus) -> Self {
        Self { event: None, frames: FrameRange::one(bus.last_frame()) }
    }
}

impl NodeJudge<'_> {
    /// Numbers of the rules that are picked, without those that are switched off.
    pub(super) fn numbers(&self, picks: impl Fn(&DeviceRule) -> bool) -> Vec<usize> {
        self.own.record.plan.rules().filter(|(_, rule)| picks(rule)).map(|(number, _)| number).collect()
    }

    /// Facts at a time in the clock of the rules.
    #[inline]
    pub(super) fn facts(&self, now: i64) -> ProvenFacts<'_> {
        let Self { bus, id, node, ref own, others } = *self;
        ProvenFacts { bus, id, node, own: &own.record, others, now }
    }

    /// Runs a task with one rule.
    #[inline]
    pub(super) fn judge_one(
        &mut self,
        number: usize,
        occasion: Occasion<'_>,
        context: &mut Context<'_>,
        task: impl FnOnce(&RuleCase<'_>, &mut RuleProgress, &mut Context<'_>),
    ) {
        let NodeRules { record, progress, .. } = &mut *self.own;
        let (Some((rule, place)), Some(progress)) = (record.plan.rule(number), progress.get_mut(number))
        else {
            return;
        };
        let own = &*record;
        let Self { bus, id, node, others, .. } = *self;
        let facts = ProvenFacts { bus, id, node, own, others, now: context.now };
        let before = std::mem::replace(&mut context.rule, place);
        let Occasion { event, frames } = occasion;
        task(&RuleCase { facts, rule, number, event, frames }, progress, context);
        context.rule = before;
    }

    /// The first frame of the node: an event that must never occur could do so from now on.
    #[inline]
    pub(super) fn note_presence(&mut self, occasion: Occasion<'_>, context: &mut Context<'_>) {
        if !self.own.is_present && self.node.last_seen().0 != 0 {
            self.pass_by_presence(occasion, context);
        }
    }

    #[cold]
    fn pass_by_presence(&mut self, occasion: Occasion<'_>, context: &mut Context<'_>) {
        self.own.is_present = true;
        let by_presence = |rule: &DeviceRule| match rule.kind {
            RuleKind::Never => rule.during.0.is_empty(),
            RuleKind::ReservedId => true,
            _ => false,
        };
        for number in self.numbers(by_presence) {
            self.judge_one(number, occasion, context, |_, _, context| context.pass());
        }
    }

    /// Notes when the node sent its last frame.
    pub(super) fn note_heard(&mut self, context: &Context<'_>) {
        let (frame, stamp) = self.node.last_seen();
        if let Some(stamp) = stamp.filter(|_| frame != 0) {
            self.own.record.heard = Some(self.bus.monotonic(stamp).saturating_sub(context.silence));
        }
    }

    /// Each rule that waits for an event judges it.
    fn judge(&mut self, event: &TriggerEvent<'_>, occasion: Occasion<'_>, context: &mut Context<'_>) {
        for number in self.numbers(|rule| concerns(rule, event)) {
            self.judge_one(number, occasion, context, |case, progress, context| {
                kinds::judge_event(case, progress, event, context);
            });
        }
    }

    /// SYNC is too frequent to look through all rules.
    fn on_sync(&mut self, occasion: Occasion<'_>, context: &mut Context<'_>) {
        if self.own.record.plan.syncs.is_empty() || self.bus.last_sync() != Some(self.node.sync()) {
            return;
        }
        let mut place = 0;
        while let Some(number) = self.own.record.plan.syncs.get(place).copied() {
            self.judge_one(number, occasion, context, |case, progress, context| {
                kinds::judge_event(case, progress, &TriggerEvent::Sync, context);
            });
            place += 1;
        }
    }

    /// `while` of any rule may begin or end.
    fn follow_while(&mut self, occasion: Occasion<'_>, context: &mut Context<'_>) {
        let mut place = 0;
        while let Some(number) = self.own.record.plan.stretches.get(place).copied() {
            self.judge_one(number, occasion, context, kinds::follow_while);
            place += 1;
        }
    }

    /// Any event but a PDO, a message or a frame.
    pub(super) fn on_event(&mut self, event: &Event, context: &mut Context<'_>) {
        let occasion = Occasion::of(event);
        self.note_presence(occasion, context);
        match &event.kind {
            EventKind::Sync { .. } => return self.on_sync(occasion, context),
            EventKind::Lss { command, from_master, content } => {
                let lss = LssEvent {
                    service: lss().service(*command),
                    is_answer: !from_master,
                    value: parameter(content),
                };
                return self.judge(&TriggerEvent::Lss(lss), occasion, context);
            }
            EventKind::GuardRequest => return self.judge(&TriggerEvent::Guard, occasion, context),
            EventKind::SdoTransfer(transfer) => self.on_transfer(transfer, occasion, context),
            EventKind::NmtCommand { service, .. } => self.on_command(*service, occasion, context),
            EventKind::NmtState(change) if change.to != NmtState::Operational => {
                self.own.record.last.forget_sent();
            }
            EventKind::NodeLost(_) => self.own.record.last.forget_sent(),
            EventKind::BootUp { .. } | EventKind::AddressClaim(_) => self.on_start(occasion, context),
            EventKind::Emcy(emergency) => {
                if emergency.boot.is_some() {
                    self.on_start(occasion, context);
                }
                if let Some(code) = emergency.code.filter(|code| *code != 0) {
                    self.judge(&TriggerEvent::Emcy(code), occasion, context);
                }
            }
            EventKind::DeviceState(state) => {
                self.own.record.note_change(state.channel, context.now);
                self.judge(&TriggerEvent::State(state.channel, &state.to), occasion, context);
            }
            EventKind::MessageGap(gap) if gap.came_again => self.on_gap_end(gap, occasion, context),
            EventKind::Dtc(dtc) if matches!(dtc.action, DtcAction::Raised | DtcAction::Recurred) => {
                self.judge(&TriggerEvent::Dtc(dtc.spn, dtc.fmi), occasion, context);
            }
            _ => {}
        }
        self.follow_while(occasion, context);
        self.note_heard(context);
    }

    /// The event of the message itself follows, but the rules about its interval judge the gap now.
    fn on_gap_end(&mut self, gap: &MessageGap, occasion: Occasion<'_>, context: &mut Context<'_>) {
        let device = Arc::clone(&self.own.record.plan.device);
        let address = self.id.number();
        let Some(spec) = device.messages.iter().find(|spec| spec.concerns(gap.pgn, address)) else { return };
        let message = TriggerEvent::Message(&spec.name);
        for number in self.numbers(|rule| rule.kind == RuleKind::MaxInterval && concerns(rule, &message)) {
            self.judge_one(number, occasion, context, |case, progress, context| {
                kinds::judge_event(case, progress, &message, context);
            });
        }
    }

    /// A reset ends all measurements; whether a boot-up follows depends on the device.
    fn on_command(&mut self, service: NmtService, occasion: Occasion<'_>, context: &mut Context<'_>) {
        self.judge(&TriggerEvent::Nmt(service.name()), occasion, context);
        if matches!(service, NmtService::ResetNode | NmtService::ResetCommunication) {
            self.own.reset();
            self.own.record.last.clear();
        }
    }

    fn on_start(&mut self, occasion: Occasion<'_>, context: &mut Context<'_>) {
        self.judge(&TriggerEvent::Boot, occasion, context);
        self.own.reset();
        self.own.record.last.clear();
        self.own.record.last.is_fresh = true;
    }

    fn on_transfer(&mut self, transfer: &SdoTransfer, occasion: Occasion<'_>, context: &mut Context<'_>) {
        for number in self.numbers(|rule| rule.kind == RuleKind::Expedited) {
            self.judge_one(number, occasion, context, |case, _, context| {
                frames::judge_transfer(case, transfer, context);
            });
        }
        let Some(object) = transfer.object else { return };
        let before = self.last_number(object);
        let Some(mut update) = update_of(transfer, before) else { return };
        update.is_fresh = before.is_none() && self.own.record.last.is_fresh;
        self.judge(&TriggerEvent::Value(update), occasion, context);
        if transfer.outcome == Outcome::Complete
            && let Some(name) = PdoName::of_parameter(object.index)
        {
            self.own.reconfigure(name);
        }
    }

    /// The last number written to an object, also if it waits for a restart.
    fn last_number(&self, object: ObjectAddress) -> Option<i64> {
        if let Some(waiting) = self.node.store().waiting(object) {
            let meaning = self.node.meaning(object)?;
            return integer(&meaning.decode(&waiting.value));
        }
        let record = &self.own.record;
        let sent = record.plan.watched(object).and_then(|(place, _)| record.last.get(place));
        match (sent, self.node.proven(object)) {
            (Some(sent), Some((raw, origin))) => Some(if origin.frame > sent.frame { raw } else { sent.raw }),
            (sent, stored) => sent.map(|sent| sent.raw).or(stored.map(|(raw, _)| raw)),
        }
    }
}

/// The byte after the command specifier, if it has a meaning of its own.
const fn parameter(content: &Content) -> Option<u8> {
    match content {
        Content::Mode(value) | Content::NodeId(value) | Content::Result { code: value, .. } => Some(*value),
        Content::BitTiming { table, .. } => Some(*table),
        _ => None,
    }
}
