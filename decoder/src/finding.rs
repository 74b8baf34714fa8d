//! Findings: what rules judged to be wrong, and what they had the chance to judge.
//!
//! Occurrences of one cause are one [`Group`]: rule, bus, node, and what it is about. That key is also its
//! fingerprint in baselines and SARIF.

use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::sync::Arc;

pub use crate::profile::device::Severity;

use crate::event::{FindingNews, FrameRange};
use crate::frame::{BusIndex, CanId, Timestamp};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;
use crate::wire::canopen::test_marker::TestResult;

/// Occurrences kept of a group at its beginning, and as many of its end.
pub const KEPT_OCCURRENCES: usize = 5;

/// Groups of a capture; further ones are only counted.
pub const GROUP_LIMIT: usize = 3_000;

/// Where a rule comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum RuleOrigin {
    /// A standard: for every device.
    General,
    /// The profile of a device.
    Device,
    /// The user's bus file.
    Expectation,
}

impl RuleOrigin {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::General => "general",
            Self::Device => "device",
            Self::Expectation => "expectation",
        }
    }
}

/// What is known of a rule.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct RuleInfo {
    /// `sdo-no-response`, `rexroth-sydfec:eeprom-wear`.
    pub name: Arc<str>,
    /// How bad a finding is, unless the rule says less of one.
    pub severity: Severity,
    /// The defect in a line.
    pub title: Arc<str>,
    /// Headings and paragraphs (Markdown).
    pub explanation: Arc<str>,
    /// Cases of CiA's test plan it judges: `9.4`.
    pub cases: Vec<Arc<str>>,
    /// Those of them that any verdict of it is one of.
    pub shows: Vec<Arc<str>>,
    /// Where it comes from.
    pub origin: RuleOrigin,
    /// It judges times, so it is silent where the capture's times say nothing.
    pub is_timing: bool,
    /// It is in use.
    pub is_on: bool,
    /// KIND of its line in text.
    pub word: &'static str,
    /// Section of the manual, clause, or the user's reason.
    pub source: Option<Arc<str>>,
}

/// What of a node a finding is about.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[non_exhaustive]
pub enum About {
    /// The node, or the bus, as a whole.
    Whole,
    /// An object.
    Object(ObjectAddress),
    /// A J1939 group.
    Pgn(u32),
    /// An identifier.
    Id(CanId),
    /// An error code (EMCY).
    Code(u16),
    /// A trouble code: SPN and FMI.
    Fault(u32, u8),
    /// Anything with a name: a signal, a procedure, an output.
    Name(Arc<str>),
}

impl fmt::Display for About {
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

/// What findings are grouped by.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct Key {
    /// Place of the rule in [`Findings::rules`].
    pub rule: u16,
    /// Bus.
    pub bus: BusIndex,
    /// Node.
    pub node: Option<NodeId>,
    /// What of it.
    pub about: About,
}

/// One time that something was wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Occurrence {
    /// When.
    pub time: Option<Timestamp>,
    /// Frames that show it.
    pub frames: FrameRange,
}

/// What else explains a finding.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Cause {
    /// Another group, by its id.
    Group(u64),
    /// Something of the capture or the bus, in words.
    Quality(Arc<str>),
}

/// Findings with one rule, bus, node and subject.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Group {
    /// Number in order of appearance, from 1.
    pub id: u64,
    /// What they have in common.
    pub key: Key,
    /// Name of the rule.
    pub rule: Arc<str>,
    /// Name of the bus.
    pub bus: Arc<str>,
    /// The user's name of the node.
    pub node_name: Option<Arc<str>>,
    /// Worst of them.
    pub severity: Severity,
    /// What was wrong the first time.
    pub text: String,
    /// What was wrong when it was worst, where that is another time: measure and text.
    pub worst: Option<(f64, String, Occurrence)>,
    /// How often.
    pub count: u64,
    /// The first ones.
    pub first: Vec<Occurrence>,
    /// The last ones behind those, oldest first.
    pub last: VecDeque<Occurrence>,
    /// What explains it.
    pub cause: Option<Cause>,
    /// The finding that explains it says the same: it need not be told.
    pub is_absorbed: bool,
    /// Why it is less severe than its rule says.
    pub downgraded: Option<String>,
    /// The bus file's reason why it does not count.
    pub suppressed: Option<Arc<str>>,
    /// It goes on, as far as is known.
    pub is_open: bool,
}

impl Group {
    /// The same in every run over the same traffic: `sdo-no-response|can0|5|0x1018:01`.
    pub fn fingerprint(&self) -> String {
        let node = self.key.node.map_or_else(String::new, |node| node.to_string());
        let parts = [self.rule.as_ref(), self.bus.as_ref(), node.as_str()];
        let mut text = parts.join("|");
        if self.key.about != About::Whole {
            text.push('|');
            text.push_str(&self.key.about.to_string());
        }
        text
    }

    /// What an event says of it, by its rule in [`Findings::rules`]: the first text, and all times it was seen.
    pub fn news(&self, rule: &RuleInfo) -> FindingNews {
        let (mut object, mut pgn, mut about) = (None, None, None);
        match &self.key.about {
            About::Whole => {}
            About::Object(address) => object = Some(*address),
            About::Pgn(number) => pgn = Some(*number),
            other => about = Some(other.to_string()),
        }
        let cause = match self.cause {
            Some(Cause::Group(id)) => Some(id),
            _ => None,
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
            downgraded: self.downgraded.clone(),
            count: self.count,
            is_at_end: false,
            source: rule.source.clone(),
        }
    }

    /// First occurrence.
    pub fn began(&self) -> Occurrence {
        let none = Occurrence { time: None, frames: FrameRange::default() };
        self.first.first().copied().unwrap_or(none)
    }

    /// Last occurrence.
    pub fn ended(&self) -> Occurrence {
        self.last.back().or(self.first.last()).copied().unwrap_or_else(|| self.began())
    }

    /// Whether it stands for itself: neither suppressed nor told by another one.
    pub fn counts(&self) -> bool {
        self.suppressed.is_none() && !self.is_absorbed
    }
}

/// How often a rule, or a case of the test plan, was judged, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub struct Tally {
    /// Times nothing was wrong.
    pub passed: u64,
    /// Times something was.
    pub failed: u64,
    /// Times a device's manual excuses.
    pub waived: u64,
}

/// What a rule comes to over a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Verdict {
    /// Judged, nothing wrong.
    Pass,
    /// Something was wrong.
    Fail,
    /// There was nothing to judge.
    NotExercised,
}

impl Verdict {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::NotExercised => "not-exercised",
        }
    }
}

impl Tally {
    /// The verdict.
    pub const fn verdict(self) -> Verdict {
        match self {
            Self { failed: 1.., .. } => Verdict::Fail,
            Self { passed: 0, waived: 0, .. } => Verdict::NotExercised,
            _ => Verdict::Pass,
        }
    }

    /// What came since an earlier count.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Self {
        Self {
            passed: self.passed.saturating_sub(earlier.passed),
            failed: self.failed.saturating_sub(earlier.failed),
            waived: self.waived.saturating_sub(earlier.waived),
        }
    }

    /// Adds another one.
    pub fn add(&mut self, other: Self) {
        self.passed += other.passed;
        self.failed += other.failed;
        self.waived += other.waived;
    }
}

/// What a suppression of the bus file came to in a capture.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct SuppressionUse {
    /// What it covers: `node-lost of node 5`.
    pub what: String,
    /// The user's reason.
    pub reason: Arc<str>,
    /// The day it ran out.
    pub ended: Option<String>,
    /// Groups it covers.
    pub met: usize,
}

impl SuppressionUse {
    /// Why the bus file should be looked at: it met nothing, or it ran out.
    pub fn complaint(&self) -> Option<String> {
        let Self { what, reason, .. } = self;
        match &self.ended {
            Some(day) => Some(format!("suppression of {what} ran out on {day}: {reason}")),
            None if self.met == 0 => Some(format!("suppression of {what} met nothing: {reason}")),
            None => None,
        }
    }

    /// How many findings do not count for its sake, and why; nothing where it met none.
    pub fn covered(&self) -> Option<String> {
        let Self { what, reason, met, .. } = self;
        let findings = if *met == 1 { "finding" } else { "findings" };
        (*met > 0).then(|| format!("suppressed {met} {findings} by {what}: {reason}"))
    }
}

/// A case of a conformance test that was run: the test tool's verdict and ours.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct CaseVerdict {
    /// `7.101`.
    pub id: Arc<str>,
    /// Its subject; empty for a case the plan does not have.
    pub name: Arc<str>,
    /// The tool's verdict.
    pub tool: TestResult,
    /// The rules that judge it, and how often they judged within it.
    pub judged: Vec<(Arc<str>, Tally)>,
    /// Frames from its first mark to its last.
    pub frames: FrameRange,
    /// Its beginning was marked; else it is taken to begin behind the mark before.
    pub has_begin: bool,
}

/// Everything that was judged of one capture.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Findings {
    /// The rules.
    pub rules: Vec<RuleInfo>,
    /// How often each was judged, in the same order.
    pub tallies: Vec<Tally>,
    /// The same by case of CiA's test plan.
    pub cases: BTreeMap<Arc<str>, Tally>,
    /// What was wrong, in order of appearance.
    pub groups: Vec<Group>,
    /// Findings that found no room in [`GROUP_LIMIT`] groups.
    pub ungrouped: u64,
    /// What limits the verdicts: made-up times, lost frames.
    pub quality: Vec<String>,
    /// What the suppressions of the bus file came to, in its order.
    pub suppressions: Vec<SuppressionUse>,
    /// Cases of a conformance test that was run, in order.
    pub conformance: Vec<CaseVerdict>,
}

impl Findings {
    /// Groups that stand for themselves.
    pub fn counting(&self) -> impl Iterator<Item = &Group> {
        self.groups.iter().filter(|group| group.counts())
    }

    /// How many groups of a severity stand for themselves.
    pub fn number(&self, severity: Severity) -> usize {
        self.counting().filter(|group| group.severity == severity).count()
    }

    /// Groups another one explains.
    pub fn effects(&self, id: u64) -> impl Iterator<Item = &Group> {
        self.groups.iter().filter(move |group| group.cause == Some(Cause::Group(id)))
    }

    /// A group by its number.
    pub fn group(&self, id: u64) -> Option<&Group> {
        self.groups.iter().find(|group| group.id == id)
    }
}
