//! View of a rule on the bus, and its interface to report findings.

pub(super) mod meter;
pub(super) mod pdo_slot;
mod scene;
pub(super) mod traffic;

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::sync::Arc;

use self::meter::FrameMeter;
use self::pdo_slot::PdoSlot;
use self::scene::SceneView;
use self::traffic::PdoTraffic;
use super::ledger::{DefectClaim, FindingLedger, build_occurrence};
use crate::event::{Event, FrameRange, StateCertainty};
use crate::finding::{FindingSubject, GroupKey, Occurrence, Severity};
use crate::frame::{CanId, Timestamp};
use crate::profile::device::RuleWaiver;
use crate::session::{Bus, Node};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

/// A requested wake-up: time, index of the rule, token.
pub(super) type Wake = Reverse<(i64, u16, u64)>;

/// Index of the ledger for wake-ups.
pub(super) const LEDGER: u16 = u16::MAX;

/// View of a rule on the bus.
pub struct RuleContext<'a> {
    /// The bus in the state after the event.
    pub bus: &'a Bus,
    /// Monotonic time of the event in ns. Silences of the whole bus are subtracted, so that no deadline
    /// expires in one.
    pub now: i64,
    /// Whether the capture has timestamps.
    pub has_time: bool,
    /// Timestamp resolution in ns; 0 if unknown.
    pub granularity: i64,
    /// PDO statistics by identifier.
    pub traffic: &'a PdoTraffic,
    /// Frame statistics of the bus.
    pub meter: &'a FrameMeter,
    /// A conformance test marks its cases on this bus, so requests that must be refused are deliberate.
    pub is_tested: bool,
    /// Sum of silences subtracted from `now`, in ns.
    pub(super) silence: i64,
    /// First frame after the last silence; 0 for none.
    pub(super) resumed: u64,
    pub(super) bus_name: &'a Arc<str>,
    pub(super) rule: u16,
    pub(super) place: u16,
    pub(super) ledger: &'a mut FindingLedger,
    pub(super) wakes: &'a mut BinaryHeap<Wake>,
    /// See [`RuleContext::ask_again`].
    pub(super) has_news: &'a mut bool,
}

impl<'a> RuleContext<'a> {
    /// Counts a check without a defect.
    #[inline]
    pub fn count_pass(&mut self) {
        self.ledger.count_pass(self.rule);
    }

    /// Counts a check without a defect, also for one case of the test plan.
    pub(crate) fn pass_case(&mut self, case: &'static str) {
        self.count_pass();
        self.ledger.judge_case(case, false);
    }

    /// Counts a failure for one case of the test plan; [`RuleContext::start_finding`] reports the finding itself.
    pub(crate) fn fail_case(&mut self, case: &'static str) {
        self.ledger.judge_case(case, true);
    }

    /// Starts a finding shown by an event; [`FindingAlarm::report_finding`] reports it.
    pub fn start_finding<'b>(&'b mut self, event: &Event) -> FindingAlarm<'b, 'a> {
        let at = build_occurrence(event.time, event.frames);
        let (node, is_presumed) = (event.node, event.presumed);
        FindingAlarm::new(self, node, at, is_presumed)
    }

    /// Timestamp of a time in the clock of [`RuleContext::now`].
    pub(crate) fn timestamp_of(&self, time: i64) -> Option<Timestamp> {
        self.bus.stamp_of(time.saturating_add(self.silence))
    }

    /// Whether the whole bus was silent after the frame `from`: what follows it may not be its successor.
    pub(crate) fn is_across_hole(&self, from: u64) -> bool {
        from < self.resumed
    }

    /// Starts a finding at an expired deadline `at`, in the clock of [`RuleContext::now`].
    pub(crate) fn fail_at<'b>(
        &'b mut self,
        at: i64,
        node: Option<NodeId>,
        frames: FrameRange,
    ) -> FindingAlarm<'b, 'a> {
        let time = self.timestamp_of(at);
        self.fail_at_timestamp(time, node, frames)
    }

    /// Starts a finding at a timestamp of the capture, which silences since then do not move.
    pub(crate) fn fail_at_timestamp<'b>(
        &'b mut self,
        time: Option<Timestamp>,
        node: Option<NodeId>,
        frames: FrameRange,
    ) -> FindingAlarm<'b, 'a> {
        let is_presumed = !self.bus.protocols().is_settled(node);
        FindingAlarm::new(self, node, build_occurrence(time, frames), is_presumed)
    }

    /// Whether the device exempts itself from the rule for this subject.
    fn is_waived(&self, node: &Node, about: &FindingSubject) -> bool {
        let info = self.ledger.rules.get(usize::from(self.rule));
        info.is_some_and(|info| {
            node.device().waivers.iter().any(|waiver| waives_rule(waiver, &info.name, about))
        })
    }

    /// Frame before a gap in the traffic of the bus that may be a hole in the capture as well as the absence of the few
    /// nodes on the bus, if the rule checks a time.
    fn ambiguous_gap(&self, at: &Occurrence) -> Option<u64> {
        let is_timing = self.ledger.rules.get(usize::from(self.rule)).is_some_and(|rule| rule.is_timing);
        is_timing.then(|| self.bus.ambiguous_gap(at.time, at.frames))?
    }

    /// Records what was missing for a verdict of the rule; reported if there is none on any bus.
    pub(super) fn note_unexercised(&mut self, why: String) {
        self.ledger.note_unexercised(self.rule, why);
    }

    /// Ends a condition reported as ongoing.
    pub fn close_condition(&mut self, node: Option<NodeId>, about: FindingSubject) {
        let key = GroupKey { rule: self.rule, bus: self.bus.index(), node, about };
        let time = self.bus.stamp_of(self.now.saturating_add(self.silence));
        self.ledger.close_key(&key, build_occurrence(time, FrameRange::one(self.bus.last_frame())));
    }

    /// Requests a wake-up after `time`, in the clock of [`RuleContext::now`]. Ignored before the first timestamp,
    /// since the elapsed time is unknown.
    pub(crate) fn wake_at(&mut self, time: i64, token: u64) {
        if self.has_time {
            self.wakes.push(Reverse((time, self.place, token)));
        }
    }

    /// States that the answer of `Rule::frame_need` may have changed: for the present identifier while the rule handles a PDO,
    /// else for all identifiers.
    pub fn ask_again(&mut self) {
        *self.has_news = true;
    }

    /// Statistics of the PDOs with an identifier; `None` before the first one.
    pub fn pdos_of(&self, id: CanId) -> Option<&'a PdoSlot> {
        self.traffic.slot_of(self.bus.identifiers().find_slot(id)?)
    }

    /// Node of the event.
    pub fn event_node(&self, event: &Event) -> Option<&'a Node> {
        self.bus.node(event.node?)
    }

    /// NMT state of a node, if confirmed and not just changed: frames may still be queued for 20 ms.
    pub(crate) fn confirmed_state(&self, node: NodeId) -> Option<NmtState> {
        confirmed_state(self.bus, node)
    }
}

/// See [`RuleContext::confirmed_state`].
pub(super) fn confirmed_state(bus: &Bus, node: NodeId) -> Option<NmtState> {
    let status = bus.node(node)?.nmt()?;
    let settled = bus.now().saturating_sub(status.changed_at()) > SETTLING;
    (status.certainty == StateCertainty::Confirmed && settled).then_some(status.state)
}

/// Whether the waiver exempts the device from a rule for this subject.
fn waives_rule(waiver: &RuleWaiver, rule: &str, about: &FindingSubject) -> bool {
    let covers = |object| waiver.objects.iter().any(|range| range.covers(object, 0, 0));
    waiver.rule.get_ref() == rule
        && (waiver.objects.is_empty() || matches!(about, FindingSubject::Object(object) if covers(*object)))
}

/// Frames queued before a state change may arrive within this time after it, in ns.
pub(super) const SETTLING: i64 = 20_000_000;

/// Reason for a lower severity of a finding about a PDO whose mapping is the default of the profile.
pub(in crate::rules) const MAPPING_ASSUMED: &str = "mapping assumed: default of the profile";

/// A finding under construction.
#[must_use = "a finding is reported by `report` only"]
pub struct FindingAlarm<'b, 'a> {
    context: &'b mut RuleContext<'a>,
    node: Option<NodeId>,
    about: FindingSubject,
    severity: Option<Severity>,
    measure: Option<f64>,
    word: Option<&'static str>,
    is_ongoing: bool,
    is_presumed: bool,
    is_reported: bool,
    is_by_order: bool,
    reason: Option<Box<str>>,
    assumed: Option<&'static str>,
    at: Occurrence,
    since: Option<Timestamp>,
    requested: Option<Timestamp>,
}

impl<'b, 'a> FindingAlarm<'b, 'a> {
    fn new(
        context: &'b mut RuleContext<'a>,
        node: Option<NodeId>,
        at: Occurrence,
        is_presumed: bool,
    ) -> Self {
        Self {
            context,
            node,
            about: FindingSubject::Whole,
            severity: None,
            measure: None,
            word: None,
            is_ongoing: false,
            is_presumed,
            is_reported: false,
            is_by_order: false,
            reason: None,
            assumed: None,
            at,
            since: None,
            requested: None,
        }
    }

    /// Sets the node (default: the node of the event).
    pub fn at_node(mut self, node: Option<NodeId>) -> Self {
        self.node = node;
        self
    }

    /// Sets the subject within the node.
    pub fn with_subject(mut self, about: FindingSubject) -> Self {
        self.about = about;
        self
    }

    /// Overrides the severity of the rule.
    pub fn with_severity(mut self, severity: Severity) -> Self {
        self.severity = Some(severity);
        self
    }

    /// Sets the size of the deviation; the largest one is reported as the worst.
    pub(crate) fn with_measure(mut self, measure: f64) -> Self {
        self.measure = Some(measure);
        self
    }

    /// Overrides the event word of the rule.
    pub fn with_word(mut self, word: &'static str) -> Self {
        self.word = Some(word);
        self
    }

    /// Sets the frames (default: the frames of the event).
    pub fn with_frames(mut self, frames: FrameRange) -> Self {
        self.at.frames = frames;
        self
    }

    /// Sets whether the protocol was only presumed at the time of the defect.
    pub fn with_presumption(mut self, is_presumed: bool) -> Self {
        self.is_presumed = is_presumed;
        self
    }

    /// Lowers the severity by one step if the check depends on an assumed value; `None` if it does not.
    pub(crate) fn with_assumption(mut self, reason: Option<&'static str>) -> Self {
        self.assumed = reason;
        self
    }

    /// Marks a finding about the bus itself, independent of its protocol.
    pub(crate) fn mark_certain(mut self) -> Self {
        self.is_presumed = false;
        self
    }

    /// Marks a time-out that a device itself reports: no hole in the capture can be its cause.
    pub(crate) fn reported_by_device(mut self) -> Self {
        self.is_reported = true;
        self
    }

    /// Marks a finding of a rule about times that the order of frames alone shows.
    pub(crate) fn shown_by_order(mut self) -> Self {
        self.is_by_order = true;
        self
    }

    /// Sets the reason that findings printed as one have in common: an abort code, a closed gate.
    pub(crate) fn with_reason(mut self, reason: &str) -> Self {
        self.reason = Some(reason.into());
        self
    }

    /// Marks a condition that lasts until [`RuleContext::close_condition`].
    pub(crate) fn mark_ongoing(mut self) -> Self {
        self.is_ongoing = true;
        self
    }

    /// Marks a condition that started before the event.
    pub(crate) fn started_at(mut self, time: Option<Timestamp>) -> Self {
        self.since = time;
        self.mark_ongoing()
    }

    /// Sets the time of the request that has no response: a node that was lost after it is not the cause.
    pub(crate) fn requested_at_timestamp(mut self, time: Option<Timestamp>) -> Self {
        self.requested = time;
        self
    }

    /// As [`FindingAlarm::requested_at_timestamp`], in the clock of [`RuleContext::now`].
    pub(crate) fn requested_at(self, time: i64) -> Self {
        let time = self.context.timestamp_of(time);
        self.requested_at_timestamp(time)
    }

    /// Reports the finding. `text` is called only for the first occurrence and for each worse one.
    pub fn report_finding(self, text: impl FnOnce() -> String) {
        let Self {
            context,
            node,
            about,
            severity,
            measure,
            word,
            is_ongoing,
            is_presumed,
            is_reported,
            is_by_order,
            reason,
            assumed,
            at,
            since,
            requested,
        } = self;
        let (rule, bus) = (context.rule, context.bus);
        let gap = if is_reported { None } else { context.ambiguous_gap(&at) };
        let text = || match gap {
            Some(gap) => {
                format!("{}; or a hole in the capture: no frame of any node after {{{gap}}}", text())
            }
            None => text(),
        };
        let known = node.and_then(|node| bus.node(node));
        if known.is_some_and(|node| context.is_waived(node, &about)) {
            return context.ledger.count_waiver(rule);
        }
        let mut claim = DefectClaim {
            key: GroupKey { rule, bus: bus.index(), node, about },
            severity,
            measure,
            word,
            is_ongoing,
            is_presumed,
            is_by_order,
            no_consumer: None,
            reason,
            assumed,
            now: context.now,
            at,
            since: since.or(at.time),
            requested,
        };
        let is_new = !context.ledger.has_group(&claim.key);
        let (traffic, meter, now) = (context.traffic, context.meter, context.now);
        let view = SceneView { bus, traffic, meter, now };
        if is_new {
            claim.no_consumer = node.and_then(|node| view.no_consumer(node)).map(Arc::new);
        }
        let waits = context.ledger.record_defect(&claim, (context.bus_name, known), text);
        if is_new {
            context.ledger.set_scene(&claim.key, || view.build_scene(node, &claim.key.about));
        }
        if let Some(place) = waits {
            let quiet = context.now.saturating_add(super::ledger::QUIET);
            context.wakes.push(Reverse((quiet, LEDGER, place as u64)));
        }
    }
}
