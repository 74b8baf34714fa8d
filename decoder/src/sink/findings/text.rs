//! Findings for people: what limits the verdicts first, the worst first, what follows from a finding beneath it,
//! and a summary at the end.

use std::fmt::Write as _;

use super::Judged;
use crate::event::FrameRange;
use crate::finding::{CaseVerdict, Cause, Group, Occurrence, Severity, Verdict};
use crate::frame::Timestamp;
use crate::sink::escape;
use crate::wire::NodeId;
use crate::wire::canopen::test_marker::TestResult;

/// Writes what was judged of one capture.
pub fn write(judged: &Judged, out: &mut String) {
    let findings = &judged.findings;
    let _ = writeln!(out, "== {}", escape(&judged.capture));
    for note in &findings.quality {
        let _ = writeln!(out, "quality: {}", escape(note));
    }
    let mut roots: Vec<&Group> = findings.counting().filter(|group| !is_effect(group, judged)).collect();
    roots.sort_by_key(|group| (std::cmp::Reverse(group.severity), group.id));
    for group in roots {
        write_group(group, judged, 0, out);
    }
    write_conformance(judged, out);
    for said in &findings.suppressions {
        let _ = writeln!(out, "note     {}", escape(said));
    }
    if findings.ungrouped > 0 {
        let _ = writeln!(out, "note     {} further findings found no room", findings.ungrouped);
    }
    write_summary(judged, out);
}

/// Whether it is told beneath another one.
fn is_effect(group: &Group, judged: &Judged) -> bool {
    match &group.cause {
        Some(Cause::Group(id)) => judged.findings.group(*id).is_some_and(Group::counts),
        _ => false,
    }
}

/// Findings within each other that are shown.
const DEEPEST: usize = 4;

fn write_group(group: &Group, judged: &Judged, depth: usize, out: &mut String) {
    let indent = "  ".repeat(depth);
    let who = who(group);
    let about = group.key.about.to_string();
    let about =
        if about.is_empty() || group.text.contains(&about) { String::new() } else { format!("{about}: ") };
    let _ = writeln!(
        out,
        "{indent}{:8} {}{}{}{} [{}]",
        group.severity.name(),
        escape(&who),
        if who.is_empty() { "" } else { "  " },
        escape(&about),
        escape(&group.text),
        group.rule
    );
    let _ = writeln!(out, "{indent}         {}", when(group, judged.first));
    if let Some((_, text, at)) = &group.worst {
        let _ = writeln!(out, "{indent}         worst {}: {}", moment(*at, judged.first), escape(text));
    }
    if let Some(reason) = &group.downgraded {
        let _ = writeln!(out, "{indent}         less severe: {}", escape(reason));
    }
    if depth < DEEPEST {
        for effect in judged.findings.effects(group.id).filter(|effect| effect.counts()) {
            write_group(effect, judged, depth + 1, out);
        }
    }
}

/// `can0 5/05 pump`.
pub(super) fn who(group: &Group) -> String {
    let node = group.key.node.map(NodeId::label);
    let parts = [Some(group.bus.to_string()), node, group.node_name.as_deref().map(str::to_owned)];
    parts.into_iter().flatten().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(" ")
}

/// `at 1.300 s {12-13}`, `312 times from 1.300 s {12} to 9.100 s {500}`.
fn when(group: &Group, zero: Option<Timestamp>) -> String {
    let (began, ended) = (moment(group.began(), zero), moment(group.ended(), zero));
    if group.count == 1 {
        return format!("at {began}");
    }
    format!("{} times from {began} to {ended}", group.count)
}

fn moment(at: Occurrence, zero: Option<Timestamp>) -> String {
    let frames = at.frames;
    let frames = match (frames.first, frames.last) {
        (_, 0) => String::new(),
        (first, last) if first == last => format!("{{{last}}}"),
        (first, last) => format!("{{{first}-{last}}}"),
    };
    match at.time.zip(zero) {
        Some((time, zero)) => {
            let milliseconds = time.since(zero) / 1_000_000;
            format!("{}.{:03} s {frames}", milliseconds / 1_000, (milliseconds % 1_000).abs())
        }
        None => frames,
    }
}

/// A conformance test that was run: what the tool said, and where ours differs and why.
fn write_conformance(judged: &Judged, out: &mut String) {
    let cases = &judged.findings.conformance;
    if cases.is_empty() {
        return;
    }
    let tool = |wanted| cases.iter().filter(|case| case.tool == wanted).count();
    let ours = |wanted| cases.iter().filter(|case| case.ours() == wanted).count();
    let _ = writeln!(
        out,
        "conformance test: {} cases; the tool: {} passed, {} warnings, {} failed, {} skipped; here: {} passed, {} failed, \
         {} not exercised",
        cases.len(),
        tool(TestResult::Passed),
        tool(TestResult::Warning),
        tool(TestResult::Failed),
        tool(TestResult::Skipped),
        ours(Verdict::Pass),
        ours(Verdict::Fail),
        ours(Verdict::NotExercised)
    );
    for case in cases.iter().filter(|case| case.disagrees()) {
        let _ = writeln!(out, "  {}", conformance_line(case));
    }
}

/// `3.7 failed by the tool, pass here (pdo-sync-acyclic 1 passed): an acyclic TPDO after SYNC {851-860}`.
fn conformance_line(case: &CaseVerdict) -> String {
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

fn write_summary(judged: &Judged, out: &mut String) {
    let findings = &judged.findings;
    let count = |severity| findings.number(severity);
    let suppressed = findings.groups.iter().filter(|group| group.suppressed.is_some()).count();
    let verdicts = |wanted| {
        let on = findings.tallies.iter().zip(&findings.rules).filter(|(_, rule)| rule.is_on);
        on.filter(|(tally, _)| tally.verdict() == wanted).count()
    };
    let _ = write!(
        out,
        "{} errors, {} warnings, {} notes",
        count(Severity::Error),
        count(Severity::Warning),
        count(Severity::Note)
    );
    if suppressed > 0 {
        let _ = write!(out, ", {suppressed} suppressed");
    }
    let _ = writeln!(
        out,
        "; {} frames, rules: {} passed, {} failed, {} not exercised",
        judged.frames,
        verdicts(Verdict::Pass),
        verdicts(Verdict::Fail),
        verdicts(Verdict::NotExercised)
    );
}
