//! A run of CiA's conformance test tool: its verdicts beside ours.

use std::fmt::Write as _;

use super::report::Judged;
use crate::event::FrameRange;
use crate::finding::{CaseVerdict, Verdict};
use crate::sink::escape;
use crate::wire::canopen::test_marker::TestResult;
use crate::words::plural;

/// A conformance test that was run: what the tool said, and where ours differs and why.
pub(super) fn write(judged: &Judged, out: &mut String) {
    let cases = &judged.findings.conformance;
    if cases.is_empty() {
        return;
    }
    let tool = |wanted| cases.iter().filter(|case| case.tool == wanted).count();
    let ours = |wanted| cases.iter().filter(|case| case.ours() == wanted).count();
    let _ = writeln!(
        out,
        "conformance test: {}; the tool: {} passed, {}, {} failed, {} skipped; here: {} passed, {} failed, \
         {} not exercised",
        plural(cases.len(), "case"),
        tool(TestResult::Passed),
        plural(tool(TestResult::Warning), "warning"),
        tool(TestResult::Failed),
        tool(TestResult::Skipped),
        ours(Verdict::Pass),
        ours(Verdict::Fail),
        ours(Verdict::NotExercised)
    );
    for case in cases.iter().filter(|case| case.disagrees()) {
        let _ = writeln!(out, "  {}", escape(&line(case)));
    }
}

/// `3.7 failed by the tool, pass here (pdo-sync-acyclic 1 passed): an acyclic TPDO after SYNC {851-860}`.
fn line(case: &CaseVerdict) -> String {
    let judged = case.judged.iter().filter(|(_, tally)| tally.verdict() != Verdict::NotExercised);
    let judged: Vec<_> = judged
        .map(|(rule, tally)| match tally.failed {
            0 => format!("{rule} {} passed", tally.passed),
            failed => format!("{rule} {} passed, {failed} failed", tally.passed),
        })
        .collect();
    let why = if judged.is_empty() { String::new() } else { format!(" ({})", judged.join("; ")) };
    let FrameRange { first, last } = case.frames;
    format!(
        "{:6} {}: {} by the tool, {} here{why} {{{first}-{last}}}{}",
        case.id,
        case.name,
        case.tool.name(),
        case.ours().name(),
        if case.has_begin { "" } else { ", its beginning was not marked" }
    )
}
