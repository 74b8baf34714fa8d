//! A run of CiA's conformance test tool, judged by our rules. `fixtures/rules/conformance.expected.txt` has
//! both verdicts of each case, and a reason if they differ.

use std::collections::BTreeMap;
use std::fs;
use std::sync::Arc;

use cobscope_decoder::finding::{CaptureFindings, CaseVerdict, RuleOutcome, Severity};
use cobscope_decoder::profile::{device_file, imported};
use cobscope_decoder::session::{AssignedBy, Assignment, SessionOptions};
use cobscope_decoder::wire::NodeId;
use cobscope_decoder::wire::canopen::test_marker::TestResult;

use crate::rules::judge;
use crate::support;

const RUN: &str = "canopen/CANopenDemo__ctt_3.0.3.10_run.log";
const EDS: &str = "eds/CANopenDemo__demoDevice.eds";

/// Node-ID of the device under test.
const NODE: u8 = 4;

/// Max number of disagreements.
const MOST: usize = 8;

/// Findings in the run, with the device's EDS; `None` with a message if the corpus is missing.
fn findings() -> Option<CaptureFindings> {
    let corpus = support::corpus();
    let (Ok(frames), Ok(eds)) = (fs::read_to_string(corpus.join(RUN)), fs::read(corpus.join(EDS))) else {
        support::skip("corpus", &format!("{} is not there", corpus.join(RUN).display()));
        return None;
    };
    let device = imported::describe_device(&Arc::new(device_file::parse_device_file(&eds).unwrap()), EDS);
    let mut options = SessionOptions::default();
    options.assignments.push(Assignment {
        bus: None,
        node: NodeId::Canopen(NODE),
        device: Arc::new(device),
        by: AssignedBy::DeviceFile,
    });
    Some(judge(&frames, &options, crate::rules::plain_setup()).1)
}

const fn name(result: TestResult) -> &'static str {
    match result {
        TestResult::Passed => "passed",
        TestResult::Warning => "warning",
        TestResult::Failed => "failed",
        TestResult::Skipped => "skipped",
        TestResult::Other(_) => "other",
    }
}

/// Lines of the file by case: the tool's verdict, our verdict, the reason.
fn expected() -> BTreeMap<String, (String, String, String)> {
    let path = support::workspace().join("fixtures").join("rules").join("conformance.expected.txt");
    let text = fs::read_to_string(path).unwrap();
    let lines = text.lines().filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines
        .map(|line| {
            let mut words = line.splitn(4, ' ').map(str::to_owned);
            let mut next = || words.next().unwrap_or_default();
            (next(), (next(), next(), next()))
        })
        .collect()
}

#[test]
fn a_run_of_the_conformance_tool_is_read_whole() {
    let Some(findings) = findings() else { return };
    let cases = &findings.conformance;
    let count = |result| cases.iter().filter(|case| case.tool == result).count();
    let results =
        [TestResult::Passed, TestResult::Warning, TestResult::Failed, TestResult::Skipped].map(count);
    let begins = cases.iter().filter(|case| case.has_begin).count();
    assert_eq!((cases.len(), begins, results), (127, 126, [85, 1, 5, 36]));
    assert!(cases.iter().all(|case| !case.name.is_empty()));
}

#[test]
fn each_disagreement_with_the_conformance_tool_has_a_reason() {
    let Some(findings) = findings() else { return };
    let expected = expected();
    assert!(expected.len() <= MOST, "{}", expected.len());
    let disagreeing: BTreeMap<_, _> = findings
        .conformance
        .iter()
        .filter(|case| case.contradicts_tool())
        .map(|case| (case.id.to_string(), (name(case.tool).to_owned(), case.own_verdict().name().to_owned())))
        .collect();
    let known: BTreeMap<_, _> =
        expected.iter().map(|(id, (tool, ours, _))| (id.clone(), (tool.clone(), ours.clone()))).collect();
    assert_eq!(disagreeing, known);
    assert!(expected.values().all(|(.., reason)| reason.split(' ').count() > 5), "a reason is a sentence");
}

#[test]
fn times_of_a_run_with_made_up_stamps_are_not_judged_and_nothing_is_wrong() {
    let Some(findings) = findings() else { return };
    for (rule, tally) in findings.rules.iter().zip(&findings.tallies).filter(|(rule, _)| rule.is_timing) {
        assert_eq!(tally.verdict(), RuleOutcome::NotExercised, "{}", rule.name);
    }
    let times = |case: &CaseVerdict| {
        let is_timing = |name: &str| findings.rules.iter().any(|rule| rule.is_timing && *rule.name == *name);
        case.judged.iter().any(|(rule, _)| is_timing(rule))
    };
    assert!(!findings.conformance.iter().any(times));
    for group in findings.reported_groups() {
        assert_eq!(group.severity, Severity::Note, "{}: {}", group.rule, group.text);
    }
}
