//! Findings of checked captures, as `cobscope check -f jsonl` prints them: one object per finding, one per capture, and a
//! total. Fields are declared in the order in which they are printed.

use serde::Serialize;

use super::report::{CaptureOutcome, CaptureResult, FindingStanding, FindingsReport};
use crate::finding::phrase::fact_text;
use crate::finding::{
    CaseVerdict, CheckTally, FindingCause, FindingGroup, Occurrence, RuleInfo, RuleOutcome, Severity,
    SuppressionUse,
};
use crate::frame::Timestamp;
use crate::sink::exact_json::ExactNumber;
use crate::wire::NodeId;

/// One object of the report.
#[derive(Debug, Clone, Serialize)]
#[serde(untagged)]
pub enum CheckRecord<'a> {
    /// A finding.
    Finding(Box<GroupRecord<'a>>),
    /// The end of a capture.
    Summary(Box<SummaryRecord<'a>>),
    /// The end of the report.
    Total(Box<TotalRecord<'a>>),
}

/// A finding.
#[derive(Debug, Clone, Serialize)]
pub struct GroupRecord<'a> {
    /// finding, summary or total.
    pub kind: &'static str,
    /// Capture, as named on the command line or found in a folder.
    pub capture: &'a str,
    /// Number of the finding within its capture, as in `decode`.
    pub finding: u64,
    /// Stable identity: rule, bus, node and subject.
    pub fingerprint: String,
    /// Name of the rule; see `cobscope explain RULE`.
    pub rule: &'a str,
    /// Defect, as a short title.
    pub title: &'a str,
    /// error, warning or note, after any downgrade.
    pub severity: &'static str,
    /// new; accepted: in the baseline; suppressed: by the bus file; absorbed: covered by the finding that is its cause.
    pub standing: &'static str,
    /// Name of the bus.
    pub bus: &'a str,
    /// canopen or j1939; determines the meaning of `node`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub protocol: Option<&'static str>,
    /// Node-ID, or J1939 address.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub node: Option<u8>,
    /// Name of the node in the bus file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub node_name: Option<&'a str>,
    /// Subject: object, PGN, code, identifier or name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub about: Option<String>,
    /// Defect with measured value and limit.
    pub text: &'a str,
    /// Number of occurrences.
    pub count: u64,
    /// Time for which it was present: total of a condition, else first to last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub duration: Option<ExactNumber>,
    /// The condition still lasted at the end of the capture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lasts: Option<bool>,
    /// Next step that the rule proposes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_step: Option<&'a str>,
    /// The first five and the last five.
    pub occurrences: Vec<OccurrenceRecord<'a>>,
    /// Worst occurrence, if it is not the first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worst: Option<WorstOccurrence<'a>>,
    /// Number of the finding that is the cause, in the same capture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cause_finding: Option<u64>,
    /// Other cause.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cause: Option<String>,
    /// Number of the finding that text output prints for this one: the same fault with another subject.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub member_of: Option<u64>,
    /// Reason for a severity lower than the rule's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub downgraded: Option<&'a str>,
    /// Manual and section of a finding about a device.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub manual: Option<&'a str>,
    /// Reason for the suppression, from the bus file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub suppressed: Option<&'a str>,
}

/// An occurrence of a finding.
#[derive(Debug, Clone, Serialize)]
pub struct OccurrenceRecord<'a> {
    /// Time; null in a capture without timestamps.
    pub t: Option<ExactNumber>,
    /// First and last frame of the occurrence.
    pub frames: [u64; 2],
    /// File of the last frame, in a capture of several parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<&'a str>,
    /// Line of the last frame in `file`, if it is text.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
}

/// The worst occurrence of a finding.
#[derive(Debug, Clone, Serialize)]
pub struct WorstOccurrence<'a> {
    /// Deviation, in the unit of the rule.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measure: Option<ExactNumber>,
    /// Text of the worst occurrence.
    pub text: &'a str,
    /// Its place.
    #[serde(flatten)]
    pub place: OccurrenceRecord<'a>,
}

/// Results of one capture.
#[derive(Debug, Clone, Serialize)]
pub struct SummaryRecord<'a> {
    /// finding, summary or total.
    pub kind: &'static str,
    /// Capture, as named on the command line or found in a folder.
    pub capture: &'a str,
    /// Frames read, over all parts.
    pub frames: u64,
    /// Files of a capture of several parts, in order.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub parts: Vec<ReportedPart<'a>>,
    /// pass, nothing-checked, fail or unreadable.
    pub verdict: &'static str,
    /// Reason why the capture was not read, or not to its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub failure: Option<&'a str>,
    /// Numbers of findings.
    #[serde(flatten)]
    pub counts: FindingCounts,
    /// Further occurrences not recorded (limit reached).
    pub ungrouped: u64,
    /// Properties of the capture that limit the verdicts.
    pub quality: &'a [String],
    /// Fingerprints in the baseline that did not occur.
    pub gone: Vec<&'a str>,
    /// Rules exercised in the baseline but not in this run.
    pub silent: &'a [String],
    /// Active rules.
    pub rules: Vec<RuleVerdict<'a>>,
    /// Cases of the CiA conformance test plan covered by rules.
    pub cases: Vec<CaseTally<'a>>,
    /// Cases of a conformance test that the capture contains.
    pub conformance: Vec<ConformanceVerdict<'a>>,
    /// Suppressions in the bus file.
    pub suppressions: Vec<SuppressionRecord>,
}

/// Results of all captures.
#[derive(Debug, Clone, Serialize)]
pub struct TotalRecord<'a> {
    /// finding, summary or total.
    pub kind: &'static str,
    /// Captures checked.
    pub captures: usize,
    /// Captures that fail.
    pub failed: usize,
    /// Captures not read, or not to their end.
    pub unreadable: usize,
    /// Numbers of findings.
    #[serde(flatten)]
    pub counts: FindingCounts,
    /// Required rules that were not exercised in any capture.
    pub missing: &'a [String],
    /// Captures of the baseline that were not checked; the check fails.
    pub absent: &'a [String],
    /// Suppressions in the bus file.
    pub suppressions: Vec<SuppressionRecord>,
    /// Whether the check fails (exit status 1).
    pub fails: bool,
}

/// Numbers of findings.
#[derive(Debug, Clone, Serialize)]
pub struct FindingCounts {
    /// New findings that are errors, without those with `member_of`.
    pub errors: usize,
    /// New findings that are warnings, without those with `member_of`.
    pub warnings: usize,
    /// New findings that are notes, without those with `member_of`.
    pub notes: usize,
    /// Findings that are in the baseline.
    pub accepted: usize,
    /// Findings suppressed by the bus file.
    pub suppressed: usize,
}

/// A file of a capture.
#[derive(Debug, Clone, Serialize)]
pub struct ReportedPart<'a> {
    /// Name of the file.
    pub file: &'a str,
    /// Number of its first frame.
    pub first_frame: u64,
}

/// Verdict of a rule.
#[derive(Debug, Clone, Serialize)]
pub struct RuleVerdict<'a> {
    /// Name.
    pub rule: &'a str,
    /// Verdict with its counts.
    #[serde(flatten)]
    pub tally: TallyRecord,
    /// Not exercised: what the capture does not contain.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub needs: Option<&'a str>,
}

/// Verdict of the rules on a case of the test plan.
#[derive(Debug, Clone, Serialize)]
pub struct CaseTally<'a> {
    /// Number of the case.
    pub case: &'a str,
    /// Verdict with its counts.
    #[serde(flatten)]
    pub tally: TallyRecord,
}

/// A verdict with its counts.
#[derive(Debug, Clone, Serialize)]
pub struct TallyRecord {
    /// pass, fail or not-exercised.
    pub verdict: &'static str,
    /// Number of checks that passed.
    pub passed: u64,
    /// Number of checks that failed.
    pub failed: u64,
    /// Number of failures waived by the device manual.
    pub waived: u64,
}

/// A case of a conformance test.
#[derive(Debug, Clone, Serialize)]
pub struct ConformanceVerdict<'a> {
    /// Number of the case.
    pub case: &'a str,
    /// Subject of the case; empty for a case unknown to the test plan.
    pub name: &'a str,
    /// Verdict of the test tool.
    pub tool: &'static str,
    /// Verdict of the rules: pass, fail or not-exercised.
    pub verdict: &'static str,
    /// Frames of the first and last mark.
    pub frames: [u64; 2],
}

/// Use of a suppression.
#[derive(Debug, Clone, Serialize)]
pub struct SuppressionRecord {
    /// Rule and node covered.
    pub what: String,
    /// Reason.
    pub reason: String,
    /// Findings covered, in the capture or in total.
    pub met: usize,
    /// Expiry date, if it has passed.
    pub ended: Option<String>,
}

impl FindingsReport {
    /// All objects in order: the findings and the summary of each capture, and the total.
    pub fn records(&self) -> impl Iterator<Item = CheckRecord<'_>> {
        let captures = self.captures.iter().flat_map(|judged| {
            let summary = || CheckRecord::Summary(Box::new(SummaryRecord::new(judged, self)));
            judged.records().chain(std::iter::once_with(summary))
        });
        captures.chain(std::iter::once_with(|| CheckRecord::Total(Box::new(TotalRecord::new(self)))))
    }
}

impl CaptureResult {
    /// The findings in order.
    fn records(&self) -> impl Iterator<Item = CheckRecord<'_>> {
        let groups = self.findings.groups.iter();
        groups.map(|group| CheckRecord::Finding(Box::new(GroupRecord::new(group, self))))
    }
}

impl<'a> GroupRecord<'a> {
    /// A finding of a capture.
    pub fn new(group: &'a FindingGroup, judged: &'a CaptureResult) -> Self {
        let rule = judged.findings.rules.get(usize::from(group.key.rule));
        let protocol = |node| if matches!(node, NodeId::Canopen(_)) { "canopen" } else { "j1939" };
        let (cause_finding, cause) = match &group.cause {
            Some(FindingCause::Group(id)) => (Some(*id), None),
            Some(FindingCause::Quality(text)) => (None, Some(text.to_string())),
            Some(FindingCause::Fact(fact)) => (None, Some(fact_text(fact))),
            None => (None, None),
        };
        let occurrences = group.first.iter().chain(&group.last);
        Self {
            kind: "finding",
            capture: &judged.capture,
            finding: group.id,
            fingerprint: group.fingerprint(),
            rule: &group.rule,
            title: rule.map_or("", |rule| &rule.title),
            severity: group.severity.name(),
            standing: judged.standing_of(group).name(),
            bus: &group.bus,
            protocol: group.key.node.map(protocol),
            node: group.key.node.map(NodeId::number),
            node_name: group.node_name.as_deref(),
            about: Some(group.key.about.to_string()).filter(|about| !about.is_empty()),
            text: &group.text,
            count: group.count,
            duration: group.duration().map(Timestamp).and_then(ExactNumber::of_time),
            lasts: group.lasts_to_end.then_some(true),
            next_step: group.next_step.as_deref(),
            occurrences: occurrences.map(|at| OccurrenceRecord::new(*at, judged)).collect(),
            worst: group.worst.as_ref().map(|(measure, text, at)| WorstOccurrence {
                // A message that never arrived has no measure.
                measure: Some(*measure).filter(|it| *it < f64::MAX).and_then(ExactNumber::of_digits),
                text,
                place: OccurrenceRecord::new(*at, judged),
            }),
            cause_finding,
            cause,
            member_of: group.member_of,
            downgraded: group.downgraded.as_deref(),
            manual: group.manual.as_deref(),
            suppressed: group.suppressed.as_deref(),
        }
    }
}

impl<'a> OccurrenceRecord<'a> {
    fn new(at: Occurrence, judged: &'a CaptureResult) -> Self {
        let file = judged.part_of(at.frames.last).map(|(_, file)| file);
        Self {
            t: at.time.and_then(ExactNumber::of_time),
            frames: [at.frames.first, at.frames.last],
            file,
            line: file.and_then(|_| judged.line_of(at)),
        }
    }
}

impl<'a> SummaryRecord<'a> {
    fn new(judged: &'a CaptureResult, report: &FindingsReport) -> Self {
        let findings = &judged.findings;
        let parts = judged.parts.iter();
        let gone = judged.comparison.gone.iter().map(|known| known.fingerprint.as_str());
        let cases = findings.cases.iter().map(|(case, tally)| CaseTally { case, tally: (*tally).into() });
        Self {
            kind: "summary",
            capture: &judged.capture,
            frames: judged.frames,
            parts: parts.map(|it| ReportedPart { file: &it.file, first_frame: it.first_frame }).collect(),
            verdict: judged.overall_outcome(report.least).name(),
            failure: judged.failure.as_deref(),
            counts: FindingCounts::of(std::slice::from_ref(judged)),
            ungrouped: findings.ungrouped,
            quality: &findings.quality,
            gone: gone.collect(),
            silent: &judged.comparison.silent,
            rules: judged.rules().map(|(rule, tally)| RuleVerdict::new(rule, tally)).collect(),
            cases: cases.collect(),
            conformance: findings.conformance.iter().map(ConformanceVerdict::new).collect(),
            suppressions: findings.suppressions.iter().map(SuppressionRecord::new).collect(),
        }
    }
}

impl<'a> TotalRecord<'a> {
    fn new(report: &'a FindingsReport) -> Self {
        let of =
            |wanted| report.captures.iter().filter(|one| one.overall_outcome(report.least) == wanted).count();
        Self {
            kind: "total",
            captures: report.captures.len(),
            failed: of(CaptureOutcome::Failed),
            unreadable: of(CaptureOutcome::Unreadable),
            counts: FindingCounts::of(&report.captures),
            missing: &report.missing,
            absent: &report.absent,
            suppressions: report.suppressions().iter().map(SuppressionRecord::new).collect(),
            fails: report.has_failed(),
        }
    }
}

impl FindingCounts {
    fn of(captures: &[CaptureResult]) -> Self {
        let new = |severity| captures.iter().map(|judged| judged.printed_count(severity)).sum();
        let all = |standing| captures.iter().map(|judged| judged.number_of(standing)).sum();
        Self {
            errors: new(Severity::Error),
            warnings: new(Severity::Warning),
            notes: new(Severity::Note),
            accepted: all(FindingStanding::Accepted),
            suppressed: all(FindingStanding::Suppressed),
        }
    }
}

impl<'a> RuleVerdict<'a> {
    fn new(rule: &'a RuleInfo, tally: CheckTally) -> Self {
        let needs = (tally.verdict() == RuleOutcome::NotExercised).then_some(&*rule.needs);
        Self { rule: &rule.name, tally: tally.into(), needs }
    }
}

impl From<CheckTally> for TallyRecord {
    fn from(tally: CheckTally) -> Self {
        let CheckTally { passed, failed, waived } = tally;
        Self { verdict: tally.verdict().name(), passed, failed, waived }
    }
}

impl<'a> ConformanceVerdict<'a> {
    fn new(case: &'a CaseVerdict) -> Self {
        Self {
            case: &case.id,
            name: &case.name,
            tool: case.tool.name(),
            verdict: case.own_verdict().name(),
            frames: [case.frames.first, case.frames.last],
        }
    }
}

impl SuppressionRecord {
    fn new(used: &SuppressionUse) -> Self {
        let SuppressionUse { what, reason, ended, met } = used.clone();
        Self { what, reason: reason.to_string(), met, ended }
    }
}
