//! JSON Lines: one object per finding, one per capture, and a total, with the keys of
//! `docs/check.schema.json`. Times and objects are written as in `decode -f jsonl`.

use std::io::{self, Write};

use super::format::FindingFormat;
use super::report::{CaptureResult, Outcome, Report, Standing};
use crate::event::FrameRange;
use crate::finding::phrase::fact_text;
use crate::finding::{Cause, Group, Occurrence, Severity, SuppressionUse, Tally, Verdict};
use crate::frame::Timestamp;
use crate::query::record::{FieldValue, Fields as _};
use crate::sink::jsonl::object::Object;
use crate::wire::NodeId;

/// Types of JSON values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeyType {
    /// Text.
    Text,
    /// A non-negative integer.
    Count,
    /// A number.
    Number,
    /// Seconds with nine decimal places; null in a capture without timestamps.
    Seconds,
    /// Text or null.
    TextOrNull,
    /// A Boolean.
    Bool,
    /// A list of strings.
    Texts,
    /// First and last frame number.
    Frames,
    /// An object; the following entries are its keys.
    Group,
    /// A list of objects; the following entries are their keys.
    Groups,
}

/// A key of a JSON line.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// Kinds of lines with this key: `finding`, `summary`, `total`.
    pub kinds: &'static [&'static str],
    /// Key name; nested keys as `outer.inner`.
    pub key: &'static str,
    /// Type of the value.
    pub value: KeyType,
    /// Present in every line of these kinds.
    pub is_required: bool,
    /// Description for the schema.
    pub doc: &'static str,
}

const FINDING: &[&str] = &["finding"];
const SUMMARY: &[&str] = &["summary"];
const TOTAL: &[&str] = &["total"];
const CAPTURE: &[&str] = &["finding", "summary"];
const COUNTS: &[&str] = &["summary", "total"];

const fn key(
    kinds: &'static [&'static str],
    key: &'static str,
    value: KeyType,
    is_required: bool,
    doc: &'static str,
) -> Key {
    Key { kinds, key, value, is_required, doc }
}

/// All keys.
pub const KEYS: &[Key] = &[
    key(&["finding", "summary", "total"], "kind", KeyType::Text, true, "finding, summary or total"),
    key(
        CAPTURE,
        "capture",
        KeyType::Text,
        true,
        "Capture, as named on the command line or found in a folder",
    ),
    key(FINDING, "finding", KeyType::Count, true, "Number of the finding within its capture, as in `decode`"),
    key(FINDING, "fingerprint", KeyType::Text, true, "Stable identity: rule, bus, node and subject"),
    key(FINDING, "rule", KeyType::Text, true, "Name of the rule; see `cobscope explain RULE`"),
    key(FINDING, "title", KeyType::Text, true, "Defect, as a short title"),
    key(FINDING, "severity", KeyType::Text, true, "error, warning or note, after any downgrade"),
    key(
        FINDING,
        "standing",
        KeyType::Text,
        true,
        "new; accepted: in the baseline; suppressed: by the bus file; absorbed: covered by the finding that is its \
         cause",
    ),
    key(FINDING, "bus", KeyType::Text, true, "Name of the bus"),
    key(FINDING, "protocol", KeyType::Text, false, "canopen or j1939; determines the meaning of `node`"),
    key(FINDING, "node", KeyType::Count, false, "Node-ID, or J1939 address"),
    key(FINDING, "node_name", KeyType::Text, false, "Name of the node in the bus file"),
    key(FINDING, "about", KeyType::Text, false, "Subject: object, PGN, code, identifier or name"),
    key(FINDING, "text", KeyType::Text, true, "Defect with measured value and limit"),
    key(FINDING, "count", KeyType::Count, true, "Number of occurrences"),
    key(
        FINDING,
        "duration",
        KeyType::Seconds,
        false,
        "Time for which it was present: total of a condition, else first to last",
    ),
    key(FINDING, "lasts", KeyType::Bool, false, "The condition still lasted at the end of the capture"),
    key(FINDING, "next_step", KeyType::Text, false, "Next step that the rule proposes"),
    key(FINDING, "occurrences", KeyType::Groups, true, "The first five and the last five"),
    key(FINDING, "occurrences.t", KeyType::Seconds, true, "Time; null in a capture without timestamps"),
    key(FINDING, "occurrences.frames", KeyType::Frames, true, "First and last frame of the occurrence"),
    key(
        FINDING,
        "occurrences.file",
        KeyType::Text,
        false,
        "File of the last frame, in a capture of several parts",
    ),
    key(
        FINDING,
        "occurrences.line",
        KeyType::Count,
        false,
        "Line of the last frame in `file`, if it is text",
    ),
    key(FINDING, "worst", KeyType::Group, false, "Worst occurrence, if it is not the first"),
    key(FINDING, "worst.measure", KeyType::Number, false, "Deviation, in the unit of the rule"),
    key(FINDING, "worst.text", KeyType::Text, true, "Text of the worst occurrence"),
    key(FINDING, "worst.t", KeyType::Seconds, true, "Time"),
    key(FINDING, "worst.frames", KeyType::Frames, true, "First and last frame"),
    key(FINDING, "worst.file", KeyType::Text, false, "File of the last frame, in a capture of several parts"),
    key(FINDING, "worst.line", KeyType::Count, false, "Line of the last frame in `file`, if it is text"),
    key(
        FINDING,
        "cause_finding",
        KeyType::Count,
        false,
        "Number of the finding that is the cause, in the same capture",
    ),
    key(FINDING, "cause", KeyType::Text, false, "Other cause"),
    key(
        FINDING,
        "member_of",
        KeyType::Count,
        false,
        "Number of the finding that text output prints for this one: the same fault with another subject",
    ),
    key(FINDING, "downgraded", KeyType::Text, false, "Reason for a severity lower than the rule's"),
    key(FINDING, "manual", KeyType::Text, false, "Manual and section of a finding about a device"),
    key(FINDING, "suppressed", KeyType::Text, false, "Reason for the suppression, from the bus file"),
    key(SUMMARY, "frames", KeyType::Count, true, "Frames read, over all parts"),
    key(SUMMARY, "parts", KeyType::Groups, false, "Files of a capture of several parts, in order"),
    key(SUMMARY, "parts.file", KeyType::Text, true, "Name of the file"),
    key(SUMMARY, "parts.first_frame", KeyType::Count, true, "Number of its first frame"),
    key(SUMMARY, "verdict", KeyType::Text, true, "pass, fail or unreadable"),
    key(SUMMARY, "failure", KeyType::Text, false, "Reason why the capture was not read, or not to its end"),
    key(TOTAL, "captures", KeyType::Count, true, "Captures checked"),
    key(TOTAL, "failed", KeyType::Count, true, "Captures that fail"),
    key(TOTAL, "unreadable", KeyType::Count, true, "Captures not read, or not to their end"),
    key(
        COUNTS,
        "errors",
        KeyType::Count,
        true,
        "New findings that are errors, without those with `member_of`",
    ),
    key(
        COUNTS,
        "warnings",
        KeyType::Count,
        true,
        "New findings that are warnings, without those with `member_of`",
    ),
    key(COUNTS, "notes", KeyType::Count, true, "New findings that are notes, without those with `member_of`"),
    key(COUNTS, "accepted", KeyType::Count, true, "Findings that are in the baseline"),
    key(COUNTS, "suppressed", KeyType::Count, true, "Findings suppressed by the bus file"),
    key(SUMMARY, "ungrouped", KeyType::Count, true, "Further occurrences not recorded (limit reached)"),
    key(SUMMARY, "quality", KeyType::Texts, true, "Properties of the capture that limit the verdicts"),
    key(SUMMARY, "gone", KeyType::Texts, true, "Fingerprints in the baseline that did not occur"),
    key(SUMMARY, "silent", KeyType::Texts, true, "Rules exercised in the baseline but not in this run"),
    key(SUMMARY, "rules", KeyType::Groups, true, "Active rules"),
    key(SUMMARY, "rules.rule", KeyType::Text, true, "Name"),
    key(SUMMARY, "rules.verdict", KeyType::Text, true, "pass, fail or not-exercised"),
    key(SUMMARY, "rules.passed", KeyType::Count, true, "Number of checks that passed"),
    key(SUMMARY, "rules.failed", KeyType::Count, true, "Number of checks that failed"),
    key(SUMMARY, "rules.waived", KeyType::Count, true, "Number of failures waived by the device manual"),
    key(SUMMARY, "rules.needs", KeyType::Text, false, "Not exercised: what the capture does not contain"),
    key(SUMMARY, "cases", KeyType::Groups, true, "Cases of the CiA conformance test plan covered by rules"),
    key(SUMMARY, "cases.case", KeyType::Text, true, "Number of the case"),
    key(SUMMARY, "cases.verdict", KeyType::Text, true, "pass, fail or not-exercised"),
    key(SUMMARY, "cases.passed", KeyType::Count, true, "Number of checks that passed"),
    key(SUMMARY, "cases.failed", KeyType::Count, true, "Number of checks that failed"),
    key(SUMMARY, "cases.waived", KeyType::Count, true, "Number of failures waived by the device manual"),
    key(
        SUMMARY,
        "conformance",
        KeyType::Groups,
        true,
        "Cases of a conformance test that the capture contains",
    ),
    key(SUMMARY, "conformance.case", KeyType::Text, true, "Number of the case"),
    key(
        SUMMARY,
        "conformance.name",
        KeyType::Text,
        true,
        "Subject of the case; empty for a case unknown to the test plan",
    ),
    key(SUMMARY, "conformance.tool", KeyType::Text, true, "Verdict of the test tool"),
    key(
        SUMMARY,
        "conformance.verdict",
        KeyType::Text,
        true,
        "Verdict of the rules: pass, fail or not-exercised",
    ),
    key(SUMMARY, "conformance.frames", KeyType::Frames, true, "Frames of the first and last mark"),
    key(COUNTS, "suppressions", KeyType::Groups, true, "Suppressions in the bus file"),
    key(COUNTS, "suppressions.what", KeyType::Text, true, "Rule and node covered"),
    key(COUNTS, "suppressions.reason", KeyType::Text, true, "Reason"),
    key(COUNTS, "suppressions.met", KeyType::Count, true, "Findings covered, in the capture or in total"),
    key(COUNTS, "suppressions.ended", KeyType::TextOrNull, true, "Expiry date, if it has passed"),
    key(TOTAL, "missing", KeyType::Texts, true, "Required rules that were not exercised in any capture"),
    key(
        TOTAL,
        "absent",
        KeyType::Texts,
        true,
        "Captures of the baseline that were not checked; the check fails",
    ),
    key(TOTAL, "fails", KeyType::Bool, true, "Whether the check fails (exit status 1)"),
];

pub(super) const FORMAT: FindingFormat = FindingFormat {
    name: "jsonl",
    help: "One JSON object per finding and per capture, and a total (docs/check.schema.json)",
    mark: "{\"kind\":\"total\",",
    has_lines: false,
    write: |report, _, out| write(report, out),
};

/// Writes all captures line by line, because the text of thousands of findings needs more memory than the
/// findings.
fn write(report: &Report, out: &mut dyn Write) -> io::Result<()> {
    let mut line = Vec::new();
    for judged in &report.captures {
        for group in &judged.findings.groups {
            finding(group, judged, &mut line);
            out.write_all(&line)?;
            line.clear();
        }
        summary(judged, report, &mut line);
        out.write_all(&line)?;
        line.clear();
    }
    total(report, &mut line);
    out.write_all(&line)
}

/// Appends the line of a finding.
pub(in crate::sink) fn finding(group: &Group, judged: &CaptureResult, lines: &mut Vec<u8>) {
    let mut line = Object::begin(lines);
    line.field("kind", FieldValue::Text("finding"));
    line.field("capture", FieldValue::Text(&judged.capture));
    line.field("finding", FieldValue::Unsigned(group.id));
    line.field("fingerprint", FieldValue::Text(&group.fingerprint()));
    line.field("rule", FieldValue::Text(&group.rule));
    let rule = judged.findings.rules.get(usize::from(group.key.rule));
    line.field("title", FieldValue::Text(rule.map_or("", |rule| &rule.title)));
    line.field("severity", FieldValue::Text(group.severity.name()));
    line.field("standing", FieldValue::Text(judged.standing(group).name()));
    line.field("bus", FieldValue::Text(&group.bus));
    if let Some(node) = group.key.node {
        let protocol = if matches!(node, NodeId::Canopen(_)) { "canopen" } else { "j1939" };
        line.field("protocol", FieldValue::Text(protocol));
        line.field("node", FieldValue::Unsigned(u64::from(node.number())));
    }
    let about = group.key.about.to_string();
    optional(&mut line, "node_name", group.node_name.as_deref());
    optional(&mut line, "about", Some(about.as_str()).filter(|about| !about.is_empty()));
    line.field("text", FieldValue::Text(&group.text));
    line.field("count", FieldValue::Unsigned(group.count));
    if let Some(duration) = group.duration() {
        line.field("duration", FieldValue::Seconds(duration));
    }
    if group.lasts_to_end {
        line.field("lasts", FieldValue::Bool(true));
    }
    optional(&mut line, "next_step", group.next_step.as_deref());
    line.open_list("occurrences");
    for at in group.first.iter().chain(&group.last) {
        line.open("");
        occurrence(&mut line, *at, judged);
        line.close();
    }
    line.close_list();
    if let Some((measure, text, at)) = &group.worst {
        line.open("worst");
        // A message that never arrived has no measure.
        if *measure < f64::MAX {
            line.field("measure", FieldValue::Real(*measure));
        }
        line.field("text", FieldValue::Text(text));
        occurrence(&mut line, *at, judged);
        line.close();
    }
    match &group.cause {
        Some(Cause::Group(id)) => line.field("cause_finding", FieldValue::Unsigned(*id)),
        Some(Cause::Quality(text)) => line.field("cause", FieldValue::Text(text)),
        Some(Cause::Fact(fact)) => line.field("cause", FieldValue::Text(&fact_text(fact))),
        None => {}
    }
    if let Some(id) = group.member_of {
        line.field("member_of", FieldValue::Unsigned(id));
    }
    optional(&mut line, "downgraded", group.downgraded.as_deref());
    optional(&mut line, "manual", group.manual.as_deref());
    optional(&mut line, "suppressed", group.suppressed.as_deref());
    line.end();
}

fn optional(line: &mut Object<'_>, key: &'static str, text: Option<&str>) {
    if let Some(text) = text {
        line.field(key, FieldValue::Text(text));
    }
}

fn occurrence(line: &mut Object<'_>, at: Occurrence, judged: &CaptureResult) {
    line.field("t", at.time.map_or(FieldValue::Null, |Timestamp(time)| FieldValue::Seconds(time)));
    frames(line, at.frames);
    if let Some((_, file)) = judged.part_of(at.frames.last) {
        line.field("file", FieldValue::Text(file));
        if let Some(number) = judged.line(at) {
            line.field("line", FieldValue::Unsigned(number));
        }
    }
}

fn frames(line: &mut Object<'_>, frames: FrameRange) {
    line.open_list("frames");
    line.field("", FieldValue::Unsigned(frames.first));
    line.field("", FieldValue::Unsigned(frames.last));
    line.close_list();
}

fn summary(judged: &CaptureResult, report: &Report, lines: &mut Vec<u8>) {
    let findings = &judged.findings;
    let mut line = Object::begin(lines);
    line.field("kind", FieldValue::Text("summary"));
    line.field("capture", FieldValue::Text(&judged.capture));
    line.field("frames", FieldValue::Unsigned(judged.frames));
    if !judged.parts.is_empty() {
        line.open_list("parts");
        for part in &judged.parts {
            line.open("");
            line.field("file", FieldValue::Text(&part.file));
            line.field("first_frame", FieldValue::Unsigned(part.first_frame));
            line.close();
        }
        line.close_list();
    }
    line.field("verdict", FieldValue::Text(judged.outcome(report.least).name()));
    optional(&mut line, "failure", judged.failure.as_deref());
    counts(&mut line, std::slice::from_ref(judged));
    line.field("ungrouped", FieldValue::Unsigned(findings.ungrouped));
    texts(&mut line, "quality", findings.quality.iter());
    texts(&mut line, "gone", judged.comparison.gone.iter().map(|known| &known.fingerprint));
    texts(&mut line, "silent", judged.comparison.silent.iter());
    line.open_list("rules");
    for (rule, tally) in judged.rules() {
        let needs = (tally.verdict() == Verdict::NotExercised).then_some(&*rule.needs);
        tallied(&mut line, ("rule", &rule.name), tally, needs);
    }
    line.close_list();
    line.open_list("cases");
    for (case, tally) in &findings.cases {
        tallied(&mut line, ("case", case), *tally, None);
    }
    line.close_list();
    line.open_list("conformance");
    for case in &findings.conformance {
        line.open("");
        line.field("case", FieldValue::Text(&case.id));
        line.field("name", FieldValue::Text(&case.name));
        line.field("tool", FieldValue::Text(case.tool.name()));
        line.field("verdict", FieldValue::Text(case.ours().name()));
        frames(&mut line, case.frames);
        line.close();
    }
    line.close_list();
    suppressions(&mut line, &findings.suppressions);
    line.end();
}

fn suppressions(line: &mut Object<'_>, all: &[SuppressionUse]) {
    line.open_list("suppressions");
    for one in all {
        line.open("");
        line.field("what", FieldValue::Text(&one.what));
        line.field("reason", FieldValue::Text(&one.reason));
        line.field("met", FieldValue::Unsigned(one.met as u64));
        line.field("ended", one.ended.as_deref().map_or(FieldValue::Null, FieldValue::Text));
        line.close();
    }
    line.close_list();
}

fn total(report: &Report, lines: &mut Vec<u8>) {
    let of = |wanted| report.captures.iter().filter(|one| one.outcome(report.least) == wanted).count();
    let mut line = Object::begin(lines);
    line.field("kind", FieldValue::Text("total"));
    line.field("captures", FieldValue::Unsigned(report.captures.len() as u64));
    line.field("failed", FieldValue::Unsigned(of(Outcome::Failed) as u64));
    line.field("unreadable", FieldValue::Unsigned(of(Outcome::Unreadable) as u64));
    counts(&mut line, &report.captures);
    texts(&mut line, "missing", report.missing.iter());
    texts(&mut line, "absent", report.absent.iter());
    suppressions(&mut line, &report.suppressions());
    line.field("fails", FieldValue::Bool(report.fails()));
    line.end();
}

fn counts(line: &mut Object<'_>, captures: &[CaptureResult]) {
    let severities =
        [("errors", Severity::Error), ("warnings", Severity::Warning), ("notes", Severity::Note)];
    for (key, severity) in severities {
        let count: usize = captures.iter().map(|judged| judged.number(severity)).sum();
        line.field(key, FieldValue::Unsigned(count as u64));
    }
    for standing in [Standing::Accepted, Standing::Suppressed] {
        let count: usize = captures.iter().map(|judged| judged.number_of(standing)).sum();
        line.field(standing.name(), FieldValue::Unsigned(count as u64));
    }
}

fn texts<'a>(line: &mut Object<'_>, key: &'static str, texts: impl Iterator<Item = &'a String>) {
    line.open_list(key);
    for text in texts {
        line.field("", FieldValue::Text(text));
    }
    line.close_list();
}

fn tallied(line: &mut Object<'_>, (key, name): (&'static str, &str), tally: Tally, needs: Option<&str>) {
    line.open("");
    line.field(key, FieldValue::Text(name));
    line.field("verdict", FieldValue::Text(tally.verdict().name()));
    line.field("passed", FieldValue::Unsigned(tally.passed));
    line.field("failed", FieldValue::Unsigned(tally.failed));
    line.field("waived", FieldValue::Unsigned(tally.waived));
    optional(line, "needs", needs);
    line.close();
}
