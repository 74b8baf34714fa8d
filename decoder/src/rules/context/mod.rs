//! What a rule sees while it judges, and how it says what it found.

pub(super) mod meter;
pub(super) mod nodes;
pub(super) mod traffic;

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

use self::meter::Meter;
use self::traffic::Traffic;
use super::ledger::{Claim, Ledger, occurrence};
use crate::event::{Certainty, Event, FrameRange};
use crate::finding::{About, Key, Occurrence, Severity};
use crate::profile::device::Waiver;
use crate::session::{Bus, Node};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

/// A time at which something wants to look again: time, place of the rule, what it is told then.
pub(super) type Wake = Reverse<(i64, u16, u64)>;

/// Place of the ledger itself among those that are woken.
pub(super) const LEDGER: u16 = u16::MAX;

/// What a rule sees while it judges.
pub struct Context<'a> {
    /// The bus behind the event.
    pub bus: &'a Bus,
    /// Monotonic nanoseconds of the event; silences of the whole bus are left out, so that no deadline lies in one.
    pub now: i64,
    /// Whether the capture has times.
    pub has_time: bool,
    /// Step of the capture's stamps, in nanoseconds, as far as they tell.
    pub granularity: i64,
    /// PDOs by identifier.
    pub traffic: &'a Traffic,
    /// Frames in all.
    pub meter: &'a Meter,
    /// A conformance test marks its cases on this bus: what it asks for that must be refused is deliberate.
    pub is_tested: bool,
    /// Silences left out so far, in nanoseconds.
    pub(super) silence: i64,
    pub(super) bus_name: &'a Arc<str>,
    pub(super) rule: u16,
    pub(super) place: u16,
    pub(super) ledger: &'a mut Ledger,
    pub(super) wakes: &'a mut BinaryHeap<Wake>,
}

impl<'a> Context<'a> {
    /// The rule had something to judge, and nothing was wrong.
    #[inline]
    pub fn pass(&mut self) {
        self.ledger.pass(self.rule);
    }

    /// The same, and for one case of the test plan.
    pub(crate) fn pass_case(&mut self, case: &'static str) {
        self.pass();
        self.ledger.judge_case(case, false);
    }

    /// Counts a failure for one case of the test plan; the finding itself is told by [`Context::fail`].
    pub(crate) fn fail_case(&mut self, case: &'static str) {
        self.ledger.judge_case(case, true);
    }

    /// An event shows something wrong: the finding is told once [`Alarm::say`] is called.
    pub fn fail<'b>(&'b mut self, event: &Event) -> Alarm<'b, 'a> {
        let at = occurrence(event.time, event.frames);
        let (node, is_presumed) = (event.node, event.presumed);
        Alarm::new(self, node, at, is_presumed)
    }

    /// A time that passed shows something wrong: `at` in the clock of [`Context::now`].
    pub(crate) fn fail_at<'b>(
        &'b mut self,
        at: i64,
        node: Option<NodeId>,
        frames: FrameRange,
    ) -> Alarm<'b, 'a> {
        let time = self.bus.stamp_of(at.saturating_add(self.silence));
        let is_presumed = match node {
            Some(NodeId::J1939(_)) => !self.bus.is_j1939(),
            _ => !self.bus.is_canopen(),
        };
        Alarm::new(self, node, occurrence(time, frames), is_presumed)
    }

    /// Why a rule had nothing to judge: said at the end where it had nothing on any bus.
    pub(super) fn unexercised(&mut self, why: String) {
        self.ledger.unexercised(self.rule, why);
    }

    /// An ongoing finding is over.
    pub fn close(&mut self, node: Option<NodeId>, about: About) {
        let key = Key { rule: self.rule, bus: self.bus.index(), node, about };
        let time = self.bus.stamp_of(self.now.saturating_add(self.silence));
        self.ledger.close_key(&key, occurrence(time, FrameRange::one(self.bus.last_frame())));
    }

    /// Asks to be woken when time has passed `time`, in the clock of [`Context::now`].
    /// Nobody is woken for what began before the first time was known: how long ago that is, nobody knows.
    pub(crate) fn wake_at(&mut self, time: i64, token: u64) {
        if self.has_time {
            self.wakes.push(Reverse((time, self.place, token)));
        }
    }

    /// The event's node.
    pub fn node(&self, event: &Event) -> Option<&'a Node> {
        self.bus.node(event.node?)
    }

    /// The NMT state of a node where it is sure and not only just commanded or changed: within 20 ms frames may
    /// still be queued.
    pub(crate) fn confirmed_state(&self, node: NodeId) -> Option<NmtState> {
        confirmed_state(self.bus, node)
    }
}

/// The NMT state of a node where it is sure and not only just commanded or changed.
pub(super) fn confirmed_state(bus: &Bus, node: NodeId) -> Option<NmtState> {
    let status = bus.node(node)?.nmt()?;
    let settled = bus.now().saturating_sub(status.since()) > SETTLING;
    (status.certainty == Certainty::Confirmed && settled).then_some(status.state)
}

/// Whether a device need not obey a rule where it is about this.
fn waives(waiver: &Waiver, rule: &str, about: &About) -> bool {
    let covers = |object| waiver.objects.iter().any(|range| range.covers(object, 0, 0));
    waiver.rule.get_ref() == rule
        && (waiver.objects.is_empty() || matches!(about, About::Object(object) if covers(*object)))
}

/// Frames that were queued when a state changed come within this time, in nanoseconds.
pub(super) const SETTLING: i64 = 20_000_000;

/// A finding that is about to be told.
#[must_use = "nothing is told before say"]
pub struct Alarm<'b, 'a> {
    context: &'b mut Context<'a>,
    node: Option<NodeId>,
    about: About,
    severity: Option<Severity>,
    measure: Option<f64>,
    word: Option<&'static str>,
    is_ongoing: bool,
    is_presumed: bool,
    at: Occurrence,
}

impl<'b, 'a> Alarm<'b, 'a> {
    fn new(context: &'b mut Context<'a>, node: Option<NodeId>, at: Occurrence, is_presumed: bool) -> Self {
        Self {
            context,
            node,
            about: About::Whole,
            severity: None,
            measure: None,
            word: None,
            is_ongoing: false,
            is_presumed,
            at,
        }
    }

    /// Of another node than the event's.
    pub fn node(mut self, node: Option<NodeId>) -> Self {
        self.node = node;
        self
    }

    /// What of the node.
    pub fn about(mut self, about: About) -> Self {
        self.about = about;
        self
    }

    /// Other than the rule's own.
    pub fn severity(mut self, severity: Severity) -> Self {
        self.severity = Some(severity);
        self
    }

    /// How far it is off, so that the worst can be told.
    pub(crate) fn measure(mut self, measure: f64) -> Self {
        self.measure = Some(measure);
        self
    }

    /// Other than the rule's own word, where a group says something else than the rule's others do.
    pub fn word(mut self, word: &'static str) -> Self {
        self.word = Some(word);
        self
    }

    /// Other frames than the event's.
    pub fn frames(mut self, frames: FrameRange) -> Self {
        self.at.frames = frames;
        self
    }

    /// Its protocol is presumed only, or is not: as it was when what shows it came.
    pub fn presumed(mut self, is_presumed: bool) -> Self {
        self.is_presumed = is_presumed;
        self
    }

    /// It is about the bus itself, whatever its protocol.
    pub(crate) fn certain(mut self) -> Self {
        self.is_presumed = false;
        self
    }

    /// It goes on until [`Context::close`].
    pub(crate) fn ongoing(mut self) -> Self {
        self.is_ongoing = true;
        self
    }

    /// Tells it. The text is made only where it is kept: of the first, and of each that is worse.
    pub fn say(self, text: impl FnOnce() -> String) {
        let Self { context, node, about, severity, measure, word, is_ongoing, is_presumed, at } = self;
        let (rule, bus) = (context.rule, context.bus);
        let known = node.and_then(|node| bus.node(node));
        if let (Some(node), Some(info)) = (known, context.ledger.rules.get(usize::from(rule)))
            && node.device().waivers.iter().any(|waiver| waives(waiver, &info.name, &about))
        {
            return context.ledger.waive(rule);
        }
        let claim = Claim {
            key: Key { rule, bus: bus.index(), node, about },
            severity,
            measure,
            word,
            is_ongoing,
            is_presumed,
            now: context.now,
            at,
        };
        let names = (context.bus_name, known.and_then(Node::name));
        if let Some(place) = context.ledger.fail(&claim, names, text) {
            let quiet = context.now.saturating_add(super::ledger::QUIET);
            context.wakes.push(Reverse((quiet, LEDGER, place as u64)));
        }
    }
}
