//! Where findings are kept while a capture is judged: groups, tallies, what explains what.

pub(super) mod causes;
mod explained;
mod judged;
mod taken;

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::sync::Arc;

use foldhash::fast::FixedState;

use self::causes::{Effect, Explained};
use super::conformance::{Run, Standing};
use super::policy::Policy;
use crate::event::{FindingNews, FrameRange};
use crate::finding::{
    Cause, GROUP_LIMIT, Group, KEPT_OCCURRENCES, Key, Occurrence, RuleInfo, Severity, Tally,
};
use crate::frame::{BusIndex, Timestamp};
use crate::session::Bus;
use crate::wire::NodeId;
use crate::wire::canopen::test_marker::TestMarker;

/// A finding that does not come again for so long is closed, in nanoseconds.
pub(super) const QUIET: i64 = 5_000_000_000;

/// What a rule says of something that is wrong.
pub(super) struct Claim {
    pub(super) key: Key,
    pub(super) severity: Option<Severity>,
    pub(super) measure: Option<f64>,
    /// Other than the rule's own.
    pub(super) word: Option<&'static str>,
    pub(super) is_ongoing: bool,
    pub(super) is_presumed: bool,
    pub(super) now: i64,
    pub(super) at: Occurrence,
}

/// What is known of a group beside what output needs.
#[derive(Debug, Clone, Default)]
struct Course {
    /// Time of its last occurrence.
    last: i64,
    /// It goes on until its rule closes it.
    is_ongoing: bool,
    /// Occurrences since it opened.
    since_open: u64,
    /// Measure of the worst.
    worst: f64,
    /// What is said of it now, where that is not the group's text.
    said: Option<String>,
    /// Its word in the lines of events, other than the rule's own.
    word: Option<&'static str>,
}

/// A group opened or closed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct News {
    /// Place of the group.
    group: usize,
    pub(super) what: What,
    /// When, and which frames show it.
    pub(super) at: Occurrence,
}

/// What a group did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    Opened,
    Closed,
    /// Closed because nothing comes any more.
    Ended,
}

/// A rule at a node of a bus, or anywhere on it.
type Place = (u16, BusIndex, Option<NodeId>);

/// Which findings rules of devices take in.
#[derive(Debug, Default)]
struct Taken {
    /// By the name of a rule, those that take it in.
    by_effect: HashMap<Arc<str>, Vec<u16>, FixedState>,
    /// By a rule, the names of those it takes in.
    by_rule: HashMap<u16, Vec<Arc<str>>, FixedState>,
}

/// Groups, tallies, news.
#[derive(Debug)]
pub(super) struct Ledger {
    policy: Arc<Policy>,
    pub(super) rules: Vec<RuleInfo>,
    tallies: Vec<Tally>,
    cases: BTreeMap<Arc<str>, Tally>,
    groups: Vec<Group>,
    courses: Vec<Course>,
    by_key: HashMap<Key, usize, FixedState>,
    /// The last group of a rule on a bus (and at a node), and when it was seen last.
    latest: HashMap<Place, (usize, i64), FixedState>,
    /// Which findings rules of devices take in.
    taken: Taken,
    /// When a kind of event was seen last on a bus.
    kinds: HashMap<(&'static str, BusIndex), i64, FixedState>,
    ungrouped: u64,
    /// The conformance test that is being run.
    run: Run,
    pub(super) news: Vec<News>,
    /// Why rules had nothing to judge.
    unexercised: Vec<(u16, String)>,
    /// Buses that turned out not to be CANopen.
    doubted: Vec<BusIndex>,
}

impl Ledger {
    pub(super) fn new(policy: &Arc<Policy>) -> Self {
        let rules = policy.rules.clone();
        Self {
            tallies: vec![Tally::default(); rules.len()],
            rules,
            policy: Arc::clone(policy),
            cases: BTreeMap::new(),
            groups: Vec::new(),
            courses: Vec::new(),
            by_key: HashMap::default(),
            latest: HashMap::default(),
            taken: Taken::default(),
            kinds: HashMap::default(),
            ungrouped: 0,
            run: Run::default(),
            news: Vec::new(),
            unexercised: Vec::new(),
            doubted: Vec::new(),
        }
    }

    #[inline]
    pub(super) fn pass(&mut self, rule: u16) {
        if let Some(tally) = self.tallies.get_mut(usize::from(rule)) {
            tally.passed += 1;
        }
    }

    /// Takes note of why a rule had nothing to judge; said of the first bus that says so.
    pub(super) fn unexercised(&mut self, rule: u16, why: String) {
        if !self.unexercised.iter().any(|(known, _)| *known == rule) {
            self.unexercised.push((rule, why));
        }
    }

    pub(super) fn judge_case(&mut self, case: &'static str, failed: bool) {
        let tally = self.cases.entry(case.into()).or_default();
        if failed { tally.failed += 1 } else { tally.passed += 1 }
    }

    /// The test tool begins or ends a case.
    pub(super) fn mark(&mut self, marker: TestMarker, frame: u64) {
        self.run.mark(marker, frame, &self.rules, &self.tallies);
    }

    pub(super) fn waive(&mut self, rule: u16) {
        if let Some(tally) = self.tallies.get_mut(usize::from(rule)) {
            tally.waived += 1;
        }
    }

    /// Notes that a kind of event that may explain findings was seen.
    pub(super) fn saw(&mut self, kind: &'static str, bus: BusIndex, now: i64) {
        self.kinds.insert((kind, bus), now);
    }

    /// Takes note of something wrong; says whether its group is one that has to be watched for quiet.
    pub(super) fn fail(
        &mut self,
        claim: &Claim,
        names: (&Arc<str>, Option<&str>),
        text: impl FnOnce() -> String,
    ) -> Option<usize> {
        let rule = self.rules.get(usize::from(claim.key.rule));
        let standing = rule.map_or(Standing::Judged, |rule| self.run.standing(&rule.name));
        if standing == Standing::Fact {
            return None;
        }
        if let Some(tally) = self.tallies.get_mut(usize::from(claim.key.rule)) {
            tally.failed += 1;
        }
        let known = self.by_key.get(&claim.key).copied();
        let place = match known {
            Some(place) => place,
            None if self.groups.len() < GROUP_LIMIT => self.add_group(claim, names),
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
        let severity = self.severity(claim, opens);
        let rises = self.groups.get(place).is_some_and(|group| severity.0 > group.severity);
        self.note(place, claim, opens || rises, text);
        if opens {
            self.take_in(claim);
        }
        self.open(place, claim, severity, opens, rises)
    }

    fn add_group(&mut self, claim: &Claim, (bus, node_name): (&Arc<str>, Option<&str>)) -> usize {
        let place = self.groups.len();
        let rule = self.rules.get(usize::from(claim.key.rule));
        let mut group = Group {
            id: place as u64 + 1,
            key: claim.key.clone(),
            rule: rule.map_or_else(|| "".into(), |rule| Arc::clone(&rule.name)),
            bus: Arc::clone(bus),
            node_name: node_name.map(Arc::from),
            severity: Severity::Note,
            text: String::new(),
            worst: None,
            count: 0,
            first: Vec::new(),
            last: VecDeque::new(),
            cause: None,
            is_absorbed: false,
            downgraded: None,
            suppressed: None,
            is_open: false,
        };
        group.suppressed = self.policy.suppression(&group);
        self.groups.push(group);
        self.courses.push(Course { worst: f64::NEG_INFINITY, word: claim.word, ..Course::default() });
        self.by_key.insert(claim.key.clone(), place);
        place
    }

    /// Counts an occurrence.
    fn note(&mut self, place: usize, claim: &Claim, is_said: bool, text: impl FnOnce() -> String) {
        let (Some(group), Some(course)) = (self.groups.get_mut(place), self.courses.get_mut(place)) else {
            return;
        };
        group.count += 1;
        course.last = claim.now;
        course.since_open += 1;
        let worse = claim.measure.filter(|measure| *measure > course.worst);
        if is_said || worse.is_some() {
            // Of thousands of groups most are seen once: nothing is kept in reserve, or twice.
            let mut said = text();
            said.shrink_to_fit();
            if group.count == 1 {
                group.text = said;
            } else {
                if let Some(measure) = worse {
                    group.worst = Some((measure, said.clone(), claim.at));
                }
                course.said = Some(said);
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

    /// Opens a group that is not open, or tells it again where it got worse; gives it if its quiet has to be
    /// waited for.
    fn open(
        &mut self,
        place: usize,
        claim: &Claim,
        (severity, reason, explained): (Severity, Option<String>, Option<Explained>),
        opens: bool,
        rises: bool,
    ) -> Option<usize> {
        let (group, course) = (self.groups.get_mut(place)?, self.courses.get_mut(place)?);
        if let Some(Explained { effect, by }) = explained {
            group.is_absorbed |= effect == Effect::Same;
            if group.cause.is_none() && by != Cause::Group(group.id) {
                group.cause = Some(by);
            }
        }
        if rises || group.count == 1 {
            if let Some(said) = course.said.take() {
                group.text = said;
            }
            group.severity = severity;
            group.downgraded = reason;
        }
        let was_ongoing = std::mem::replace(&mut course.is_ongoing, claim.is_ongoing);
        if opens || rises {
            self.news.push(News { group: place, what: What::Opened, at: claim.at });
        }
        if !opens {
            // Nobody waits for the quiet of what went on.
            return (was_ongoing && !claim.is_ongoing).then_some(place);
        }
        group.is_open = true;
        course.since_open = 1;
        (!claim.is_ongoing).then_some(place)
    }

    /// A group's time of quiet may be over: when to look again, if it is not.
    pub(super) fn quiet(&mut self, place: usize, now: i64, at: Occurrence) -> Option<i64> {
        let course = self.courses.get(place)?;
        let over = course.last.saturating_add(QUIET);
        if course.is_ongoing {
            return None;
        }
        if over > now {
            return Some(over);
        }
        self.close(place, What::Closed, at);
        None
    }

    /// Closes a group that its rule says is over.
    pub(super) fn close_key(&mut self, key: &Key, at: Occurrence) {
        if let Some(place) = self.by_key.get(key).copied() {
            self.close(place, What::Closed, at);
        }
    }

    fn close(&mut self, place: usize, what: What, at: Occurrence) {
        if let Some(group) = self.groups.get_mut(place)
            && std::mem::replace(&mut group.is_open, false)
        {
            self.news.push(News { group: place, what, at });
        }
    }

    /// Closes all that is open.
    pub(super) fn close_all(&mut self, bus: &Bus) {
        if bus.doubt().is_some() {
            self.doubted.push(bus.index());
        }
        let at = occurrence(bus.stamp_of(bus.now()), FrameRange::one(bus.last_frame()));
        for place in 0..self.groups.len() {
            if self.groups.get(place).is_some_and(|group| group.key.bus == bus.index()) {
                self.close(place, What::Ended, at);
            }
        }
    }

    /// What a sink writes of news: which group it is, and what it says. Nothing of those that need not be told.
    pub(super) fn tell(&self, news: News) -> Option<(&Group, FindingNews)> {
        let (group, course) = (self.groups.get(news.group)?, self.courses.get(news.group)?);
        if !group.counts() {
            return None;
        }
        let rule = self.rules.get(usize::from(group.key.rule))?;
        let text = match (&group.worst, news.what) {
            (Some((_, text, _)), What::Closed | What::Ended) => text.clone(),
            _ => course.said.as_ref().unwrap_or(&group.text).clone(),
        };
        let (count, is_at_end) = (course.since_open, news.what == What::Ended);
        let word = course.word.unwrap_or(rule.word);
        let news = FindingNews { word, text, count, is_at_end, ..group.news(rule) };
        Some((group, news))
    }
}

/// An occurrence of a deadline.
pub(super) fn occurrence(time: Option<Timestamp>, frames: FrameRange) -> Occurrence {
    Occurrence { time, frames }
}
