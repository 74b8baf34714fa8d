//! Delivers the events of one bus to its rules.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

use super::interests::RuleInterests;
use super::needs::NeedsTable;
use super::setup::RuleSetup;
use crate::event::{DecodedPdo, Event, EventKind, FrameRange};
use crate::rules::context::meter::FrameMeter;
use crate::rules::context::pdo_slot::PdoFrame;
use crate::rules::context::traffic::PdoTraffic;
use crate::rules::context::{LEDGER, RuleContext, Wake};
use crate::rules::device::{self, DeviceRules};
use crate::rules::expectation::CompiledExpectation;
use crate::rules::general::longest_period;
use crate::rules::ledger::{FindingLedger, RuleRelations, build_occurrence};
use crate::rules::{REGISTRY, Rule};
use crate::session::{Bus, Node};

/// Maximum wake-ups in one step of time. Timestamps can leap over years; a rule that requests a wake-up again
/// and again then gets the next one at the end of the leap.
const WAKES_AT_ONCE: usize = 1_000;

/// A rule at work on one bus.
pub(super) struct RuleInstance {
    /// Number of the rule in the ledger.
    pub(super) number: u16,
    pub(super) rule: Box<dyn Rule>,
    /// Events with frames before and after a hole are not delivered.
    skips_holes: bool,
    /// The rule receives PDOs while it wants them.
    has_pdos: bool,
}

/// Rule instances of one bus with their shared state.
pub(super) struct BusJudge {
    pub(super) rules: Vec<RuleInstance>,
    pub(super) interests: RuleInterests,
    pub(super) shared: SharedBusState,
    has_begun: bool,
    /// Per rule: whether it wants PDOs; `None` for a rule without PDOs. `has_turned` is set when the answer of a rule
    /// may have changed.
    wants: Vec<Option<bool>>,
    has_turned: bool,
    pub(super) needs: NeedsTable,
    /// Monotonic time of the bus up to which no frame needs its event because of its time; `i64::MIN` if this is not known.
    pub(super) quiet_until: i64,
    /// Ids of the profiles whose expectations are among the rules.
    profiles: Vec<String>,
    /// Last frame whose event is for few rules only, until its event.
    pub(super) counted: Option<CountedFrame>,
    /// Number of the last such frame.
    pub(super) last_counted: Option<u64>,
}

/// A frame that is counted for all rules but those that need each event of its identifier.
#[derive(Debug, Clone, Copy)]
pub(super) struct CountedFrame {
    /// Number of the frame.
    pub(super) frame: u64,
    /// Index of its identifier on the bus.
    pub(super) identifier: usize,
}

/// State that all rules of one bus share.
pub(super) struct SharedBusState {
    name: Arc<str>,
    pub(super) traffic: PdoTraffic,
    pub(super) meter: FrameMeter,
    is_tested: bool,
    pub(super) wakes: BinaryHeap<Wake>,
    pub(super) now: i64,
    pub(super) silence: i64,
    /// First frame after the last silence.
    resumed: u64,
    has_time: bool,
    /// Timestamp resolution in ns.
    pub(super) granularity: i64,
    /// The answer of a rule about the next PDOs may have changed.
    pub(super) has_news: bool,
}

impl SharedBusState {
    /// Context for the rules of this bus; the caller sets `rule` and `place`.
    #[inline]
    pub(super) fn rule_context<'a>(
        &'a mut self,
        bus: &'a Bus,
        ledger: &'a mut FindingLedger,
    ) -> RuleContext<'a> {
        RuleContext {
            bus,
            now: self.now,
            has_time: self.has_time,
            traffic: &self.traffic,
            meter: &self.meter,
            is_tested: self.is_tested,
            granularity: self.granularity,
            silence: self.silence,
            resumed: self.resumed,
            bus_name: &self.name,
            rule: 0,
            place: 0,
            ledger,
            wakes: &mut self.wakes,
            has_news: &mut self.has_news,
        }
    }
}

impl BusJudge {
    pub(super) fn new(bus: &Bus, setup: &RuleSetup, ledger: &mut FindingLedger) -> Self {
        let shared = SharedBusState {
            name: bus.name().into(),
            traffic: PdoTraffic::new(longest_period(&setup.policy)),
            meter: FrameMeter::new(bus.bit_rate()),
            is_tested: false,
            wakes: BinaryHeap::new(),
            now: i64::MIN,
            silence: 0,
            resumed: 0,
            has_time: false,
            granularity: 0,
            has_news: false,
        };
        let interests = RuleInterests::default();
        let mut judge = Self {
            rules: Vec::new(),
            interests,
            shared,
            has_begun: false,
            wants: Vec::new(),
            has_turned: true,
            needs: NeedsTable::new(),
            quiet_until: i64::MIN,
            profiles: Vec::new(),
            counted: None,
            last_counted: None,
        };
        let devices = DeviceRules::new(bus, ledger);
        let kinds = devices.needed_kinds();
        let instance =
            RuleInstance { number: 0, rule: Box::new(devices), skips_holes: false, has_pdos: false };
        judge.add_rule(instance, |interests, place| interests.register_kinds(kinds, place));
        for (place, entry) in REGISTRY.iter().enumerate() {
            let is_on = ledger.rules.get(place).is_some_and(|rule| rule.is_on);
            if let (true, Ok(number)) = (is_on, u16::try_from(place)) {
                let rule = (entry.make)(&setup.policy);
                let instance = RuleInstance {
                    number,
                    rule,
                    skips_holes: entry.declaration.skips_holes,
                    has_pdos: false,
                };
                judge.add_rule(instance, |interests, place| interests.declare_rule(entry.declaration, place));
            }
        }
        for (number, expectation) in setup.expectations_on(bus.name()) {
            if ledger.rules.get(usize::from(number)).is_some_and(|info| info.is_on) {
                judge.add_expectation(number, expectation);
            }
        }
        judge.add_expectations_of_profiles(bus, ledger);
        judge
    }

    fn add_expectation(&mut self, number: u16, expectation: &CompiledExpectation) {
        let kinds = expectation.needed_kinds();
        let rule = expectation.build_rule();
        let instance = RuleInstance { number, rule, skips_holes: false, has_pdos: false };
        self.add_rule(instance, |interests, place| interests.register_kinds(kinds, place));
    }

    /// Adds the expectations of profiles that are now assigned to a node.
    #[cold]
    fn add_expectations_of_profiles(&mut self, bus: &Bus, ledger: &mut FindingLedger) {
        for device in bus.nodes().filter(|node| node.assigned_by().is_some()).map(Node::device) {
            if device.expectations.is_empty() || self.profiles.contains(&device.id) {
                continue;
            }
            self.profiles.push(device.id.clone());
            for entry in &device.expectations {
                match CompiledExpectation::compile_entry(entry, "") {
                    Ok(expectation) => {
                        let info = expectation.rule_info().clone();
                        if let Some(number) = ledger.add_rule(info, RuleRelations::default()) {
                            self.add_expectation(number, &expectation);
                        }
                    }
                    Err(error) => {
                        let info = CompiledExpectation::broken_info(entry);
                        if let Some(number) = ledger.add_rule(info, RuleRelations::default()) {
                            ledger.note_unexercised(number, error.message);
                        }
                    }
                }
            }
            self.has_turned = true;
            self.needs.forget_all();
        }
    }

    fn add_rule(&mut self, instance: RuleInstance, interested: impl Fn(&mut RuleInterests, u16)) {
        let Ok(place) = u16::try_from(self.rules.len()) else { return };
        self.rules.push(instance);
        interested(&mut self.interests, place);
    }

    #[inline]
    pub(super) fn on_event(&mut self, event: &Event, bus: &Bus, ledger: &mut FindingLedger) {
        self.quiet_until = i64::MIN;
        if let Some(stamp) = event.time {
            let monotonic = bus.monotonic(stamp);
            if let EventKind::BusSilent { gap } = event.kind {
                // Deadlines before the start of the silence have passed: time continues from the last of
                // them.
                self.shared.resumed = event.frames.last;
                self.shared.traffic.saw_hole(event.frames.last);
                self.needs.forget_all();
                let silence = self.shared.silence.saturating_add(gap);
                self.shared.silence = silence.min(monotonic.saturating_sub(self.shared.now));
            }
            self.shared.has_time = true;
            self.pass_time(monotonic, bus, ledger);
        }
        // A notice of the reader has no frame and no time: the capture begins after it.
        let is_of_capture = event.time.is_some() || event.frames.last > 0;
        if is_of_capture && !std::mem::replace(&mut self.has_begun, true) {
            self.call_all(bus, ledger, |rule, context| rule.begin_bus(context));
        }
        if self.shared.meter.take_over() {
            self.call_all(bus, ledger, |rule, context| rule.on_second(context));
        }
        match &event.kind {
            EventKind::Pdo(pdo) => self.on_pdo(pdo, event, bus, ledger),
            _ => self.on_other(event, bus, ledger),
        }
    }

    /// Hot path: only a PDO request can change whether a rule wants PDOs.
    #[inline]
    fn on_pdo(&mut self, pdo: &DecodedPdo, event: &Event, bus: &Bus, ledger: &mut FindingLedger) {
        let identifier = bus.identifiers().identifier_of_event(pdo.cob_id).unwrap_or(usize::MAX);
        if self.needs.counted_entry(identifier).is_some() {
            self.pass_on_skipped(identifier, bus, ledger);
        }
        if !pdo.is_request {
            self.needs.count_event(identifier);
        }
        let frame = PdoFrame::new(pdo, self.shared.now, event.frames.last, event.routine);
        self.shared.has_news = self.shared.traffic.saw_pdo((pdo, identifier), &frame);
        let mut context = self.shared.rule_context(bus, ledger);
        for place in self.interests.of_pdo(pdo, event) {
            if let Some(RuleInstance { number, rule, .. }) = self.rules.get_mut(usize::from(*place)) {
                (context.rule, context.place) = (*number, *place);
                rule.on_event(event, &mut context);
            }
        }
        if std::mem::take(&mut self.shared.has_news) {
            self.needs.forget_identifier(identifier);
        }
        if pdo.is_request || self.has_turned {
            self.ask_for_pdos();
        } else if self.needs.is_unknown(
            identifier,
            bus.identifiers().version_of(identifier),
            usize::from(pdo.length),
        ) {
            self.ask_for_needs(identifier, event, bus, ledger);
        }
    }

    fn on_other(&mut self, event: &Event, bus: &Bus, ledger: &mut FindingLedger) {
        match &event.kind {
            EventKind::Sync { .. } => self.shared.traffic.saw_sync(),
            EventKind::TestCase(_) => self.shared.is_tested = true,
            EventKind::J1939Message(message) => {
                if let Some(identifier) = bus.identifiers().identifier_of_event(message.can_id) {
                    self.pass_on_skipped(identifier, bus, ledger);
                }
            }
            _ => {}
        }
        let mut context = self.shared.rule_context(bus, ledger);
        let is_across_hole = context.is_across_hole(event.frames.first);
        for place in self.interests.rules_for(&event.kind) {
            if let Some(instance) = self.rules.get_mut(usize::from(*place))
                && !(is_across_hole && instance.skips_holes)
            {
                (context.rule, context.place) = (instance.number, *place);
                instance.rule.on_event(event, &mut context);
                if instance.has_pdos {
                    let wants = self.wants.get(usize::from(*place)).copied().flatten();
                    self.has_turned |= wants.is_some_and(|wants| wants != instance.rule.wants_pdos());
                }
            }
        }
        if std::mem::take(&mut self.shared.has_news) {
            self.needs.forget_all();
        }
        if self.has_turned {
            self.ask_for_pdos();
        } else if let EventKind::J1939Message(message) = &event.kind
            && let Some(identifier) = bus.identifiers().identifier_of_event(message.can_id)
            && self.needs.is_unknown(
                identifier,
                bus.identifiers().version_of(identifier),
                message.payload().len(),
            )
        {
            self.ask_for_needs(identifier, event, bus, ledger);
        }
        if device::may_attach(&event.kind) {
            self.update_kinds();
            self.add_expectations_of_profiles(bus, ledger);
        }
    }

    /// Updates the event kinds of the device rules (index 0).
    #[cold]
    fn update_kinds(&mut self) {
        if let Some(kinds) = self.rules.first().and_then(|devices| devices.rule.changed_kinds()) {
            self.interests.renew_kinds(0, kinds);
            self.needs.forget_all();
        }
    }

    /// Asks every rule whether it wants PDOs now.
    #[cold]
    fn ask_for_pdos(&mut self) {
        self.has_turned = false;
        self.wants.resize(self.rules.len(), None);
        let mut turned = Vec::new();
        for place in self.interests.with_pdos() {
            let index = usize::from(place);
            let (Some(instance), Some(known)) = (self.rules.get_mut(index), self.wants.get_mut(index)) else {
                continue;
            };
            instance.has_pdos = true;
            let wants = instance.rule.wants_pdos();
            if known.replace(wants) != Some(wants) {
                turned.push((place, wants));
            }
        }
        for (place, wants) in turned {
            self.interests.want_pdos(place, wants);
            self.needs.forget_all();
        }
    }

    /// Advances to a monotonic time and processes all wake-ups due before it.
    #[inline]
    pub(super) fn pass_time(&mut self, monotonic: i64, bus: &Bus, ledger: &mut FindingLedger) {
        let now = monotonic.saturating_sub(self.shared.silence).max(self.shared.now);
        let mut left = WAKES_AT_ONCE;
        while let Some(Reverse((due, place, token))) = self.shared.wakes.peek().copied()
            && due < now
        {
            self.shared.wakes.pop();
            left = left.saturating_sub(1);
            if left == 0 {
                self.shared.now = now;
            }
            self.on_wake((due, place, token), bus, ledger);
        }
        self.shared.now = now;
    }

    #[cold]
    fn on_wake(&mut self, (due, place, token): (i64, u16, u64), bus: &Bus, ledger: &mut FindingLedger) {
        let shared = &mut self.shared;
        shared.now = shared.now.max(due);
        if place == LEDGER {
            let at = build_occurrence(bus.stamp_of(due.saturating_add(shared.silence)), last_frame(bus));
            let again = usize::try_from(token).ok().and_then(|group| ledger.close_if_quiet(group, due, at));
            shared.wakes.extend(again.map(|time| Reverse((time, LEDGER, token))));
            return;
        }
        let Some(RuleInstance { number, rule, .. }) = self.rules.get_mut(usize::from(place)) else { return };
        let mut context = shared.rule_context(bus, ledger);
        (context.rule, context.place) = (*number, place);
        rule.on_wake(token, &mut context);
        let wants = self.wants.get(usize::from(place)).copied().flatten();
        self.has_turned |= wants.is_some_and(|wants| wants != rule.wants_pdos());
        if std::mem::take(&mut self.shared.has_news) {
            self.needs.forget_all();
        }
    }

    #[cold]
    pub(super) fn call_all(
        &mut self,
        bus: &Bus,
        ledger: &mut FindingLedger,
        call: fn(&mut dyn Rule, &mut RuleContext<'_>),
    ) {
        let mut context = self.shared.rule_context(bus, ledger);
        for (place, RuleInstance { number, rule, .. }) in self.rules.iter_mut().enumerate() {
            (context.rule, context.place) = (*number, u16::try_from(place).unwrap_or(LEDGER));
            call(&mut **rule, &mut context);
        }
        if std::mem::take(&mut self.shared.has_news) {
            self.needs.forget_all();
        }
        self.has_turned = true;
    }
}

/// Frame range of a deadline: the last frame received.
fn last_frame(bus: &Bus) -> FrameRange {
    FrameRange::one(bus.last_frame())
}
