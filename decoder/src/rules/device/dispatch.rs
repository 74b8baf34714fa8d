//! From events to what happens at each node they concern.

use std::sync::Arc;

use super::attached::{Attached, Course};
use super::happening::{Came, Happening, Lss};
use super::judge::{self, Case};
use super::plan::triggers;
use super::{DeviceRules, Scene, frames};
use crate::event::{DtcAction, Event, EventKind, FrameRange, MessageGap, Outcome, SdoTransfer};
use crate::frame::CanId;
use crate::profile::device::{DeviceRule, Per, RuleKind, Stretch, Trigger};
use crate::profile::{PdoName, integer, lss};
use crate::rules::{Context, NodeMap};
use crate::session::{Bus, Node};
use crate::wire::NodeId;
use crate::wire::canopen::lss::Content;
use crate::wire::canopen::nmt::NmtService;
use crate::wire::canopen::{NmtState, ObjectAddress};

/// A node that is judged.
pub(super) struct Judged<'a> {
    pub(super) bus: &'a Bus,
    pub(super) id: NodeId,
    pub(super) node: &'a Node,
    pub(super) own: &'a mut Attached,
    pub(super) others: &'a NodeMap<Box<Attached>>,
}

/// The event that is judged and its frames; without event a time that passed.
#[derive(Clone, Copy)]
pub(super) struct Now<'a> {
    pub(super) event: Option<&'a Event>,
    pub(super) frames: FrameRange,
}

impl<'a> Now<'a> {
    pub(super) fn of(event: &'a Event) -> Self {
        Self { event: Some(event), frames: event.frames }
    }

    /// A time that passed.
    pub(super) fn passed(bus: &Bus) -> Self {
        Self { event: None, frames: FrameRange::one(bus.last_frame()) }
    }
}

impl DeviceRules {
    /// All events but PDOs, messages and frames.
    pub(super) fn other(&mut self, event: &Event, context: &mut Context<'_>) {
        let bus = context.bus;
        match &event.kind {
            EventKind::NmtCommand { target: 0, .. } | EventKind::Lss { .. } | EventKind::Sync { .. } => {
                let is_sync = matches!(event.kind, EventKind::Sync { .. });
                for place in 0..self.ids.len() {
                    let id = self.ids.get(place).copied().filter(|id| id.canopen().is_some());
                    if let Some(id) = id.filter(|id| !is_sync || self.waits_for_sync(*id)) {
                        self.at(id, bus, |judged| judged.event(event, context));
                    }
                }
            }
            EventKind::BusSilent { .. } | EventKind::LostFrames { .. } | EventKind::Link { .. } => {
                for id in self.ids.clone() {
                    self.at(id, bus, |judged| judged.own.interrupted());
                }
            }
            EventKind::SdoTransfer(transfer) => {
                if transfer.object.is_some_and(|object| holds_id(object.index)) {
                    self.pdos.forget();
                }
                self.at_event(event, context);
                self.reserved(None, event, context, &|case, context| frames::given(case, transfer, context));
            }
            EventKind::BootUp { .. } => {
                self.started_anew(event);
                self.at_event(event, context);
            }
            EventKind::Emcy(emergency) => {
                if emergency.boot.is_some() {
                    self.started_anew(event);
                }
                self.at_event(event, context);
            }
            _ => self.at_event(event, context),
        }
    }

    /// Whether a node has rules about SYNC, or may be seen now for the first time.
    fn waits_for_sync(&self, id: NodeId) -> bool {
        self.nodes.get(id).is_some_and(|own| !own.is_present || !own.known.plan.syncs.is_empty())
    }

    /// Identifiers fall back to what the node keeps.
    fn started_anew(&mut self, event: &Event) {
        if event.node.is_some_and(|id| self.nodes.get(id).is_some()) {
            self.pdos.forget();
        }
    }

    fn at_event(&mut self, event: &Event, context: &mut Context<'_>) {
        let bus = context.bus;
        if let Some(id) = event.node {
            self.at(id, bus, |judged| judged.event(event, context));
        }
    }

    /// Judges identifiers the first device keeps for itself; of one frame only where they are about it.
    pub(super) fn reserved(
        &mut self,
        can_id: Option<CanId>,
        event: &Event,
        context: &mut Context<'_>,
        task: &dyn Fn(&Case<'_>, &mut Context<'_>),
    ) {
        let is_about = |rule: &DeviceRule| {
            can_id.is_none_or(|can_id| frames::reserves(rule, can_id)) && rule.ids.is_some()
        };
        let has = |id: &NodeId| {
            self.nodes.get(*id).is_some_and(|own| own.known.plan.rules().any(|(_, rule)| is_about(rule)))
        };
        let Some(id) = self.ids.iter().copied().find(has) else { return };
        let bus = context.bus;
        self.at(id, bus, |judged| {
            for number in judged.numbers(is_about) {
                judged.one(number, Now::of(event), context, |case, _, context| task(case, context));
            }
        });
    }
}

/// Whether an object may hold an identifier.
const fn holds_id(index: u16) -> bool {
    matches!(index, 0x1005 | 0x1012 | 0x1014 | 0x1400..=0x1BFF)
}

impl Judged<'_> {
    /// Numbers of the rules that are picked, those that are switched off apart.
    pub(super) fn numbers(&self, picks: impl Fn(&DeviceRule) -> bool) -> Vec<usize> {
        self.own.known.plan.rules().filter(|(_, rule)| picks(rule)).map(|(number, _)| number).collect()
    }

    /// What rules know of the node at a time.
    #[inline]
    pub(super) fn scene(&self, now: i64) -> Scene<'_> {
        let Self { bus, id, node, ref own, others } = *self;
        Scene { bus, id, node, own: &own.known, others, now }
    }

    /// Does something with one rule.
    #[inline]
    pub(super) fn one(
        &mut self,
        number: usize,
        now: Now<'_>,
        context: &mut Context<'_>,
        task: impl FnOnce(&Case<'_>, &mut Course, &mut Context<'_>),
    ) {
        let Attached { known, courses, .. } = &mut *self.own;
        let (Some((rule, place)), Some(course)) = (known.plan.rule(number), courses.get_mut(number)) else {
            return;
        };
        let own = &*known;
        let Self { bus, id, node, others, .. } = *self;
        let scene = Scene { bus, id, node, own, others, now: context.now };
        let before = std::mem::replace(&mut context.rule, place);
        let Now { event, frames } = now;
        task(&Case { scene, rule, number, event, frames }, course, context);
        context.rule = before;
    }

    /// The node is there: what must never happen has had its chance.
    #[inline]
    pub(super) fn present(&mut self, now: Now<'_>, context: &mut Context<'_>) {
        if !self.own.is_present && self.node.last_seen().0 != 0 {
            self.came(now, context);
        }
    }

    #[cold]
    fn came(&mut self, now: Now<'_>, context: &mut Context<'_>) {
        self.own.is_present = true;
        let by_presence = |rule: &DeviceRule| match rule.kind {
            RuleKind::Never => rule.during.0.is_empty(),
            RuleKind::ReservedId => true,
            _ => false,
        };
        for number in self.numbers(by_presence) {
            self.one(number, now, context, |_, _, context| context.pass());
        }
    }

    /// When the node itself was heard last.
    pub(super) fn heard(&mut self, context: &Context<'_>) {
        let (frame, stamp) = self.node.last_seen();
        if let Some(stamp) = stamp.filter(|_| frame != 0) {
            self.own.known.heard = Some(self.bus.monotonic(stamp).saturating_sub(context.silence));
        }
    }

    /// Something happened: each rule that waits for it judges it.
    fn happen(&mut self, happening: &Happening<'_>, now: Now<'_>, context: &mut Context<'_>) {
        for number in self.numbers(|rule| concerns(rule, happening)) {
            self.one(number, now, context, |case, course, context| {
                judge::happened(case, course, happening, context);
            });
        }
    }

    /// SYNC: it comes too often to look through all rules.
    fn sync(&mut self, now: Now<'_>, context: &mut Context<'_>) {
        if self.own.known.plan.syncs.is_empty() || self.bus.last_sync() != Some(self.node.sync()) {
            return;
        }
        let mut place = 0;
        while let Some(number) = self.own.known.plan.syncs.get(place).copied() {
            self.one(number, now, context, |case, course, context| {
                judge::happened(case, course, &Happening::Sync, context);
            });
            place += 1;
        }
    }

    /// Something may have begun or ended what rules call `while`.
    pub(super) fn look_again(&mut self, now: Now<'_>, context: &mut Context<'_>) {
        let mut place = 0;
        while let Some(number) = self.own.known.plan.stretches.get(place).copied() {
            self.one(number, now, context, judge::look_again);
            place += 1;
        }
    }

    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let now = Now::of(event);
        self.present(now, context);
        match &event.kind {
            EventKind::Sync { .. } => return self.sync(now, context),
            EventKind::Lss { command, from_master, content } => {
                let lss = Lss {
                    service: lss().service(*command),
                    is_answer: !from_master,
                    value: behind_command(content),
                };
                return self.happen(&Happening::Lss(lss), now, context);
            }
            EventKind::GuardRequest => return self.happen(&Happening::Guard, now, context),
            EventKind::SdoTransfer(transfer) => self.transfer(transfer, now, context),
            EventKind::NmtCommand { service, .. } => self.commanded(*service, now, context),
            EventKind::NmtState(change) if change.to != NmtState::Operational => {
                self.own.known.seen.forget_sent();
            }
            EventKind::NodeLost(_) => self.own.known.seen.forget_sent(),
            EventKind::BootUp { .. } | EventKind::AddressClaim(_) => self.started(now, context),
            EventKind::Emcy(emergency) => {
                if emergency.boot.is_some() {
                    self.started(now, context);
                }
                if let Some(code) = emergency.code.filter(|code| *code != 0) {
                    self.happen(&Happening::Emcy(code), now, context);
                }
            }
            EventKind::DeviceState(state) => {
                self.own.known.changed(state.channel, context.now);
                self.happen(&Happening::State(state.channel, &state.to), now, context);
            }
            EventKind::MessageGap(gap) if gap.came_again => self.came_late(gap, now, context),
            EventKind::Dtc(dtc) if matches!(dtc.action, DtcAction::Raised | DtcAction::Recurred) => {
                self.happen(&Happening::Dtc(dtc.spn, dtc.fmi), now, context);
            }
            _ => {}
        }
        self.look_again(now, context);
        self.heard(context);
    }

    /// A message came again: its event follows, but others judge the gap already.
    fn came_late(&mut self, gap: &MessageGap, now: Now<'_>, context: &mut Context<'_>) {
        let device = Arc::clone(&self.own.known.plan.device);
        let address = self.id.number();
        let Some(spec) = device.messages.iter().find(|spec| spec.concerns(gap.pgn, address)) else { return };
        let late = Happening::Message(&spec.name, gap.pgn);
        for number in self.numbers(|rule| rule.kind == RuleKind::MaxInterval && concerns(rule, &late)) {
            self.one(number, now, context, |case, course, context| {
                judge::happened(case, course, &late, context);
            });
        }
    }

    /// A reset ends what was measured; whether it brings a boot-up depends on the device.
    fn commanded(&mut self, service: NmtService, now: Now<'_>, context: &mut Context<'_>) {
        self.happen(&Happening::Nmt(service.name()), now, context);
        if matches!(service, NmtService::ResetNode | NmtService::ResetCommunication) {
            self.own.withdraw();
            self.own.known.seen.clear();
        }
    }

    fn started(&mut self, now: Now<'_>, context: &mut Context<'_>) {
        self.happen(&Happening::Boot, now, context);
        self.own.withdraw();
        self.own.known.seen.clear();
        self.own.known.seen.is_fresh = true;
    }

    fn transfer(&mut self, transfer: &SdoTransfer, now: Now<'_>, context: &mut Context<'_>) {
        for number in self.numbers(|rule| rule.kind == RuleKind::Expedited) {
            self.one(number, now, context, |case, _, context| {
                frames::expedited(case, transfer, context);
            });
        }
        let Some(object) = transfer.object else { return };
        let before = self.known(object);
        let Some(mut came) = Came::of(transfer, before) else { return };
        came.is_fresh = before.is_none() && self.own.known.seen.is_fresh;
        self.happen(&Happening::Came(came), now, context);
        if transfer.outcome == Outcome::Complete
            && let Some(name) = PdoName::of_parameter(object.index)
        {
            self.own.set_up_anew(name);
        }
    }

    /// The number an object was given last, also where that waits for a restart.
    fn known(&self, object: ObjectAddress) -> Option<i64> {
        if let Some(waiting) = self.node.store().waiting(object) {
            let meaning = self.node.meaning(object)?;
            return integer(&meaning.decode(&waiting.value));
        }
        let sent = self.own.known.plan.watched(object).and_then(|(place, _)| self.own.known.seen.get(place));
        match (sent, self.node.proven(object)) {
            (Some(sent), Some((raw, origin))) => Some(if origin.frame > sent.frame { raw } else { sent.raw }),
            (sent, stored) => sent.map(|sent| sent.raw).or(stored.map(|(raw, _)| raw)),
        }
    }
}

/// Whether a rule looks at what happened.
pub(super) fn concerns(rule: &DeviceRule, happening: &Happening<'_>) -> bool {
    let always = match happening {
        Happening::Came(came) => rule.subjects().any(|of| of.object == came.object),
        Happening::Boot => matches!(rule.kind, RuleKind::Order | RuleKind::Follow),
        Happening::Sync => rule.per == Some(Per::Stretch(Stretch::Sync)),
        _ => false,
    };
    always || triggers(rule).any(|trigger| happening.starts(trigger))
}

/// Whether a rule waits for a PDO.
pub(super) fn waits_for(rule: &DeviceRule, name: PdoName) -> bool {
    triggers(rule).any(|trigger| *trigger == Trigger::Pdo(name))
}

/// The byte behind the command specifier, where it says something by itself.
const fn behind_command(content: &Content) -> Option<u8> {
    match content {
        Content::Mode(value) | Content::NodeId(value) | Content::Result { code: value, .. } => Some(*value),
        Content::BitTiming { table, .. } => Some(*table),
        _ => None,
    }
}
