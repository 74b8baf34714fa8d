//! Runs the rules over the events of a capture.

mod interests;
pub(super) mod names;
mod needs;
pub(super) mod setup;
mod short_path;

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

use self::interests::Interests;
use self::needs::NeedsTable;
use self::setup::Setup;
use super::context::meter::Meter;
use super::context::traffic::{PdoFrame, Traffic};
use super::context::{Context, LEDGER, Wake};
use super::device::{self, DeviceRules};
use super::general::longest_period;
use super::ledger::causes::causes;
use super::ledger::{GroupChange, Ledger, News, occurrence};
use super::{REGISTRY, Rule};
use crate::event::{Event, EventKind, FrameRange, Pdo, Protocol};
use crate::finding::Findings;
use crate::frame::Frame;
use crate::query::KindSet;
use crate::session::{Bus, Buses, Observer, Preview};
use crate::statistics::{Quality, is_evidence};
use crate::suggestion::{Suggestion, firm_suggestions};

/// Number of frames after which the timestamp resolution is final.
const STAMPS_JUDGED: u64 = 1_000;

/// Event kinds that limit the significance of verdicts.
const LIMITING: [&str; 6] = ["unreadable", "lost-frames", "clock-step", "bus-silent", "link", "sdo-transfer"];

/// Event kinds with facts that may explain findings.
const FACTS: [&str; 3] = ["nmt-command", "sdo-transfer", "can-error"];

/// Maximum wake-ups in one step of time. Timestamps can leap over years; a rule that requests a wake-up again
/// and again then gets the next one at the end of the leap.
const WAKES_AT_ONCE: usize = 1_000;

/// Runs the rules over one capture. Each bus has its own instances of the rules.
pub struct Engine {
    setup: Arc<Setup>,
    ledger: Ledger,
    buses: Vec<BusJudge>,
    quality: Quality,
    /// Findings about times, held back until the timestamps are known to be real.
    held: Vec<News>,
    /// Event kinds that may explain findings or limit verdicts.
    explaining: KindSet,
}

/// A rule at work on one bus.
struct RuleInstance {
    /// Number of the rule in the ledger.
    number: u16,
    rule: Box<dyn Rule>,
    /// Events with frames before and after a hole are not delivered.
    skips_holes: bool,
}

/// Rule instances of one bus with their shared state.
struct BusJudge {
    rules: Vec<RuleInstance>,
    interests: Interests,
    shared: Shared,
    has_begun: bool,
    /// Per rule: whether it wants PDOs. `has_turned` is set when the answer of a rule may have changed.
    wants: Vec<bool>,
    has_turned: bool,
    needs: NeedsTable,
}

/// State that all rules of one bus share.
struct Shared {
    name: Arc<str>,
    traffic: Traffic,
    meter: Meter,
    is_tested: bool,
    wakes: BinaryHeap<Wake>,
    now: i64,
    silence: i64,
    /// First frame after the last silence.
    resumed: u64,
    has_time: bool,
    /// Timestamp resolution in ns.
    granularity: i64,
    /// The answer of a rule about the next PDOs may have changed.
    has_news: bool,
}

impl Shared {
    /// Context for the rules of this bus; the caller sets `rule` and `place`.
    #[inline]
    fn context<'a>(&'a mut self, bus: &'a Bus, ledger: &'a mut Ledger) -> Context<'a> {
        Context {
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

impl Engine {
    /// Creates an engine in its initial state.
    pub fn new(setup: Arc<Setup>) -> Self {
        let explaining = KindSet::by_name(|name| {
            FACTS.contains(&name) || causes().explaining().iter().any(|by| by == name)
        });
        let limiting = KindSet::by_name(|name| LIMITING.contains(&name));
        Self {
            ledger: Ledger::new(&setup.policy),
            setup,
            buses: Vec::new(),
            quality: Quality::default(),
            held: Vec::new(),
            explaining: explaining.or(limiting),
        }
    }

    /// Processes a frame before its events; its timestamp shows how reliable times are.
    #[inline]
    pub fn frame(&mut self, frame: &Frame) {
        self.quality.frame(frame);
        if let Some(judge) = self.buses.get_mut(usize::from(frame.bus.0)) {
            judge.shared.meter.frame(frame);
        }
    }

    /// Runs the rules on an event. Findings that open or close are emitted to `out` as events.
    #[inline]
    pub fn event(&mut self, event: &Event, bus: &Bus, out: &mut dyn Observer) {
        let index = usize::from(bus.index().0);
        while self.buses.len() <= index {
            self.buses.push(BusJudge::new(bus, &self.setup, &mut self.ledger));
        }
        if let EventKind::TestCase(_) = &event.kind {
            // Checks before the marker belong to the case before.
            for judge in &mut self.buses {
                judge.pass_on_all_skipped(bus, &mut self.ledger);
            }
        }
        if let Some(judge) = self.buses.get_mut(index) {
            if self.quality.frames <= STAMPS_JUDGED {
                judge.shared.granularity = self.quality.granularity().unwrap_or(0);
            }
            judge.event(event, bus, &mut self.ledger);
            let explains = self.explaining.contains(&event.kind);
            if explains {
                self.ledger.saw(event.kind.name(), bus.index(), judge.shared.now);
                self.ledger.observe(event, bus, judge.shared.now);
            }
            if explains || is_evidence(&event.kind) {
                self.quality.event(event);
            }
        }
        // After the rules: findings at the end marker still belong to the case.
        if let EventKind::TestCase(marker) = &event.kind {
            self.ledger.mark(*marker, event.frames.last);
        }
        if !self.ledger.news.is_empty() || !self.held.is_empty() {
            self.emit_news(bus, self.quality.has_varied(), out);
        }
    }

    /// Advances the time of a quiet live bus. Only the next frame shows whether the whole bus was silent,
    /// which suspends deadlines. Deadlines are therefore not checked while a silence is possible.
    pub fn advance(&mut self, bus: &Bus, out: &mut dyn Observer) {
        if let Some(judge) = self.buses.get_mut(usize::from(bus.index().0))
            && bus.silence_limit().is_none()
        {
            judge.pass_time(bus.now(), bus, &mut self.ledger);
        }
        self.emit_news(bus, true, out);
    }

    /// Ends the capture: closes open findings and returns all results.
    pub fn finish(mut self, buses: Buses<'_>, out: &mut dyn Observer) -> Findings {
        for (judge, bus) in self.buses.iter_mut().zip(buses) {
            judge.pass_on_all_skipped(bus, &mut self.ledger);
            judge.all(bus, &mut self.ledger, |rule, context| rule.finish(context));
            self.ledger.close_all(bus);
        }
        for (rule, bus) in self.setup.expectations_elsewhere(buses) {
            if self.ledger.rules.get(usize::from(rule)).is_some_and(|info| info.is_on) {
                self.ledger.unexercised(rule, format!("no bus '{bus}' in the capture"));
            }
        }
        let is_timed = self.quality.is_timed();
        for bus in buses {
            self.emit_news(bus, is_timed, out);
        }
        let mut notes = self.quality.limits();
        notes.extend(buses.iter().flat_map(|bus| profile_notes(bus, buses.len() == 1)));
        let error_frames = self.quality.error_frames;
        Findings { error_frames, ..self.ledger.into_findings(is_timed, notes) }
    }

    /// Results up to now, with open findings as at an end of the capture. Conditions that rules judge only at the
    /// end are not among them. Costs a copy of all groups.
    pub fn so_far(&mut self, buses: Buses<'_>) -> Findings {
        for (judge, bus) in self.buses.iter_mut().zip(buses) {
            judge.pass_on_all_skipped(bus, &mut self.ledger);
        }
        let mut ledger = self.ledger.clone();
        for bus in buses {
            ledger.close_all(bus);
        }
        let error_frames = self.quality.error_frames;
        Findings { error_frames, ..ledger.into_findings(self.quality.is_timed(), Vec::new()) }
    }

    /// Emits new findings; those about times are held back until times are known to be real.
    #[cold]
    fn emit_news(&mut self, bus: &Bus, is_timed: bool, out: &mut dyn Observer) {
        let mut news = std::mem::take(&mut self.held);
        news.append(&mut self.ledger.news);
        for one in news {
            let Some((group, said)) = self.ledger.finding_news(one) else { continue };
            let rule = self.ledger.rules.get(usize::from(group.key.rule));
            let waits = rule.is_some_and(|rule| rule.is_timing) && !is_timed;
            if waits || group.key.bus != bus.index() {
                self.held.push(one);
                continue;
            }
            let is_repeated = said.count > 1;
            let kind = match one.what {
                GroupChange::Opened => EventKind::FindingOpened(Box::new(said)),
                GroupChange::Closed | GroupChange::Ended => EventKind::FindingClosed(Box::new(said)),
            };
            let event = Event {
                time: one.at.time,
                bus: group.key.bus,
                frames: one.at.frames,
                protocol: Protocol::Can,
                node: group.key.node,
                presumed: false,
                routine: matches!(kind, EventKind::FindingClosed(_)) && !is_repeated,
                kind,
            };
            out.event(&event, bus);
        }
    }
}

impl BusJudge {
    fn new(bus: &Bus, setup: &Setup, ledger: &mut Ledger) -> Self {
        let shared = Shared {
            name: bus.name().into(),
            traffic: Traffic::new(longest_period(&setup.policy)),
            meter: Meter::new(bus.bit_rate()),
            is_tested: false,
            wakes: BinaryHeap::new(),
            now: i64::MIN,
            silence: 0,
            resumed: 0,
            has_time: false,
            granularity: 0,
            has_news: false,
        };
        let interests = Interests::default();
        let mut judge = Self {
            rules: Vec::new(),
            interests,
            shared,
            has_begun: false,
            wants: Vec::new(),
            has_turned: true,
            needs: NeedsTable::new(),
        };
        let devices = DeviceRules::new(bus, ledger);
        let kinds = devices.wanted();
        let instance = RuleInstance { number: 0, rule: Box::new(devices), skips_holes: false };
        judge.add(instance, |interests, place| interests.kinds(kinds, place));
        for (place, entry) in REGISTRY.iter().enumerate() {
            let is_on = ledger.rules.get(place).is_some_and(|rule| rule.is_on);
            if let (true, Ok(number)) = (is_on, u16::try_from(place)) {
                let rule = (entry.make)(&setup.policy);
                let instance = RuleInstance { number, rule, skips_holes: entry.declaration.skips_holes };
                judge.add(instance, |interests, place| {
                    interests.declared(entry.declaration.kinds, place);
                });
            }
        }
        for (number, expectation) in setup.expectations_on(bus.name()) {
            if ledger.rules.get(usize::from(number)).is_some_and(|info| info.is_on) {
                let kinds = expectation.kinds();
                let instance = RuleInstance { number, rule: expectation.make(), skips_holes: false };
                judge.add(instance, |interests, place| interests.kinds(kinds, place));
            }
        }
        judge
    }

    fn add(&mut self, instance: RuleInstance, interested: impl Fn(&mut Interests, u16)) {
        let Ok(place) = u16::try_from(self.rules.len()) else { return };
        self.rules.push(instance);
        interested(&mut self.interests, place);
    }

    #[inline]
    fn event(&mut self, event: &Event, bus: &Bus, ledger: &mut Ledger) {
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
            self.all(bus, ledger, |rule, context| rule.begin(context));
        }
        if self.shared.meter.take_over() {
            self.all(bus, ledger, |rule, context| rule.second(context));
        }
        match &event.kind {
            EventKind::Pdo(pdo) => self.pdo(pdo, event, bus, ledger),
            _ => self.other(event, bus, ledger),
        }
    }

    /// Hot path: only a PDO request can change whether a rule wants PDOs.
    #[inline]
    fn pdo(&mut self, pdo: &Pdo, event: &Event, bus: &Bus, ledger: &mut Ledger) {
        let identifier = bus.identifier_of_event(pdo.cob_id).unwrap_or(usize::MAX);
        if self.needs.counted(identifier).is_some() {
            self.pass_on_skipped(identifier, bus, ledger);
        }
        if !pdo.is_request {
            self.needs.hear(identifier);
        }
        let frame = PdoFrame::new(pdo, self.shared.now, event.frames.last, event.routine);
        self.shared.has_news = self.shared.traffic.saw_pdo((pdo, identifier), &frame);
        let mut context = self.shared.context(bus, ledger);
        for place in self.interests.of_pdo(pdo, event) {
            if let Some(RuleInstance { number, rule, .. }) = self.rules.get_mut(usize::from(*place)) {
                (context.rule, context.place) = (*number, *place);
                rule.event(event, &mut context);
            }
        }
        if std::mem::take(&mut self.shared.has_news) {
            self.needs.forget(identifier);
        }
        if pdo.is_request || self.has_turned {
            self.ask_for_pdos();
        } else if self.needs.is_unknown(identifier, bus.version_of(identifier)) {
            self.ask_for_needs(identifier, event, bus, ledger);
        }
    }

    fn other(&mut self, event: &Event, bus: &Bus, ledger: &mut Ledger) {
        match &event.kind {
            EventKind::Sync { .. } => self.shared.traffic.saw_sync(),
            EventKind::TestCase(_) => self.shared.is_tested = true,
            EventKind::J1939Message(message) => {
                if let Some(identifier) = bus.identifier_of_event(message.can_id) {
                    self.pass_on_skipped(identifier, bus, ledger);
                }
            }
            _ => {}
        }
        let mut context = self.shared.context(bus, ledger);
        let is_across_hole = context.is_across_hole(event.frames.first);
        for place in self.interests.of(&event.kind) {
            if let Some(RuleInstance { number, rule, skips_holes }) = self.rules.get_mut(usize::from(*place))
                && !(is_across_hole && *skips_holes)
            {
                (context.rule, context.place) = (*number, *place);
                rule.event(event, &mut context);
                self.has_turned |= self.wants.get(usize::from(*place)) != Some(&rule.wants_pdos());
            }
        }
        if std::mem::take(&mut self.shared.has_news) {
            self.needs.forget_all();
        }
        if self.has_turned {
            self.ask_for_pdos();
        } else if let EventKind::J1939Message(message) = &event.kind
            && let Some(identifier) = bus.identifier_of_event(message.can_id)
            && self.needs.is_unknown(identifier, bus.version_of(identifier))
        {
            self.ask_for_needs(identifier, event, bus, ledger);
        }
        if device::may_attach(&event.kind) {
            self.listen();
        }
    }

    /// Updates the event kinds of the device rules (index 0).
    #[cold]
    fn listen(&mut self) {
        if let Some(kinds) = self.rules.first().and_then(|devices| devices.rule.kinds()) {
            self.interests.renew(0, kinds);
            self.needs.forget_all();
        }
    }

    /// Asks every rule whether it wants PDOs now.
    #[cold]
    fn ask_for_pdos(&mut self) {
        self.has_turned = false;
        self.wants.resize(self.rules.len(), true);
        for ((place, instance), known) in (0..).zip(&self.rules).zip(&mut self.wants) {
            let wants = instance.rule.wants_pdos();
            if std::mem::replace(known, wants) != wants {
                self.interests.want_pdos(place, wants);
                self.needs.forget_all();
            }
        }
    }

    /// Advances to a monotonic time and processes all wake-ups due before it.
    #[inline]
    fn pass_time(&mut self, monotonic: i64, bus: &Bus, ledger: &mut Ledger) {
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
            self.wake((due, place, token), bus, ledger);
        }
        self.shared.now = now;
    }

    #[cold]
    fn wake(&mut self, (due, place, token): (i64, u16, u64), bus: &Bus, ledger: &mut Ledger) {
        let shared = &mut self.shared;
        shared.now = shared.now.max(due);
        if place == LEDGER {
            let at = occurrence(bus.stamp_of(due.saturating_add(shared.silence)), last_frame(bus));
            let again = usize::try_from(token).ok().and_then(|group| ledger.quiet(group, due, at));
            shared.wakes.extend(again.map(|time| Reverse((time, LEDGER, token))));
            return;
        }
        let Some(RuleInstance { number, rule, .. }) = self.rules.get_mut(usize::from(place)) else { return };
        let mut context = shared.context(bus, ledger);
        (context.rule, context.place) = (*number, place);
        rule.wake(token, &mut context);
        self.has_turned |= self.wants.get(usize::from(place)) != Some(&rule.wants_pdos());
        if std::mem::take(&mut self.shared.has_news) {
            self.needs.forget_all();
        }
    }

    #[cold]
    fn all(&mut self, bus: &Bus, ledger: &mut Ledger, call: fn(&mut dyn Rule, &mut Context<'_>)) {
        let mut context = self.shared.context(bus, ledger);
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

/// Forwards events to an observer and runs the rules on them. Findings follow directly after the event that
/// shows them.
pub struct Judge<'a> {
    /// Rules and their results.
    pub engine: &'a mut Engine,
    /// Receiver of events and findings.
    pub out: &'a mut dyn Observer,
}

impl Observer for Judge<'_> {
    #[inline]
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.out.event(event, bus);
        self.engine.event(event, bus, self.out);
    }

    #[inline]
    fn needs(&self, preview: &Preview, bus: &Bus) -> bool {
        self.out.needs(preview, bus) || self.engine.needs(preview, bus)
    }

    #[inline]
    fn skip(&mut self, preview: &Preview, bus: &Bus) {
        self.out.skip(preview, bus);
        self.engine.skip(preview, bus);
    }
}

/// Frame range of a deadline: the last frame received.
fn last_frame(bus: &Bus) -> FrameRange {
    FrameRange::one(bus.last_frame())
}
/// Statements on nodes whose profile is only suggested by their behaviour.
fn profile_notes(bus: &Bus, is_only: bool) -> Vec<String> {
    let found = firm_suggestions(bus);
    let note = |one: &Suggestion| {
        format!("{}; without its profile the rules of its manual are not exercised", one.text(bus, is_only))
    };
    found.iter().map(note).collect()
}
