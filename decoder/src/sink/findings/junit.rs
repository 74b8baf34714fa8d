//! JUnit XML: one suite per capture, one test case per exercised rule.

use std::time::Duration;

use quick_junit::{NonSuccessKind, TestCase, TestCaseStatus, TestSuite, XmlString};

use super::format::{FindingFormat, write_at_once};
use super::report::{
    ABSENT, CaptureOutcome, CaptureResult, FindingsReport, MISSING, NOTHING_CHECKED, SILENT,
};
use crate::diagnosis::incident::{IncidentFinding, group_incidents};
use crate::escape::escape;
use crate::finding::phrase::{finding_sentence, node_phrase, subject_phrase};
use crate::finding::{FindingGroup, RuleOutcome, Severity, SuppressionUse};
use crate::words::count_noun;

pub(super) const FORMAT: FindingFormat = FindingFormat {
    name: "junit",
    help: "JUnit XML: one suite per capture, one test case per exercised rule",
    mark: "<testsuites name=\"cobscope\"",
    has_lines: true,
    write: |report, _, out| write_at_once(out, |text| write_junit(report, text)),
};

/// Writes all captures.
fn write_junit(report: &FindingsReport, out: &mut String) {
    let mut junit = quick_junit::Report::new("cobscope");
    junit.add_test_suites(report.captures.iter().map(|judged| test_suite(judged, report.least)));
    let missing = report.missing.iter().map(|rule| (rule, "not-exercised", MISSING));
    junit.add_test_suites(failure_suite("required", missing));
    let absent = report.absent.iter().map(|capture| (capture, "absent", ABSENT));
    junit.add_test_suites(failure_suite("baseline", absent));
    junit.add_test_suites(suppression_suite(&report.suppressions()));
    // Writing to memory cannot fail; names were stripped of characters that XML forbids.
    out.push_str(&junit.to_string().unwrap_or_default());
}

fn test_suite(judged: &CaptureResult, least: Option<Severity>) -> TestSuite {
    let mut suite = TestSuite::new(to_xml(&judged.capture));
    if let Some(text) = &judged.failure {
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
        status.set_type("unreadable").set_message(to_xml(text));
        suite.add_test_case(TestCase::new("capture", status));
    }
    if judged.overall_outcome(least) == CaptureOutcome::Unchecked {
        let mut status = TestCaseStatus::skipped();
        status.set_message(NOTHING_CHECKED);
        suite.add_test_case(TestCase::new("capture", status));
    }
    let quality = judged.findings.quality.iter().map(|note| escape(note).into_owned());
    let gone = judged
        .comparison
        .gone
        .iter()
        .map(|known| escape(&format!("gone: {}", known.known_line())).into_owned());
    let skipped = judged.verdict_count(RuleOutcome::NotExercised);
    let skipped = (skipped > 0).then(|| format!("{} not exercised", count_noun(skipped, "rule")));
    let notes: Vec<_> = quality.chain(gone).chain(skipped).collect();
    if !notes.is_empty() {
        suite.set_system_out(xml_lines(&notes.join("\n")));
    }
    let incidents = group_incidents(judged.new_findings());
    let findings: Vec<_> = incidents.iter().flat_map(|incident| &incident.findings).collect();
    if let Some(length) = judged.first.zip(judged.last).map(|(first, last)| last.since(first)) {
        suite.set_time(suite_time(length));
    }
    for (rule, tally) in judged.rules() {
        let own: Vec<_> = findings.iter().copied().filter(|it| it.group.rule == rule.name).collect();
        let suppressed = suppressed_texts(judged, &rule.name);
        let is_silent = judged.comparison.silent.iter().any(|silent| **silent == *rule.name);
        let mut case = TestCase::new(to_xml(&rule.name), case_status(&own, judged, least));
        if is_silent {
            case = TestCase::new(to_xml(&rule.name), failure_status("not-exercised", SILENT, SILENT));
        } else if own.is_empty() && !suppressed.is_empty() {
            case.status = TestCaseStatus::skipped();
            case.status.set_message(xml_lines(&suppressed.join("; ")));
        } else if own.is_empty() && tally.verdict() == RuleOutcome::NotExercised {
            continue;
        } else if !own.is_empty() {
            let text = if has_failures(&own, least) { String::new() } else { finding_texts(&own, judged) };
            let lines: Vec<_> =
                std::iter::once(text).chain(suppressed).filter(|text| !text.is_empty()).collect();
            if !lines.is_empty() {
                case.set_system_out(xml_lines(&lines.join("\n")));
            }
        }
        case.set_classname(to_xml(&judged.capture));
        case.set_time(suite_time(own.iter().filter_map(|it| it.group.duration()).max().unwrap_or(0)));
        suite.add_test_case(case);
    }
    suite
}

/// Time of a suite: the length of the capture; of a case: how long its longest finding was present.
fn suite_time(nanoseconds: i64) -> Duration {
    Duration::from_nanos(u64::try_from(nanoseconds).unwrap_or(0))
}

/// A suite of failed test cases; `None` if there are no cases.
fn failure_suite<'a>(
    name: &str,
    cases: impl Iterator<Item = (&'a String, &'static str, &'static str)>,
) -> Option<TestSuite> {
    let mut suite = TestSuite::new(name);
    suite.add_test_cases(
        cases.map(|(case, kind, text)| TestCase::new(to_xml(case), failure_status(kind, text, text))),
    );
    (!suite.test_cases.is_empty()).then_some(suite)
}

/// A suite of suppressions; each test case passes and lists the covered findings.
fn suppression_suite(all: &[SuppressionUse]) -> Option<TestSuite> {
    let mut suite = TestSuite::new("suppressions");
    for one in all {
        let mut case = TestCase::new(to_xml(&one.what), TestCaseStatus::success());
        let lines: Vec<_> = [one.suppressed_text(), one.review_reason()].into_iter().flatten().collect();
        case.set_system_out(xml_lines(&lines.iter().map(|text| escape(text)).collect::<Vec<_>>().join("\n")));
        suite.add_test_case(case);
    }
    (!all.is_empty()).then_some(suite)
}

/// Suppressed findings of a rule, with reasons.
fn suppressed_texts(judged: &CaptureResult, rule: &str) -> Vec<String> {
    let own = judged.findings.groups.iter().filter(|group| *group.rule == *rule);
    let suppressed = own.filter_map(|group| {
        let reason = group.suppressed.as_deref()?;
        Some(
            escape(&format!("suppressed: {}  {}: {reason}", node_phrase(group), subject_phrase(group)))
                .into_owned(),
        )
    });
    suppressed.collect()
}

fn has_failures(findings: &[&IncidentFinding<'_>], least: Option<Severity>) -> bool {
    findings.iter().any(|finding| least.is_some_and(|least| finding.severity() >= least))
}

fn case_status(
    findings: &[&IncidentFinding<'_>],
    judged: &CaptureResult,
    least: Option<Severity>,
) -> TestCaseStatus {
    match findings.iter().max_by_key(|finding| finding.severity()) {
        Some(worst) if has_failures(findings, least) => {
            let message = format!("{}  {}", node_phrase(worst.group), finding_sentence(worst.group));
            failure_status(worst.severity().name(), &message, &finding_texts(findings, judged))
        }
        _ => TestCaseStatus::success(),
    }
}

fn failure_status(kind: &str, message: &str, text: &str) -> TestCaseStatus {
    let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
    status.set_type(to_xml(kind)).set_message(to_xml(message)).set_description(xml_lines(text));
    status
}

/// Findings with their notes, as lines.
fn finding_texts(findings: &[&IncidentFinding<'_>], judged: &CaptureResult) -> String {
    let mut lines = Vec::new();
    for finding in findings {
        let group = finding.group;
        lines.push(format!(
            "{} {}  {}",
            finding.severity().name(),
            node_phrase(group),
            finding_sentence(group)
        ));
        lines.extend(finding.member_text().map(|also| format!("    {also}")));
        lines.extend(causes_text(group, judged).map(|cause| format!("    cause: {cause}")));
        lines.extend(judged.finding_notes(group).into_iter().map(|note| format!("    {note}")));
        if let Some(line) = judged.line_of(group.first_occurrence()) {
            lines.push(format!("    {}:{line}", judged.file_of(group.first_occurrence())));
        }
    }
    lines.iter().map(|line| escape(line).into_owned()).collect::<Vec<_>>().join("\n")
}

/// All causes of a finding, nearest first.
fn causes_text(group: &FindingGroup, judged: &CaptureResult) -> Option<String> {
    let causes = judged.findings.causes_of(group);
    let chain: Vec<_> = causes
        .iter()
        .map(|cause| format!("{}  {} [{}]", node_phrase(cause), subject_phrase(cause), cause.rule))
        .collect();
    (!chain.is_empty()).then(|| chain.join(", by "))
}

/// Text from a capture, with control characters escaped.
fn to_xml(text: &str) -> XmlString {
    XmlString::new(escape(text))
}

/// Text of several lines, each already escaped.
fn xml_lines(text: &str) -> XmlString {
    XmlString::new(text)
}
