//! JUnit XML: a suite a capture, a case a rule.

use quick_junit::{NonSuccessKind, TestCase, TestCaseStatus, TestSuite, XmlString};

use super::incident::incidents;
use super::{Judged, Report, notes, what, who};
use crate::finding::{Group, Severity, Verdict};
use crate::sink::escape;

/// Writes all captures.
pub fn write(report: &Report, out: &mut String) {
    let mut junit = quick_junit::Report::new("cobscope");
    junit.add_test_suites(report.captures.iter().map(|judged| suite(judged, report.least)));
    if !report.missing.is_empty() {
        let mut required = TestSuite::new("required");
        for rule in &report.missing {
            let text = "had to be exercised, and was in no capture";
            required.add_test_case(TestCase::new(xml(rule), failure("not-exercised", text, text)));
        }
        junit.add_test_suite(required);
    }
    // Writing to memory does not fail; names without what XML cannot hold were made above.
    out.push_str(&junit.to_string().unwrap_or_default());
}

fn suite(judged: &Judged, least: Option<Severity>) -> TestSuite {
    let mut suite = TestSuite::new(xml(&judged.capture));
    if let Some(text) = &judged.failure {
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
        status.set_type("unreadable").set_message(xml(text));
        suite.add_test_case(TestCase::new("capture", status));
    }
    let quality: Vec<_> = judged.findings.quality.iter().map(|note| escape(note)).collect();
    if !quality.is_empty() {
        suite.set_system_out(xml_lines(&quality.join("\n")));
    }
    let told: Vec<&Group> = incidents(judged.telling())
        .into_iter()
        .flat_map(|incident| incident.groups)
        .map(|(_, group)| group)
        .collect();
    for (rule, tally) in judged.rules() {
        let own: Vec<&Group> = told.iter().copied().filter(|group| group.rule == rule.name).collect();
        let is_silent = judged.comparison.silent.iter().any(|silent| **silent == *rule.name);
        let mut case = TestCase::new(xml(&rule.name), status(&own, judged, least));
        if is_silent {
            let text = "not exercised any more: the baseline has it exercised";
            case = TestCase::new(xml(&rule.name), failure("not-exercised", text, text));
        } else if own.is_empty() && tally.verdict() == Verdict::NotExercised {
            case.status = TestCaseStatus::skipped();
            case.status.set_message("not exercised: nothing in the capture to judge");
        } else if !own.is_empty() && !fails(&own, least) {
            case.set_system_out(xml_lines(&texts(&own, judged)));
        }
        case.set_classname(xml(&judged.capture));
        suite.add_test_case(case);
    }
    suite
}

fn fails(groups: &[&Group], least: Option<Severity>) -> bool {
    groups.iter().any(|group| least.is_some_and(|least| group.severity >= least))
}

fn status(groups: &[&Group], judged: &Judged, least: Option<Severity>) -> TestCaseStatus {
    match groups.iter().max_by_key(|group| group.severity) {
        Some(worst) if fails(groups, least) => {
            let message = format!("{}  {}", who(worst), what(worst));
            failure(worst.severity.name(), &message, &texts(groups, judged))
        }
        _ => TestCaseStatus::success(),
    }
}

fn failure(kind: &str, message: &str, text: &str) -> TestCaseStatus {
    let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
    status.set_type(xml(kind)).set_message(xml(message)).set_description(xml_lines(text));
    status
}

/// Each finding with its notes.
fn texts(groups: &[&Group], judged: &Judged) -> String {
    let mut lines = Vec::new();
    for group in groups {
        lines.push(format!("{} {}  {}", group.severity.name(), who(group), what(group)));
        lines.extend(notes(group, judged.first).into_iter().map(|note| format!("    {note}")));
        if let Some(line) = judged.line(group.began()) {
            lines.push(format!("    {}:{line}", judged.capture));
        }
    }
    lines.iter().map(|line| escape(line).into_owned()).collect::<Vec<_>>().join("\n")
}

/// What a capture says, with its control characters shown.
fn xml(text: &str) -> XmlString {
    XmlString::new(escape(text))
}

/// The same of text of ours in lines, each escaped before.
fn xml_lines(text: &str) -> XmlString {
    XmlString::new(text)
}
