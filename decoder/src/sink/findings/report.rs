//! What was judged of captures, and the words for it that all formats share.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::comparison::Comparison;
use crate::finding::{Findings, Group, Occurrence, RuleInfo, Severity, SuppressionUse, Tally, Verdict};
use crate::frame::Timestamp;
use crate::wire::NodeId;

/// What is said of a capture that the baseline has and that was judged nowhere.
pub(super) const ABSENT: &str = "not judged in this run: the baseline has it judged";

/// What is said of a rule that the baseline has exercised and that is not any more.
pub(super) const SILENT: &str = "not exercised any more: the baseline has it exercised";

/// What is said of a rule of `--require-exercised`.
pub(super) const MISSING: &str = "had to be exercised, and was in no capture";

/// What was judged of all captures.
#[derive(Debug, Clone, Default)]
pub struct Report {
    /// Each capture, in the order of the command line.
    pub captures: Vec<Judged>,
    /// Findings from this severity on are failures; none are without.
    pub least: Option<Severity>,
    /// There is a baseline.
    pub has_baseline: bool,
    /// Rules that had to be exercised, and were in no capture.
    pub missing: Vec<String>,
    /// Captures of the baseline that were not judged this time: what they judged is lost.
    pub absent: Vec<String>,
}

/// What was judged of one capture.
#[derive(Debug, Clone, Default)]
pub struct Judged {
    /// Name of the capture.
    pub capture: String,
    /// Frames read.
    pub frames: u64,
    /// Stamp of the first frame: the zero of times.
    pub first: Option<Timestamp>,
    /// Stamp of the last frame.
    pub last: Option<Timestamp>,
    /// Everything judged.
    pub findings: Findings,
    /// Why it could not be read, or not to its end.
    pub failure: Option<String>,
    /// Lines of frames that findings name, where the capture is text.
    pub lines: BTreeMap<u64, u64>,
    /// What differs from the baseline.
    pub comparison: Comparison,
}

/// What a capture comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Nothing that counts as a failure.
    Passed,
    /// Findings that do, or a rule that is not exercised any more.
    Failed,
    /// It could not be read, or not to its end.
    Unreadable,
}

impl Outcome {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passed => "pass",
            Self::Failed => "fail",
            Self::Unreadable => "unreadable",
        }
    }
}

/// What a finding counts for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standing {
    /// It stands for itself.
    New,
    /// The baseline has it.
    Accepted,
    /// The bus file has a reason why it does not count.
    Suppressed,
    /// The finding that explains it says the same.
    Absorbed,
}

impl Standing {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::New => "new",
            Self::Accepted => "accepted",
            Self::Suppressed => "suppressed",
            Self::Absorbed => "absorbed",
        }
    }
}

/// What was judged of one rule, or one case of the test plan, over all captures.
#[derive(Debug, Clone)]
pub struct Coverage<'a> {
    /// The rule.
    pub rule: &'a RuleInfo,
    /// How often.
    pub tally: Tally,
}

impl Judged {
    /// What a group counts for.
    pub fn standing(&self, group: &Group) -> Standing {
        match () {
            () if group.suppressed.is_some() => Standing::Suppressed,
            () if group.is_absorbed => Standing::Absorbed,
            () if self.comparison.accepted.contains(&group.id) => Standing::Accepted,
            () => Standing::New,
        }
    }

    /// Groups that stand for themselves.
    pub fn telling(&self) -> impl Iterator<Item = &Group> {
        self.findings.groups.iter().filter(|group| self.standing(group) == Standing::New)
    }

    /// How many groups of a severity stand for themselves.
    pub fn number(&self, severity: Severity) -> usize {
        self.telling().filter(|group| group.severity == severity).count()
    }

    /// How many groups count for something else.
    pub fn number_of(&self, standing: Standing) -> usize {
        self.findings.groups.iter().filter(|group| self.standing(group) == standing).count()
    }

    /// Line of the last of these frames, where the capture is text.
    pub fn line(&self, at: Occurrence) -> Option<u64> {
        self.lines.get(&at.frames.last).copied()
    }

    /// Frames of which lines are asked for.
    pub fn frames_of_findings(&self) -> BTreeSet<u64> {
        let of = |group: &Group| {
            let worst = group.worst.as_ref().map(|(_, _, at)| at.frames.last);
            [Some(group.began().frames.last), worst]
        };
        self.findings.groups.iter().flat_map(of).flatten().filter(|frame| *frame > 0).collect()
    }

    /// What it comes to.
    pub fn outcome(&self, least: Option<Severity>) -> Outcome {
        let is_failure = |group: &Group| least.is_some_and(|least| group.severity >= least);
        match () {
            () if self.failure.is_some() => Outcome::Unreadable,
            () if self.telling().any(is_failure) || !self.comparison.silent.is_empty() => Outcome::Failed,
            () => Outcome::Passed,
        }
    }

    /// Rules in use with how often they were judged.
    pub fn rules(&self) -> impl Iterator<Item = (&RuleInfo, Tally)> {
        let all = self.findings.rules.iter().zip(self.findings.tallies.iter().copied());
        all.filter(|(rule, _)| rule.is_on)
    }

    /// How many rules have a verdict.
    pub fn verdicts(&self, wanted: Verdict) -> usize {
        self.rules().filter(|(_, tally)| tally.verdict() == wanted).count()
    }
}

impl Report {
    /// Whether it fails: the exit status says so.
    pub fn fails(&self) -> bool {
        let failed = |judged: &Judged| judged.outcome(self.least) == Outcome::Failed;
        !self.missing.is_empty() || !self.absent.is_empty() || self.captures.iter().any(failed)
    }

    /// Takes note of which of these rules were exercised nowhere.
    pub fn require(&mut self, rules: &[String]) {
        let coverage = self.coverage();
        let exercised = |wanted: &String| {
            let mut own = coverage.iter().filter(|one| *one.rule.name == **wanted);
            own.any(|one| one.tally.verdict() != Verdict::NotExercised)
        };
        let missing = rules.iter().filter(|rule| !exercised(rule)).cloned().collect();
        self.missing = missing;
    }

    /// Rules in use over all captures, in the order they are asked.
    pub fn coverage(&self) -> Vec<Coverage<'_>> {
        let mut all: Vec<Coverage<'_>> = Vec::new();
        let mut places: BTreeMap<&str, usize> = BTreeMap::new();
        for (rule, tally) in self.captures.iter().flat_map(Judged::rules) {
            let place = *places.entry(&rule.name).or_insert(all.len());
            match all.get_mut(place) {
                Some(known) => known.tally.add(tally),
                None => all.push(Coverage { rule, tally }),
            }
        }
        all
    }

    /// Cases of the test plan over all captures.
    pub fn cases(&self) -> BTreeMap<Arc<str>, Tally> {
        let mut all: BTreeMap<Arc<str>, Tally> = BTreeMap::new();
        for (case, tally) in self.captures.iter().flat_map(|judged| &judged.findings.cases) {
            all.entry(Arc::clone(case)).or_default().add(*tally);
        }
        all
    }

    /// What the suppressions came to over all captures.
    pub fn suppressions(&self) -> Vec<SuppressionUse> {
        let mut all: Vec<SuppressionUse> = Vec::new();
        for judged in &self.captures {
            for (place, one) in judged.findings.suppressions.iter().enumerate() {
                match all.get_mut(place) {
                    Some(known) => known.met += one.met,
                    None => all.push(one.clone()),
                }
            }
        }
        all
    }
}

/// `can0 5/05 pump`.
pub fn who(group: &Group) -> String {
    let node = group.key.node.map(NodeId::label);
    let parts = [Some(group.bus.to_string()), node, group.node_name.as_deref().map(str::to_owned)];
    parts.into_iter().flatten().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}

/// What is wrong, with what it is about: `1018:01: answered after 300 ms`.
pub fn what(group: &Group) -> String {
    let about = group.key.about.to_string();
    if about.is_empty() || group.text.contains(&about) {
        group.text.clone()
    } else {
        format!("{about}: {}", group.text)
    }
}

/// `at 1.300 s {12-13}`, `3 times, first 1.300 s {12}, last 9.100 s {500}`.
pub fn when(group: &Group, zero: Option<Timestamp>) -> String {
    let (began, ended) = (moment(group.began(), zero), moment(group.ended(), zero));
    if group.count == 1 {
        return format!("at {began}");
    }
    format!("{} times, first {began}, last {ended}", group.count)
}

/// `1.300 s {12-13}`.
pub fn moment(at: Occurrence, zero: Option<Timestamp>) -> String {
    let frames = at.frames;
    let frames = match (frames.first, frames.last) {
        (_, 0) => String::new(),
        (first, last) if first == last => format!("{{{last}}}"),
        (first, last) => format!("{{{first}-{last}}}"),
    };
    match at.time.zip(zero) {
        Some((time, zero)) => format!("{} {frames}", seconds(time.since(zero))),
        None => frames,
    }
}

/// `1.300 s`.
pub(super) fn seconds(nanoseconds: i64) -> String {
    let milliseconds = nanoseconds.unsigned_abs() / 1_000_000;
    let sign = if nanoseconds < 0 && milliseconds > 0 { "-" } else { "" };
    format!("{sign}{}.{:03} s", milliseconds / 1_000, milliseconds % 1_000)
}

/// The lines below the finding: when, the worst, why it is less severe, what explains it.
pub fn notes(group: &Group, zero: Option<Timestamp>) -> Vec<String> {
    let mut notes = vec![when(group, zero)];
    if let Some((_, text, at)) = &group.worst {
        notes.push(format!("worst {}: {text}", moment(*at, zero)));
    }
    if let Some(reason) = &group.downgraded {
        notes.push(format!("less severe: {reason}"));
    }
    notes
}
