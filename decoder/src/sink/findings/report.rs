//! Results of checked captures, and texts shared by all formats.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::comparison::BaselineComparison;
use crate::diagnosis::incident;
use crate::finding::phrase::{format_moment, notes_of, period_phrase};
use crate::finding::{
    CaptureFindings, CheckTally, FindingGroup, Occurrence, RuleInfo, RuleOutcome, Severity, SuppressionUse,
};
use crate::frame::Timestamp;

/// Text for a capture of the baseline that was not checked.
pub(super) const ABSENT: &str = "in the baseline, but not checked in this run";

/// Text for a rule exercised in the baseline but not in this run.
pub(super) const SILENT: &str = "no longer exercised (exercised in the baseline)";

/// Text for a capture in which no rule was exercised.
pub(super) const NOTHING_CHECKED: &str = "nothing checked: no rule was exercised";

/// Text for a rule of `--require-exercised` without a verdict.
pub(super) const MISSING: &str = "required, but not exercised in any capture";

/// Results of all captures.
#[derive(Debug, Clone, Default)]
pub struct FindingsReport {
    /// Each capture, in the order of the command line.
    pub captures: Vec<CaptureResult>,
    /// Lowest severity that counts as a failure; `None` if findings never count as failures.
    pub least: Option<Severity>,
    /// Whether a baseline was given.
    pub has_baseline: bool,
    /// Required rules that were not exercised in any capture.
    pub missing: Vec<String>,
    /// Captures of the baseline that were not checked this time.
    pub absent: Vec<String>,
}

/// Results of one capture.
#[derive(Debug, Clone, Default)]
pub struct CaptureResult {
    /// Name of the capture.
    pub capture: String,
    /// Frames read.
    pub frames: u64,
    /// Timestamp of the first frame, the zero of printed times.
    pub first: Option<Timestamp>,
    /// Timestamp of the last frame.
    pub last: Option<Timestamp>,
    /// Findings and verdicts.
    pub findings: CaptureFindings,
    /// Reason why the capture was not read, or not to its end.
    pub failure: Option<String>,
    /// Line number of each frame that a finding refers to, for text captures; in the file of its part.
    pub lines: BTreeMap<u64, u64>,
    /// Files of a capture that consists of several parts, in order; empty for a single file.
    pub parts: Vec<CapturePart>,
    /// Differences from the baseline.
    pub comparison: BaselineComparison,
}

/// A file of a capture that consists of several parts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CapturePart {
    /// Name of the file.
    pub file: String,
    /// Number of its first frame; frames are counted over all parts.
    pub first_frame: u64,
}

/// Overall result of a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CaptureOutcome {
    /// No failure.
    #[default]
    #[serde(rename = "pass")]
    Passed,
    /// No rule was exercised.
    #[serde(rename = "nothing-checked")]
    Unchecked,
    /// A finding counts as a failure, or a rule is no longer exercised.
    #[serde(rename = "fail")]
    Failed,
    /// The capture was not read, or not to its end.
    Unreadable,
}

impl CaptureOutcome {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passed => "pass",
            Self::Unchecked => "nothing-checked",
            Self::Failed => "fail",
            Self::Unreadable => "unreadable",
        }
    }
}

/// Treatment of a finding in the report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FindingStanding {
    /// Counts as a new finding.
    New,
    /// In the baseline.
    Accepted,
    /// Suppressed by the bus file.
    Suppressed,
    /// Covered by the finding that is its cause.
    Absorbed,
}

impl FindingStanding {
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

/// Verdict counts of one rule over all captures.
#[derive(Debug, Clone)]
pub struct RuleCoverage<'a> {
    /// Rule.
    pub rule: &'a RuleInfo,
    /// Verdict counts.
    pub tally: CheckTally,
}

impl CaptureResult {
    /// Treatment of a group.
    pub fn standing_of(&self, group: &FindingGroup) -> FindingStanding {
        match () {
            () if group.suppressed.is_some() => FindingStanding::Suppressed,
            () if group.is_absorbed => FindingStanding::Absorbed,
            () if self.comparison.accepted.contains(&group.id) => FindingStanding::Accepted,
            () => FindingStanding::New,
        }
    }

    /// Groups that count as new findings.
    pub fn new_findings(&self) -> impl Iterator<Item = &FindingGroup> {
        self.findings.groups.iter().filter(|group| self.standing_of(group) == FindingStanding::New)
    }

    /// Number of printed new findings of a severity.
    pub fn printed_count(&self, severity: Severity) -> usize {
        incident::printed_count(self.new_findings(), severity)
    }

    /// Number of groups with a given treatment.
    pub fn number_of(&self, standing: FindingStanding) -> usize {
        self.findings.groups.iter().filter(|group| self.standing_of(group) == standing).count()
    }

    /// Line of the last frame of an occurrence, for text captures.
    pub fn line_of(&self, at: Occurrence) -> Option<u64> {
        self.lines.get(&at.frames.last).copied()
    }

    /// Index and file of the part with a frame; `None` for a capture in a single file.
    pub fn part_of(&self, frame: u64) -> Option<(usize, &str)> {
        let index = self.parts.partition_point(|part| part.first_frame <= frame).saturating_sub(1);
        self.parts.get(index).map(|part| (index, part.file.as_str()))
    }

    /// File of an occurrence: that of its part.
    pub fn file_of(&self, at: Occurrence) -> &str {
        self.part_of(at.frames.last).map_or(&self.capture, |(_, file)| file)
    }

    /// File of everything that concerns the whole capture: that of the first part.
    pub fn first_file(&self) -> &str {
        self.parts.first().map_or(&self.capture, |part| &part.file)
    }

    /// `1.300 s {12-13}`, in a capture of several parts with the file: `1.300 s {140} part2.log:22`.
    pub fn moment_text(&self, at: Occurrence) -> String {
        let mut text = format_moment(at, self.first);
        if let Some((_, file)) = self.part_of(at.frames.last).filter(|_| at.frames.last > 0) {
            text.push(' ');
            text.push_str(file);
            if let Some(line) = self.line_of(at) {
                text.push(':');
                text.push_str(&line.to_string());
            }
        }
        text
    }

    /// `at 1.300 s {12-13}`, `first 1.300 s {12}, last 9.100 s {500}`.
    pub fn period_text(&self, group: &FindingGroup) -> String {
        period_phrase(group, |at| self.moment_text(at))
    }

    /// Lines below a finding: time, worst occurrence, reason for a lowered severity, section of the manual.
    pub fn finding_notes(&self, group: &FindingGroup) -> Vec<String> {
        notes_of(group, |at| self.moment_text(at))
    }

    /// Frames whose line numbers are needed.
    pub fn frames_of_findings(&self) -> BTreeSet<u64> {
        let is_joined = !self.parts.is_empty();
        let of = |group: &FindingGroup| {
            let worst = group.worst.as_ref().map(|(_, _, at)| *at);
            let all = group.first.iter().chain(&group.last).filter(|_| is_joined).copied();
            let all: Vec<_> = [group.first_occurrence()].into_iter().chain(worst).chain(all).collect();
            all.into_iter().map(|at| at.frames.last)
        };
        self.findings.groups.iter().flat_map(of).filter(|frame| *frame > 0).collect()
    }

    /// Overall result; `least` is the lowest severity that counts as a failure.
    pub fn overall_outcome(&self, least: Option<Severity>) -> CaptureOutcome {
        let is_failure = |group: &FindingGroup| least.is_some_and(|least| group.severity >= least);
        match () {
            () if self.failure.is_some() => CaptureOutcome::Unreadable,
            () if self.new_findings().any(is_failure) || !self.comparison.silent.is_empty() => {
                CaptureOutcome::Failed
            }
            () if self.rules().all(|(_, tally)| tally.verdict() == RuleOutcome::NotExercised) => {
                CaptureOutcome::Unchecked
            }
            () => CaptureOutcome::Passed,
        }
    }

    /// Active rules with their verdict counts.
    pub fn rules(&self) -> impl Iterator<Item = (&RuleInfo, CheckTally)> {
        let all = self.findings.rules.iter().zip(self.findings.tallies.iter().copied());
        all.filter(|(rule, _)| rule.is_on)
    }

    /// Number of active rules with a given verdict.
    pub fn verdict_count(&self, wanted: RuleOutcome) -> usize {
        self.rules().filter(|(_, tally)| tally.verdict() == wanted).count()
    }
}

impl FindingsReport {
    /// Whether the check fails, as stated by the exit status.
    pub fn has_failed(&self) -> bool {
        let failed = |judged: &CaptureResult| judged.overall_outcome(self.least) == CaptureOutcome::Failed;
        !self.missing.is_empty() || !self.absent.is_empty() || self.captures.iter().any(failed)
    }

    /// Sets `missing` to those of `rules` that were not exercised.
    pub fn require_rules(&mut self, rules: &[String]) {
        let coverage = self.rule_coverage();
        let exercised = |wanted: &String| {
            let mut own = coverage.iter().filter(|one| *one.rule.name == **wanted);
            own.any(|one| one.tally.verdict() != RuleOutcome::NotExercised)
        };
        let missing = rules.iter().filter(|rule| !exercised(rule)).cloned().collect();
        self.missing = missing;
    }

    /// Active rules over all captures, in evaluation order.
    pub fn rule_coverage(&self) -> Vec<RuleCoverage<'_>> {
        let mut all: Vec<RuleCoverage<'_>> = Vec::new();
        let mut places: BTreeMap<&str, usize> = BTreeMap::new();
        for (rule, tally) in self.captures.iter().flat_map(CaptureResult::rules) {
            let place = *places.entry(&rule.name).or_insert(all.len());
            match all.get_mut(place) {
                Some(known) => known.tally.add_tally(tally),
                None => all.push(RuleCoverage { rule, tally }),
            }
        }
        all
    }

    /// Cases of the conformance test plan over all captures.
    pub fn case_tallies(&self) -> BTreeMap<Arc<str>, CheckTally> {
        let mut all: BTreeMap<Arc<str>, CheckTally> = BTreeMap::new();
        for (case, tally) in self.captures.iter().flat_map(|judged| &judged.findings.cases) {
            all.entry(Arc::clone(case)).or_default().add_tally(*tally);
        }
        all
    }

    /// Use of each suppression over all captures.
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
