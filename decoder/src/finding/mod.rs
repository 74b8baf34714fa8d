//! Findings: defects reported by rules, and counts of all checks.
//!
//! Occurrences with the same rule, bus, node and subject form one [`FindingGroup`]. This key is also the fingerprint
//! in baselines and SARIF.

pub(crate) mod documentation;
pub mod phrase;
mod scene;

use std::borrow::Cow;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::sync::Arc;

pub use self::scene::{Advice, AdviceSource, CommandStream, FindingScene, SceneLifeSign};
pub use crate::profile::device::Severity;

use crate::event::{FindingNews, FrameRange};
use crate::frame::{BusIndex, CanId, Timestamp};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::test_marker::TestResult;

/// Number of first occurrences stored per group, and of last ones.
pub const KEPT_OCCURRENCES: usize = 5;

/// Maximum length of a chain of causes; groups can be causes of each other.
pub const CAUSES: usize = 8;

/// Maximum number of groups per capture; further findings are only counted.
pub const GROUP_LIMIT: usize = 3_000;

/// Origin of a rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum RuleOrigin {
    /// Rule of a standard, for every device.
    General,
    /// Rule of a device profile.
    Device,
    /// Rule of the user, from the bus file.
    Expectation,
    /// Failure of a part of the machine, concluded from several messages.
    Conclusion,
}

impl RuleOrigin {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::General => "general",
            Self::Device => "device",
            Self::Expectation => "expectation",
            Self::Conclusion => "conclusion",
        }
    }
}

/// Findings of a rule at one node that are printed as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum MergedFindings {
    /// Each subject is its own finding.
    Subject,
    /// Subindices of one object index.
    #[default]
    Index,
    /// All subjects of the node.
    Node,
}

/// Description of a rule.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RuleInfo {
    /// Rule name, such as `sdo-no-response` or `rexroth-sydfec:eeprom-wear`.
    pub name: Arc<str>,
    /// Maximum severity of a finding.
    pub severity: Severity,
    /// Title: the defect in a few words.
    pub title: Arc<str>,
    /// Documentation in Markdown: headings and paragraphs.
    pub explanation: Cow<'static, str>,
    /// What a capture must contain for a verdict of the rule. In [`CaptureFindings`] of a capture without one: what
    /// was missing.
    pub needs: Arc<str>,
    /// Cases of CiA's conformance test plan that the rule checks, such as `9.4`.
    pub cases: Vec<Arc<str>>,
    /// Subset of `cases` to which every verdict of the rule applies.
    pub shows: Vec<Arc<str>>,
    /// Standard, device profile or bus file.
    pub origin: RuleOrigin,
    /// The rule checks times. Skipped if the capture has no usable timestamps.
    pub is_timing: bool,
    /// Which of its findings are printed as one, if they have the same reason.
    pub merge: MergedFindings,
    /// Whether the rule is active.
    pub is_on: bool,
    /// KIND column of its events in text output.
    pub word: &'static str,
    /// Section of the manual, or the user's reason; `None` for a rule of a standard, see [`RuleInfo::cited_source`].
    pub source: Option<Arc<str>>,
    /// First step for the reader; `None` for a rule of a standard, see [`RuleInfo::first_step`].
    pub next_step: Option<Arc<str>>,
}

impl RuleInfo {
    /// Section of the manual, clause, or the user's reason.
    pub fn cited_source(&self) -> Option<Arc<str>> {
        self.source.clone().or_else(|| self.section("Source").map(|text| text.trim().into()))
    }

    /// First step for the reader: an imperative without a full stop, such as `check the cycle time of the node`.
    pub fn first_step(&self) -> Option<Arc<str>> {
        let described = || self.section("What to look at first").and_then(documentation::next_step);
        self.next_step.clone().or_else(|| described().map(Into::into))
    }

    /// Section of the documentation of a rule of a standard. It is read when it is needed: the sections of all rules
    /// take longer to read than a small capture to decode.
    fn section(&self, heading: &str) -> Option<&str> {
        let is_general = self.origin == RuleOrigin::General;
        is_general.then(|| documentation::section_text(&self.explanation, heading))?
    }
}

/// Subject of a finding within a node or bus.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum FindingSubject {
    /// The node or bus as a whole.
    Whole,
    /// An object of the dictionary.
    Object(ObjectAddress),
    /// A J1939 parameter group, by PGN.
    Pgn(u32),
    /// A CAN identifier.
    Id(CanId),
    /// An EMCY error code.
    Code(u16),
    /// A diagnostic trouble code: SPN and FMI.
    Fault(u32, u8),
    /// A named subject: a signal, a procedure, an output.
    Name(Arc<str>),
}

impl fmt::Display for FindingSubject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => Ok(()),
            Self::Object(object) => write!(f, "{object}"),
            Self::Pgn(pgn) => write!(f, "pgn:{pgn}"),
            Self::Id(id) => write!(f, "{id}"),
            Self::Code(code) => write!(f, "{code:04X}"),
            Self::Fault(spn, fmi) => write!(f, "{spn}/{fmi}"),
            Self::Name(name) => f.write_str(name),
        }
    }
}

/// Key of a group of findings.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct GroupKey {
    /// Index of the rule in [`CaptureFindings::rules`].
    pub rule: u16,
    /// Index of the bus.
    pub bus: BusIndex,
    /// Node; None for a finding about the bus.
    pub node: Option<NodeId>,
    /// Subject within the node or bus.
    pub about: FindingSubject,
}

/// One occurrence of a defect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Occurrence {
    /// Timestamp; None without timestamps in the capture.
    pub time: Option<Timestamp>,
    /// Frames that show it.
    pub frames: FrameRange,
}

/// Cause of a finding.
#[derive(Debug, Clone, PartialEq)]
pub enum FindingCause {
    /// Another group, by its id.
    Group(u64),
    /// A defect of the capture or the bus, as text.
    Quality(Arc<str>),
    /// A command, a write or another fact that no rule judges.
    Fact(Arc<FactCause>),
}

/// A fact that is the cause of a finding.
#[derive(Debug, Clone, PartialEq)]
pub struct FactCause {
    /// Node that the fact concerns; `None` for the bus or all nodes.
    pub node: Option<NodeId>,
    /// Name of the node in the bus file.
    pub node_name: Option<Arc<str>>,
    /// What happened.
    pub text: String,
    /// First step for the reader; empty for none.
    pub next: Arc<str>,
    /// When it happened, and its frames.
    pub at: Occurrence,
}

/// Findings with the same rule, bus, node and subject.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct FindingGroup {
    /// Number in order of appearance, from 1.
    pub id: u64,
    /// Rule, bus, node and subject.
    pub key: GroupKey,
    /// Name of the rule.
    pub rule: Arc<str>,
    /// Name of the bus.
    pub bus: Arc<str>,
    /// Name of the node in the bus file.
    pub node_name: Option<Arc<str>>,
    /// Name of the object in the dictionary of the node.
    pub object_name: Option<Arc<str>>,
    /// Next step that the rule proposes.
    pub next_step: Option<Arc<str>>,
    /// Manual and section of a finding about a device: `RE 30027-Z/11.06 §9`.
    pub manual: Option<Arc<str>>,
    /// Highest severity of all occurrences.
    pub severity: Severity,
    /// Text of the first occurrence.
    pub text: String,
    /// Measure, text and occurrence of the worst deviation, if it was not the first.
    pub worst: Option<(f64, String, Occurrence)>,
    /// Number of occurrences.
    pub count: u64,
    /// Total duration of a condition, in ns; None for a finding without a duration.
    pub lasted: Option<i64>,
    /// The condition still held at the end of the capture.
    pub lasts_to_end: bool,
    /// First occurrences, at most [`KEPT_OCCURRENCES`].
    pub first: Vec<Occurrence>,
    /// Last occurrences after `first`, oldest first.
    pub last: VecDeque<Occurrence>,
    /// Cause, if one was found.
    pub cause: Option<FindingCause>,
    /// The finding reports the same fault as its cause and is not printed.
    pub is_absorbed: bool,
    /// Group that represents this one: the same fault with another subject, printed there. It counts and has
    /// its own fingerprint.
    pub member_of: Option<u64>,
    /// State of node and bus when the finding began; None above a limit of groups.
    pub scene: Option<Box<FindingScene>>,
    /// Reason for a lower severity than that of the rule.
    pub downgraded: Option<String>,
    /// Reason of the suppression in the bus file.
    pub suppressed: Option<Arc<str>>,
    /// The condition still holds, or the last occurrence was recent.
    pub is_open: bool,
    /// All nodes that it is about: several for a group of nodes that fails together.
    pub nodes: Vec<NodeId>,
}

impl FindingGroup {
    /// Reason why the finding starts no story, in words; None if it starts one or joins that of its cause.
    pub fn omission(&self) -> Option<&'static str> {
        match self.severity {
            _ if self.suppressed.is_some() => Some("suppressed by the bus file"),
            _ if self.is_absorbed => Some("covered by another finding"),
            Severity::Note => Some("a note"),
            Severity::Warning | Severity::Error => None,
        }
    }

    /// Key that is equal in every run over the same traffic: `sdo-no-response|can0|5|0x1018:01`.
    pub fn fingerprint(&self) -> String {
        let node = self.key.node.map_or_else(String::new, |node| node.to_string());
        let parts = [self.rule.as_ref(), self.bus.as_ref(), node.as_str()];
        let mut text = parts.join("|");
        if self.key.about != FindingSubject::Whole {
            text.push('|');
            text.push_str(&self.key.about.to_string());
        }
        text
    }

    /// Content of a finding event with the first text and the total count; `rule` is its rule in
    /// [`CaptureFindings::rules`].
    pub fn opening_news(&self, rule: &RuleInfo) -> FindingNews {
        let (mut object, mut pgn, mut about) = (None, None, None);
        match &self.key.about {
            FindingSubject::Whole => {}
            FindingSubject::Object(address) => object = Some(*address),
            FindingSubject::Pgn(number) => pgn = Some(*number),
            other => about = Some(other.to_string()),
        }
        let (cause, cause_frame) = match &self.cause {
            Some(FindingCause::Group(id)) => (Some(*id), None),
            Some(FindingCause::Fact(fact)) => (None, Some(fact.at.frames.first)),
            Some(FindingCause::Quality(_)) | None => (None, None),
        };
        FindingNews {
            id: self.id,
            rule: Arc::clone(&rule.name),
            severity: self.severity,
            word: rule.word,
            text: self.text.clone(),
            object,
            pgn,
            about,
            cause,
            cause_frame,
            member_of: self.member_of,
            downgraded: self.downgraded.clone(),
            count: self.count,
            is_at_end: false,
            source: self.manual.clone().or_else(|| rule.cited_source()),
            is_manual: self.manual.is_some(),
        }
    }

    /// First occurrence.
    pub fn first_occurrence(&self) -> Occurrence {
        let none = Occurrence { time: None, frames: FrameRange::default() };
        self.first.first().copied().unwrap_or(none)
    }

    /// Last occurrence.
    pub fn last_occurrence(&self) -> Occurrence {
        self.last.back().or(self.first.last()).copied().unwrap_or_else(|| self.first_occurrence())
    }

    /// Time of presence in ns: the total for a condition, else the time from the first to the last
    /// occurrence. None for a single occurrence, and without timestamps.
    pub fn duration(&self) -> Option<i64> {
        let between = || Some(self.last_occurrence().time?.since(self.first_occurrence().time?));
        self.lasted.or_else(|| between().filter(|_| self.count > 1))
    }

    /// Whether the group is reported: neither suppressed nor absorbed.
    pub fn is_reported(&self) -> bool {
        self.suppressed.is_none() && !self.is_absorbed
    }
}

/// Counts of checks by a rule, or for a case of the test plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct CheckTally {
    /// Checks without a defect.
    pub passed: u64,
    /// Checks with a defect.
    pub failed: u64,
    /// Defects that a waiver of the device excuses.
    pub waived: u64,
}

/// Verdict of a rule over a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum RuleOutcome {
    /// Checked without a defect.
    Pass,
    /// At least one defect.
    Fail,
    /// Nothing to check in the capture.
    NotExercised,
}

impl RuleOutcome {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::NotExercised => "not-exercised",
        }
    }
}

impl CheckTally {
    /// Verdict for these counts.
    pub const fn verdict(self) -> RuleOutcome {
        match self {
            Self { failed: 1.., .. } => RuleOutcome::Fail,
            Self { passed: 0, waived: 0, .. } => RuleOutcome::NotExercised,
            _ => RuleOutcome::Pass,
        }
    }

    /// Difference to an earlier count.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Self {
        Self {
            passed: self.passed.saturating_sub(earlier.passed),
            failed: self.failed.saturating_sub(earlier.failed),
            waived: self.waived.saturating_sub(earlier.waived),
        }
    }

    /// Adds the counts of another tally.
    pub fn add_tally(&mut self, other: Self) {
        self.passed += other.passed;
        self.failed += other.failed;
        self.waived += other.waived;
    }
}

/// Effect of a suppression of the bus file in a capture.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct SuppressionUse {
    /// Description of the suppression: `node-lost of node 5`.
    pub what: String,
    /// Reason given in the bus file.
    pub reason: Arc<str>,
    /// End date, if it has passed.
    pub ended: Option<String>,
    /// Number of suppressed groups.
    pub met: usize,
}

impl SuppressionUse {
    /// Reason to review the suppression: it matched no finding, or its end date has passed.
    pub fn review_reason(&self) -> Option<String> {
        let Self { what, reason, .. } = self;
        match &self.ended {
            Some(day) => Some(format!("suppression of {what} expired on {day}: {reason}")),
            None if self.met == 0 => Some(format!("suppression of {what} matched no finding: {reason}")),
            None => None,
        }
    }

    /// Number of suppressed findings with the reason; None if no finding matched.
    pub fn suppressed_text(&self) -> Option<String> {
        let Self { what, reason, met, .. } = self;
        let findings = if *met == 1 { "finding" } else { "findings" };
        (*met > 0).then(|| format!("suppressed {met} {findings} by {what}: {reason}"))
    }
}

/// Verdicts on a case of a conformance test: of the test tool and of the rules.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct CaseVerdict {
    /// Number in the test plan, such as `7.101`.
    pub id: Arc<str>,
    /// Subject of the case; empty if the test plan does not list it.
    pub name: Arc<str>,
    /// Verdict of the test tool.
    pub tool: TestResult,
    /// Rules that check the case, with their counts within it.
    pub judged: Vec<(Arc<str>, CheckTally)>,
    /// Frames from the first marker to the last.
    pub frames: FrameRange,
    /// The start was marked; otherwise the case starts after the previous marker.
    pub has_begin: bool,
}

/// All results for one capture.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct CaptureFindings {
    /// All rules.
    pub rules: Vec<RuleInfo>,
    /// Counts of checks by rule, in the same order.
    pub tallies: Vec<CheckTally>,
    /// Counts of checks by case of the test plan.
    pub cases: BTreeMap<Arc<str>, CheckTally>,
    /// Defects, in order of appearance.
    pub groups: Vec<FindingGroup>,
    /// Number of findings above [`GROUP_LIMIT`] groups.
    pub ungrouped: u64,
    /// Limits of the verdicts, such as made-up timestamps or lost frames.
    pub quality: Vec<String>,
    /// Effect of each suppression, in the order of the bus file.
    pub suppressions: Vec<SuppressionUse>,
    /// Verdicts on marked conformance test cases, in order.
    pub conformance: Vec<CaseVerdict>,
    /// Number of error frames in the capture.
    pub error_frames: u64,
}

impl CaptureFindings {
    /// Groups to report: neither suppressed nor absorbed.
    pub fn reported_groups(&self) -> impl Iterator<Item = &FindingGroup> {
        self.groups.iter().filter(|group| group.is_reported())
    }

    /// Number of reported groups of a severity; those printed with another group are not counted.
    pub fn reported_count(&self, severity: Severity) -> usize {
        self.leading_groups().filter(|group| group.severity == severity).count()
    }

    /// Reported groups, without those printed with another group.
    pub fn leading_groups(&self) -> impl Iterator<Item = &FindingGroup> {
        let is_member = |group: &FindingGroup| {
            group.member_of.and_then(|id| self.group_by_id(id)).is_some_and(FindingGroup::is_reported)
        };
        self.reported_groups().filter(move |group| !is_member(group))
    }

    /// Groups that have this one as their cause.
    pub fn effects_of(&self, id: u64) -> impl Iterator<Item = &FindingGroup> {
        self.groups.iter().filter(move |group| group.cause == Some(FindingCause::Group(id)))
    }

    /// Groups that are the cause of a group, nearest first, at most [`CAUSES`].
    pub fn causes_of(&self, group: &FindingGroup) -> Vec<&FindingGroup> {
        let mut chain: Vec<&FindingGroup> = Vec::new();
        let mut next = &group.cause;
        while let Some(FindingCause::Group(id)) = next
            && chain.len() < CAUSES
            && let Some(cause) = self.group_by_id(*id)
        {
            chain.push(cause);
            next = &cause.cause;
        }
        chain
    }

    /// Looks up a group by its number.
    pub fn group_by_id(&self, id: u64) -> Option<&FindingGroup> {
        // Ids follow the order of the groups, from 1; some groups may have been removed.
        let place = self.groups.partition_point(|group| group.id < id);
        self.groups.get(place).filter(|group| group.id == id)
    }
}
