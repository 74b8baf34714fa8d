//! Findings of a capture during the check: groups, verdict counts and causes.

mod absent_nodes;
pub(super) mod causes;
mod conclusions;
mod explained;
mod fact_row;
mod facts;
mod judged;
mod manual;
mod recording;
mod reported_losses;
mod taken;

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::Arc;

use foldhash::fast::FixedState;

use self::causes::{CauseEffect, CauseExplanation};
pub(super) use self::conclusions::{add_conclusions, lower_power_cycles};
use self::facts::LedgerFacts;
use self::reported_losses::ReportedLosses;
use super::conformance::{CaseStanding, ConformanceRun};
use super::policy::RulePolicy;
use crate::event::{Event, FindingNews, FrameRange, Kind};
use crate::finding::{
    CheckTally, FactCause, FindingCause, FindingGroup, FindingScene, FindingSubject, GROUP_LIMIT, GroupKey,
    KEPT_OCCURRENCES, MergedFindings, Occurrence, RuleInfo, Severity,
};
use crate::frame::{BusIndex, Timestamp};
use crate::observation::NodeMoments;
use crate::session::{Bus, Node};
use crate::wire::NodeId;
use crate::wire::canopen::test_marker::TestMarker;

/// A finding is closed after this time without an occurrence, in ns.
pub(super) const QUIET: i64 = 5_000_000_000;

/// Maximum number of groups with a scene.
const SCENE_LIMIT: usize = 500;

/// A defect reported by a rule.
pub(super) struct DefectClaim {
    pub(super) key: GroupKey,
    pub(super) severity: Option<Severity>,
    pub(super) measure: Option<f64>,
    /// Overrides the event word of the rule.
    pub(super) word: Option<&'static str>,
    pub(super) is_ongoing: bool,
    pub(super) is_presumed: bool,
    /// The order of frames alone shows the defect.
    pub(super) is_by_order: bool,
    /// Commands to the node on an identifier without a consumer.
    pub(super) no_consumer: Option<Arc<FactCause>>,
    /// Findings with different reasons are not merged: an abort code, a closed gate.
    pub(super) reason: Option<Box<str>>,
    /// Factory setting that the check assumed, as reason for a lower severity.
    pub(super) assumed: Option<&'static str>,
    pub(super) now: i64,
    pub(super) at: Occurrence,
    /// Start of a condition.
    pub(super) since: Option<Timestamp>,
    /// Time of the request that has no response.
    pub(super) requested: Option<Timestamp>,
}

/// The bus of a claim, and the node if the bus knows it.
type Subject<'a> = (&'a Arc<str>, Option<&'a Node>);

/// Internal state of a group, in addition to the data for output.
#[derive(Debug, Clone, Default)]
struct GroupState {
    /// Monotonic time of the last occurrence, in ns.
    last: i64,
    /// The condition lasts until the rule closes it.
    is_ongoing: bool,
    /// Start of the condition; None if it is over.
    since: Option<Timestamp>,
    /// Start of the condition when the group was opened first: a silence starts at the last frame, before its
    /// deadline.
    first_start: Option<Timestamp>,
    /// Start of the condition when the group was opened last.
    last_start: Option<Timestamp>,
    /// Time of the first request that has no response.
    requested: Option<Timestamp>,
    /// Occurrences since the group was last opened.
    since_open: u64,
    /// Largest measure so far.
    worst: f64,
    /// Current text, if it differs from the text of the group.
    stated: Option<String>,
    /// Overrides the event word of the rule.
    word: Option<&'static str>,
    /// The order of frames alone shows the defect, although the rule checks times.
    is_by_order: bool,
}

/// A group opened or closed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LedgerNews {
    /// Index of the group.
    group: usize,
    pub(super) what: GroupChange,
    /// Time and frames of the change.
    pub(super) at: Occurrence,
}

/// Change of a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GroupChange {
    Opened,
    Closed,
    /// Closed at the end of the capture.
    Ended,
}

/// Rule, bus, node, object index and reason of findings that are printed as one.
type MergeKey = (u16, BusIndex, Option<NodeId>, Option<u16>, Option<Box<str>>);

/// A rule on a bus, at one node or at any node.
type RulePlace = (u16, BusIndex, Option<NodeId>);

/// Rules related to a device rule, by name.
#[derive(Debug, Clone, Default)]
pub(in crate::rules) struct RuleRelations {
    /// Rules whose findings it absorbs.
    pub(in crate::rules) takes_in: Vec<Arc<str>>,
    /// Rules whose findings are the cause of its findings.
    pub(in crate::rules) follows: Vec<Arc<str>>,
}

/// `takes_in` relations of device rules.
#[derive(Debug, Clone, Default)]
struct DeviceRuleCauses {
    /// Rules that absorb findings of the named rule.
    by_effect: HashMap<Arc<str>, Vec<u16>, FixedState>,
    /// Relations of a rule.
    by_rule: HashMap<u16, RuleRelations, FixedState>,
}

/// Groups, verdict counts and pending news of one capture.
#[derive(Debug, Clone)]
pub(super) struct FindingLedger {
    policy: Arc<RulePolicy>,
    pub(super) rules: Vec<RuleInfo>,
    tallies: Vec<CheckTally>,
    cases: BTreeMap<Arc<str>, CheckTally>,
    groups: Vec<FindingGroup>,
    courses: Vec<GroupState>,
    by_key: HashMap<GroupKey, usize, FixedState>,
    /// First group of those that are printed as one.
    merged: HashMap<MergeKey, u64, FixedState>,
    /// Latest group of a rule on a bus (and at a node), with the monotonic time of its last occurrence.
    latest: HashMap<RulePlace, (usize, i64), FixedState>,
    taken: DeviceRuleCauses,
    /// Monotonic time of the last event of a kind on a bus.
    kinds: HashMap<(Kind, BusIndex), i64, FixedState>,
    /// Facts that may explain findings.
    facts: LedgerFacts,
    ungrouped: u64,
    /// Current conformance test run.
    run: ConformanceRun,
    pub(super) news: Vec<LedgerNews>,
    /// What was missing for verdicts of rules.
    unexercised: Vec<(u16, String)>,
    /// Buses that proved not to be CANopen.
    doubted: Vec<BusIndex>,
    reported_losses: ReportedLosses,
    /// Commands and restarts.
    moments: NodeMoments,
}

impl FindingLedger {
    pub(super) fn new(policy: &Arc<RulePolicy>) -> Self {
        let rules = policy.rules.clone();
        Self {
            tallies: vec![CheckTally::default(); rules.len()],
            rules,
            policy: Arc::clone(policy),
            cases: BTreeMap::new(),
            groups: Vec::new(),
            courses: Vec::new(),
            by_key: HashMap::default(),
            merged: HashMap::default(),
            latest: HashMap::default(),
            taken: DeviceRuleCauses::default(),
            kinds: HashMap::default(),
            facts: LedgerFacts::default(),
            ungrouped: 0,
            run: ConformanceRun::default(),
            news: Vec::new(),
            unexercised: Vec::new(),
            doubted: Vec::new(),
            reported_losses: ReportedLosses::default(),
            moments: NodeMoments::default(),
        }
    }

    #[inline]
    pub(super) fn count_pass(&mut self, rule: u16) {
        if let Some(tally) = self.tallies.get_mut(usize::from(rule)) {
            tally.passed += 1;
        }
    }

    /// Counts so many checks of a rule without a defect.
    pub(super) fn pass_many(&mut self, rule: u16, count: u32) {
        if let Some(tally) = self.tallies.get_mut(usize::from(rule)) {
            tally.passed = tally.passed.saturating_add(u64::from(count));
        }
    }

    /// Records what was missing for a verdict of a rule; the first record counts.
    pub(super) fn note_unexercised(&mut self, rule: u16, why: String) {
        if !self.unexercised.iter().any(|(known, _)| *known == rule) {
            self.unexercised.push((rule, why));
        }
    }

    pub(super) fn judge_case(&mut self, case: &'static str, failed: bool) {
        let tally = self.cases.entry(case.into()).or_default();
        if failed { tally.failed += 1 } else { tally.passed += 1 }
    }

    /// Handles the start or end marker of a conformance test case.
    pub(super) fn on_marker(&mut self, marker: TestMarker, frame: u64) {
        self.run.on_marker(marker, frame, &self.rules, &self.tallies);
    }

    pub(super) fn count_waiver(&mut self, rule: u16) {
        if let Some(tally) = self.tallies.get_mut(usize::from(rule)) {
            tally.waived += 1;
        }
    }

    /// Records an event that may explain findings.
    pub(super) fn note_event(&mut self, kind: Kind, bus: BusIndex, now: i64) {
        self.kinds.insert((kind, bus), now);
    }

    /// Records a command, a write or an error frame that may explain findings.
    pub(super) fn observe_event(&mut self, event: &Event, bus: &Bus, now: i64) {
        self.reported_losses.note_event(event);
        // Silences of the bus do not stop the clock of its messages.
        self.moments.observe_event(event, event.time.map_or(bus.now(), |time| bus.monotonic(time)));
        self.facts.observe_event(event, bus, now);
    }

    /// Records a defect. Returns the index of its group if the caller must wait for [`QUIET`].
    pub(super) fn record_defect(
        &mut self,
        claim: &DefectClaim,
        subject: Subject<'_>,
        text: impl FnOnce() -> String,
    ) -> Option<usize> {
        let rule = self.rules.get(usize::from(claim.key.rule));
        let standing = rule.map_or(CaseStanding::Judged, |rule| self.run.standing_of(&rule.name));
        if standing == CaseStanding::Fact {
            return None;
        }
        if let Some(tally) = self.tallies.get_mut(usize::from(claim.key.rule)) {
            tally.failed += 1;
        }
        let known = self.by_key.get(&claim.key).copied();
        let place = match known {
            Some(place) => place,
            None if self.groups.len() < GROUP_LIMIT => self.add_group(claim, subject),
            None => {
                self.ungrouped += 1;
                return None;
            }
        };
        let node = claim.key.node;
        let seen = (place, claim.now);
        self.latest.insert((claim.key.rule, claim.key.bus, node), seen);
        self.latest.insert((claim.key.rule, claim.key.bus, None), seen);
        let opens = self.groups.get(place).is_some_and(|group| !group.is_open);
        let severity = self.effective_severity(claim, opens);
        let rises = self.groups.get(place).is_some_and(|group| severity.0 > group.severity);
        self.count_occurrence(place, claim, opens || rises, text);
        if opens {
            self.take_in(claim);
        }
        self.open_group(place, claim, severity, opens, rises)
    }

    /// Whether a group with this key exists.
    pub(super) fn has_group(&self, key: &GroupKey) -> bool {
        self.by_key.contains_key(key)
    }

    /// Adds the state of node and bus to a new group.
    pub(super) fn set_scene(&mut self, key: &GroupKey, scene: impl FnOnce() -> FindingScene) {
        let place = self.by_key.get(key).copied().filter(|place| *place < SCENE_LIMIT);
        if let Some(group) = place.and_then(|place| self.groups.get_mut(place)) {
            group.scene = Some(Box::new(scene()));
        }
    }

    /// Earlier group of the same rule that is printed in place of a new one.
    fn find_representative(&mut self, claim: &DefectClaim, id: u64) -> Option<u64> {
        let merge =
            self.rules.get(usize::from(claim.key.rule)).map_or(MergedFindings::Subject, |rule| rule.merge);
        let subject = match (merge, &claim.key.about) {
            (MergedFindings::Index, FindingSubject::Object(object)) => Some(object.index),
            (MergedFindings::Node, _) => None,
            _ => return None,
        };
        let key = (claim.key.rule, claim.key.bus, claim.key.node, subject, claim.reason.clone());
        let first = *self.merged.entry(key).or_insert(id);
        (first != id).then_some(first)
    }

    fn add_group(&mut self, claim: &DefectClaim, (bus, node): Subject<'_>) -> usize {
        let place = self.groups.len();
        let rule = self.rules.get(usize::from(claim.key.rule));
        let mut group = FindingGroup {
            id: place as u64 + 1,
            key: claim.key.clone(),
            rule: rule.map_or_else(|| "".into(), |rule| Arc::clone(&rule.name)),
            bus: Arc::clone(bus),
            node_name: node.and_then(Node::name).map(Arc::from),
            object_name: object_name(&claim.key.about, node),
            next_step: rule.and_then(RuleInfo::first_step),
            manual: rule.and_then(|rule| manual::cite_manual(rule, &claim.key.about, node)),
            severity: Severity::Note,
            text: String::new(),
            worst: None,
            count: 0,
            lasted: None,
            lasts_to_end: false,
            first: Vec::new(),
            last: VecDeque::new(),
            cause: None,
            is_absorbed: false,
            member_of: self.find_representative(claim, place as u64 + 1),
            scene: None,
            downgraded: None,
            suppressed: None,
            is_open: false,
            nodes: claim.key.node.into_iter().collect(),
        };
        group.suppressed = self.policy.suppression_reason(&group);
        self.groups.push(group);
        self.courses.push(GroupState {
            worst: f64::NEG_INFINITY,
            word: claim.word,
            is_by_order: claim.is_by_order,
            first_start: claim.since,
            last_start: claim.since,
            requested: claim.requested,
            ..GroupState::default()
        });
        self.by_key.insert(claim.key.clone(), place);
        place
    }

    /// Counts an occurrence.
    fn count_occurrence(
        &mut self,
        place: usize,
        claim: &DefectClaim,
        is_stated: bool,
        text: impl FnOnce() -> String,
    ) {
        let (Some(group), Some(course)) = (self.groups.get_mut(place), self.courses.get_mut(place)) else {
            return;
        };
        group.count += 1;
        course.last = claim.now;
        course.since_open += 1;
        let worse = claim.measure.filter(|measure| *measure > course.worst);
        if is_stated || worse.is_some() {
            // Saves memory: most of thousands of groups occur once.
            let mut stated = text();
            stated.shrink_to_fit();
            if group.count == 1 {
                group.text = stated;
            } else {
                if let Some(measure) = worse {
                    group.worst = Some((measure, stated.clone(), claim.at));
                }
                course.stated = Some(stated);
            }
        }
        course.worst = worse.unwrap_or(course.worst);
        if group.first.len() < KEPT_OCCURRENCES {
            group.first.reserve_exact(1);
            group.first.push(claim.at);
        } else {
            if group.last.is_empty() {
                group.last.reserve_exact(KEPT_OCCURRENCES);
            } else if group.last.len() == KEPT_OCCURRENCES {
                group.last.pop_front();
            }
            group.last.push_back(claim.at);
        }
    }

    /// Opens a closed group, or emits an open one again if its severity rises. Returns the index if the
    /// caller must wait for [`QUIET`].
    fn open_group(
        &mut self,
        place: usize,
        claim: &DefectClaim,
        (severity, reason, explained): (Severity, Option<String>, Option<CauseExplanation>),
        opens: bool,
        rises: bool,
    ) -> Option<usize> {
        let (group, course) = (self.groups.get_mut(place)?, self.courses.get_mut(place)?);
        if let Some(CauseExplanation { effect, by }) = explained {
            group.is_absorbed |= effect == CauseEffect::Same;
            if group.cause.is_none() && by != FindingCause::Group(group.id) {
                group.cause = Some(by);
            }
        }
        if rises || group.count == 1 {
            if let Some(stated) = course.stated.take() {
                group.text = stated;
            }
            group.severity = severity;
            group.downgraded = reason;
        }
        let was_ongoing = std::mem::replace(&mut course.is_ongoing, claim.is_ongoing);
        if claim.is_ongoing && course.since.is_none() {
            course.since = claim.since;
        }
        if opens || rises {
            self.news.push(LedgerNews { group: place, what: GroupChange::Opened, at: claim.at });
        }
        if !opens {
            // A wait is pending already, unless the condition was ongoing.
            return (was_ongoing && !claim.is_ongoing).then_some(place);
        }
        group.is_open = true;
        course.last_start = claim.since;
        course.since_open = 1;
        (!claim.is_ongoing).then_some(place)
    }

    /// Closes a group after [`QUIET`]; returns the time of the next check if it is too early.
    pub(super) fn close_if_quiet(&mut self, place: usize, now: i64, at: Occurrence) -> Option<i64> {
        let course = self.courses.get(place)?;
        let over = course.last.saturating_add(QUIET);
        if course.is_ongoing {
            return None;
        }
        if over > now {
            return Some(over);
        }
        self.close_group(place, GroupChange::Closed, at);
        None
    }

    /// Closes a group whose condition is over.
    pub(super) fn close_key(&mut self, key: &GroupKey, at: Occurrence) {
        if let Some(place) = self.by_key.get(key).copied() {
            self.close_group(place, GroupChange::Closed, at);
        }
    }

    fn close_group(&mut self, place: usize, what: GroupChange, at: Occurrence) {
        if let (Some(group), Some(course)) = (self.groups.get_mut(place), self.courses.get_mut(place))
            && std::mem::replace(&mut group.is_open, false)
        {
            if let (Some(since), Some(end)) = (course.since.take(), at.time) {
                group.lasted = Some(group.lasted.unwrap_or(0).saturating_add(end.since(since)));
                group.lasts_to_end = what == GroupChange::Ended;
            }
            self.news.push(LedgerNews { group: place, what, at });
        }
    }

    /// Closes all open groups of a bus at the end of the capture.
    pub(super) fn close_all(&mut self, bus: &Bus) {
        if bus.protocols().is_canopen_rejected() {
            self.doubted.push(bus.index());
        }
        let at = build_occurrence(bus.stamp_of(bus.now()), FrameRange::one(bus.last_frame()));
        for place in 0..self.groups.len() {
            if self.groups.get(place).is_some_and(|group| group.key.bus == bus.index()) {
                self.close_group(place, GroupChange::Ended, at);
            }
        }
    }

    /// Whether the order of frames alone shows the finding.
    pub(super) fn is_by_order(&self, news: &LedgerNews) -> bool {
        self.courses.get(news.group).is_some_and(|course| course.is_by_order)
    }

    /// Content of a finding event with its group; None if the group is suppressed or absorbed.
    pub(super) fn finding_news(&self, news: LedgerNews) -> Option<(&FindingGroup, FindingNews)> {
        let (group, course) = (self.groups.get(news.group)?, self.courses.get(news.group)?);
        if !group.is_reported() {
            return None;
        }
        let rule = self.rules.get(usize::from(group.key.rule))?;
        let text = match (&group.worst, news.what) {
            (Some((_, text, _)), GroupChange::Closed | GroupChange::Ended) => text.clone(),
            _ => course.stated.as_ref().unwrap_or(&group.text).clone(),
        };
        let (count, is_at_end) = (course.since_open, news.what == GroupChange::Ended);
        let word = course.word.unwrap_or(rule.word);
        let news = FindingNews { word, text, count, is_at_end, ..group.opening_news(rule) };
        Some((group, news))
    }
}

/// Name of the object that a finding is about.
fn object_name(about: &FindingSubject, node: Option<&Node>) -> Option<Arc<str>> {
    let FindingSubject::Object(object) = about else { return None };
    node?.meaning(*object).map(|meaning| meaning.name.into())
}

/// Occurrence with its time and frames.
pub(super) fn build_occurrence(time: Option<Timestamp>, frames: FrameRange) -> Occurrence {
    Occurrence { time, frames }
}
