//! Verdicts of the CiA conformance test tool in a capture, compared with the verdicts of the rules.

use std::fmt::Write as _;

use super::report::CaptureResult;
use crate::escape::escape;
use crate::event::FrameRange;
use crate::finding::{CaseVerdict, RuleOutcome};
use crate::wire::canopen::test_marker::TestResult;
use crate::words::count_noun;

/// Appends the verdicts of the test tool and of the rules, and each case in which they differ.
pub(super) fn write_conformance(judged: &CaptureResult, out: &mut String) {
    let cases = &judged.findings.conformance;
    if cases.is_empty() {
        return;
    }
    let tool = |wanted| cases.iter().filter(|case| case.tool == wanted).count();
    let ours = |wanted| cases.iter().filter(|case| case.own_verdict() == wanted).count();
    let _ = writeln!(
        out,
        "conformance test: {}; test tool: {} passed, {}, {} failed, {} skipped; rules: {} passed, {} failed, \
         {} not exercised",
        count_noun(cases.len(), "case"),
        tool(TestResult::Passed),
        count_noun(tool(TestResult::Warning), "warning"),
        tool(TestResult::Failed),
        tool(TestResult::Skipped),
        ours(RuleOutcome::Pass),
        ours(RuleOutcome::Fail),
        ours(RuleOutcome::NotExercised)
    );
    for case in cases.iter().filter(|case| case.contradicts_tool()) {
        let _ = writeln!(out, "  {}", escape(&case_line(case)));
    }
}

/// `3.7 name: failed (test tool), pass (rules; pdo-sync-acyclic 1 passed) {851-860}`.
fn case_line(case: &CaseVerdict) -> String {
    let judged = case.judged.iter().filter(|(_, tally)| tally.verdict() != RuleOutcome::NotExercised);
    let judged: Vec<_> = judged
        .map(|(rule, tally)| match tally.failed {
            0 => format!("{rule} {} passed", tally.passed),
            failed => format!("{rule} {} passed, {failed} failed", tally.passed),
        })
        .collect();
    let why = if judged.is_empty() { String::new() } else { format!("; {}", judged.join("; ")) };
    let FrameRange { first, last } = case.frames;
    format!(
        "{:6} {}: {} (test tool), {} (rules{why}) {{{first}-{last}}}{}",
        case.id,
        case.name,
        case.tool.name(),
        case.own_verdict().name(),
        if case.has_begin { "" } else { ", start mark missing" }
    )
}
