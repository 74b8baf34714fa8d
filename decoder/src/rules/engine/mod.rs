//! Runs the rules over the events of a capture.

mod interests;
pub(super) mod names;
pub(super) mod setup;

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

use self::interests::Interests;
use self::setup::Setup;
use super::context::meter::Meter;
use super::context::traffic::Traffic;
use super::context::{Context, LEDGER, Wake};
use super::device::{self, DeviceRules};
use super::ledger::causes::causes;
use super::ledger::{Ledger, News, What, occurrence};
use super::{REGISTRY, Rule};
use crate::event::{Event, EventKind, FrameRange, Pdo, Protocol};
use crate::finding::Findings;
use crate::frame::Frame;
use crate::query::KindSet;
use crate::session::{Bus, Buses, Observer};
use crate::statistics::Quality;

/// Frames from which the step of the stamps is known.
const STAMPS_JUDGED: u64 = 1_000;

/// Kinds that limit the verdicts.
const LIMITING: [&str; 5] = ["unreadable", "lost-frames", "clock-step", "bus-silent", "link"];

/// Wakes while time goes on by one step: it may leap over years, and who asks to be woken again and again is woken
/// at its end then.
const WAKES_AT_ONCE: usize = 1_000;

/// Judges one capture. A rule sees one bus only: each has rules of its own.
pub struct Engine {
    setup: Arc<Setup>,
    ledger: Ledger,
    buses: Vec<BusJudge>,
    quality: Quality,
    /// News that wait until the stamps are known to be more than a made-up step.
    held: Vec<News>,
    /// Kinds that may explain findings or limit the verdicts.
    explaining: KindSet,
}

/// The rules of one bus, and what they share.
struct BusJudge {
    rules: Vec<(u16, Box<dyn Rule>)>,
    interests: Interests,
    shared: Shared,
    has_begun: bool,
    /// Which rules want PDOs, and whether one changed its mind.
    wants: Vec<bool>,
    has_turned: bool,
}

/// What the rules of one bus share.
struct Shared {
    name: Arc<str>,
    traffic: Traffic,
    meter: Meter,
    is_tested: bool,
    wakes: BinaryHeap<Wake>,
    now: i64,
    silence: i64,
    has_time: bool,
    /// Step of the stamps in nanoseconds.
    granularity: i64,
}

impl Shared {
    /// What a rule sees; which rule it is is set for each.
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
            bus_name: &self.name,
            rule: 0,
            place: 0,
            ledger,
            wakes: &mut self.wakes,
        }
    }
}

impl Engine {
    /// An engine that has seen nothing.
    pub fn new(setup: Arc<Setup>) -> Self {
        let explaining = KindSet::by_name(|name| causes().explaining().iter().any(|by| by == name));
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

    /// Takes each frame before its events: its stamp tells how far times can be trusted.
    #[inline]
    pub fn frame(&mut self, frame: &Frame) {
        self.quality.frame(frame);
        if let Some(judge) = self.buses.get_mut(usize::from(frame.bus.0)) {
            judge.shared.meter.frame(frame);
        }
    }

    /// Judges an event. News of findings go to `out` as events of their own.
    #[inline]
    pub fn event(&mut self, event: &Event, bus: &Bus, out: &mut dyn Observer) {
        let index = usize::from(bus.index().0);
        while self.buses.len() <= index {
            self.buses.push(BusJudge::new(bus, &self.setup, &mut self.ledger));
        }
        if let Some(judge) = self.buses.get_mut(index) {
            if self.quality.frames <= STAMPS_JUDGED {
                judge.shared.granularity = self.quality.granularity().unwrap_or(0);
            }
            judge.event(event, bus, &mut self.ledger);
            if self.explaining.contains(&event.kind) {
                self.ledger.saw(event.kind.name(), bus.index(), judge.shared.now);
                self.quality.event(event);
            }
        }
        // Behind the rules: what they say of a case at its end belongs to it.
        if let EventKind::TestCase(marker) = &event.kind {
            self.ledger.mark(*marker, event.frames.last);
        }
        if !self.ledger.news.is_empty() || !self.held.is_empty() {
            self.tell(bus, self.quality.has_varied(), out);
        }
    }

    /// Lets time pass on a live bus that is quiet. Whether all of it fell silent, which puts deadlines off, only the
    /// next frame tells: until then none is judged where that can be.
    pub fn advance(&mut self, bus: &Bus, out: &mut dyn Observer) {
        if let Some(judge) = self.buses.get_mut(usize::from(bus.index().0))
            && bus.silence_limit().is_none()
        {
            judge.pass_time(bus.now(), bus, &mut self.ledger);
        }
        self.tell(bus, true, out);
    }

    /// The capture ended: closes what is open, and gives everything that was judged.
    pub fn finish(mut self, buses: Buses<'_>, out: &mut dyn Observer) -> Findings {
        for (judge, bus) in self.buses.iter_mut().zip(buses) {
            judge.all(bus, &mut self.ledger, |rule, context| rule.finish(context));
            self.ledger.close_all(bus);
        }
        for (rule, bus) in self.setup.expectations_elsewhere(buses) {
            if self.ledger.rules.get(usize::from(rule)).is_some_and(|info| info.is_on) {
                self.ledger.unexercised(rule, format!("there is no bus '{bus}'"));
            }
        }
        let made_up = self.quality.made_up_interval();
        let is_timed = made_up.is_none() && self.quality.first.is_some();
        for bus in buses {
            self.tell(bus, is_timed, out);
        }
        let notes = self.quality.limits();
        self.ledger.into_findings(is_timed, notes)
    }

    /// Writes what is new; findings about times wait until times are known to be real.
    #[cold]
    fn tell(&mut self, bus: &Bus, is_timed: bool, out: &mut dyn Observer) {
        let mut news = std::mem::take(&mut self.held);
        news.append(&mut self.ledger.news);
        for one in news {
            let Some((group, said)) = self.ledger.tell(one) else { continue };
            let rule = self.ledger.rules.get(usize::from(group.key.rule));
            let waits = rule.is_some_and(|rule| rule.is_timing) && !is_timed;
            if waits || group.key.bus != bus.index() {
                self.held.push(one);
                continue;
            }
            let is_repeated = said.count > 1;
            let kind = match one.what {
                What::Opened => EventKind::FindingOpened(Box::new(said)),
                What::Closed | What::Ended => EventKind::FindingClosed(Box::new(said)),
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
            traffic: Traffic::default(),
            meter: Meter::new(bus.bit_rate()),
            is_tested: false,
            wakes: BinaryHeap::new(),
            now: i64::MIN,
            silence: 0,
            has_time: false,
            granularity: 0,
        };
        let interests = Interests::default();
        let mut judge = Self {
            rules: Vec::new(),
            interests,
            shared,
            has_begun: false,
            wants: Vec::new(),
            has_turned: true,
        };
        let devices = DeviceRules::new(bus, ledger);
        let kinds = devices.wanted();
        judge.add(0, Box::new(devices), |interests, place| interests.kinds(kinds, place));
        for (place, entry) in REGISTRY.iter().enumerate() {
            let is_on = ledger.rules.get(place).is_some_and(|rule| rule.is_on);
            if let (true, Ok(rule)) = (is_on, u16::try_from(place)) {
                judge.add(rule, (entry.make)(&setup.policy), |interests, place| {
                    interests.declared(entry.declaration.kinds, place);
                });
            }
        }
        for (rule, expectation) in setup.expectations_on(bus.name()) {
            if ledger.rules.get(usize::from(rule)).is_some_and(|info| info.is_on) {
                let kinds = expectation.kinds();
                judge.add(rule, expectation.make(), |interests, place| interests.kinds(kinds, place));
            }
        }
        judge
    }

    fn add(&mut self, rule: u16, made: Box<dyn Rule>, interested: impl Fn(&mut Interests, u16)) {
        let Ok(place) = u16::try_from(self.rules.len()) else { return };
        self.rules.push((rule, made));
        interested(&mut self.interests, place);
    }

    #[inline]
    fn event(&mut self, event: &Event, bus: &Bus, ledger: &mut Ledger) {
        if let Some(stamp) = event.time {
            let monotonic = bus.monotonic(stamp);
            if let EventKind::BusSilent { gap } = event.kind {
                // Deadlines before the bus counted as silent have passed: time goes on from the last of them.
                let silence = self.shared.silence.saturating_add(gap);
                self.shared.silence = silence.min(monotonic.saturating_sub(self.shared.now));
            }
            self.shared.has_time = true;
            self.pass_time(monotonic, bus, ledger);
        }
        if !std::mem::replace(&mut self.has_begun, true) {
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

    /// Most events are PDOs: no rule changes its mind about them because of one, requests apart.
    #[inline]
    fn pdo(&mut self, pdo: &Pdo, event: &Event, bus: &Bus, ledger: &mut Ledger) {
        self.shared.traffic.saw_pdo(pdo, self.shared.now, event.frames.last);
        let mut context = self.shared.context(bus, ledger);
        for place in self.interests.of_pdo(pdo, event) {
            if let Some((rule, made)) = self.rules.get_mut(usize::from(*place)) {
                (context.rule, context.place) = (*rule, *place);
                made.event(event, &mut context);
            }
        }
        if pdo.is_request || self.has_turned {
            self.ask_for_pdos();
        }
    }

    fn other(&mut self, event: &Event, bus: &Bus, ledger: &mut Ledger) {
        match &event.kind {
            EventKind::Sync { .. } => self.shared.traffic.saw_sync(),
            EventKind::TestCase(_) => self.shared.is_tested = true,
            _ => {}
        }
        let mut context = self.shared.context(bus, ledger);
        for place in self.interests.of(&event.kind) {
            if let Some((rule, made)) = self.rules.get_mut(usize::from(*place)) {
                (context.rule, context.place) = (*rule, *place);
                made.event(event, &mut context);
                self.has_turned |= self.wants.get(usize::from(*place)) != Some(&made.wants_pdos());
            }
        }
        if self.has_turned {
            self.ask_for_pdos();
        }
        if device::may_attach(&event.kind) {
            self.listen();
        }
    }

    /// What is asked for by the rules of devices changed: they stand first, and explain others.
    #[cold]
    fn listen(&mut self) {
        if let Some(kinds) = self.rules.first().and_then(|(_, devices)| devices.kinds()) {
            self.interests.renew(0, kinds);
        }
    }

    /// Notes which rules want PDOs now.
    #[cold]
    fn ask_for_pdos(&mut self) {
        self.has_turned = false;
        self.wants.resize(self.rules.len(), true);
        for ((place, (_, rule)), known) in (0..).zip(&self.rules).zip(&mut self.wants) {
            let wants = rule.wants_pdos();
            if std::mem::replace(known, wants) != wants {
                self.interests.want_pdos(place, wants);
            }
        }
    }

    /// Time goes on to a monotonic time: wakes whoever asked for one before it.
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
        let Some((rule, made)) = self.rules.get_mut(usize::from(place)) else { return };
        let mut context = shared.context(bus, ledger);
        (context.rule, context.place) = (*rule, place);
        made.wake(token, &mut context);
        self.has_turned |= self.wants.get(usize::from(place)) != Some(&made.wants_pdos());
    }

    /// Calls all rules.
    #[cold]
    fn all(&mut self, bus: &Bus, ledger: &mut Ledger, call: fn(&mut dyn Rule, &mut Context<'_>)) {
        let mut context = self.shared.context(bus, ledger);
        for (place, (rule, made)) in self.rules.iter_mut().enumerate() {
            (context.rule, context.place) = (*rule, u16::try_from(place).unwrap_or(LEDGER));
            call(&mut **made, &mut context);
        }
        self.has_turned = true;
    }
}

/// Judges events on their way to an observer; news of findings come right behind what shows them.
pub struct Judge<'a> {
    /// The engine.
    pub engine: &'a mut Engine,
    /// Where events and news go.
    pub out: &'a mut dyn Observer,
}

impl Observer for Judge<'_> {
    #[inline]
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.out.event(event, bus);
        self.engine.event(event, bus, self.out);
    }
}

/// Frames of a time that passed: the last one heard.
fn last_frame(bus: &Bus) -> FrameRange {
    FrameRange::one(bus.last_frame())
}
