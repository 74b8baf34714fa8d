//! JSON Lines: an object a finding, then one a capture, and a total; keys as `docs/check.schema.json` describes
//! them. Times and objects are written as in `decode -f jsonl`.

use std::io::{self, Write};

use super::format::FindingFormat;
use super::report::{Judged, Outcome, Report, Standing};
use crate::event::FrameRange;
use crate::finding::{Cause, Group, Occurrence, Severity, SuppressionUse, Tally};
use crate::frame::Timestamp;
use crate::query::record::{FieldValue, Fields as _};
use crate::sink::jsonl::object::Object;
use crate::wire::NodeId;

/// Types of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeyType {
    /// Text.
    Text,
    /// A number from 0.
    Count,
    /// A number.
    Number,
    /// Seconds with nine digits; null in a capture without times.
    Seconds,
    /// Text or null.
    TextOrNull,
    /// True or false.
    Bool,
    /// A list of texts.
    Texts,
    /// First and last frame.
    Frames,
    /// An object whose keys follow.
    Group,
    /// A list of such objects.
    Groups,
}

/// A key of a line.
#[derive(Debug, Clone, Copy)]
pub struct Key {
    /// Kinds of lines that have it: `finding`, `summary`, `total`.
    pub kinds: &'static [&'static str],
    /// Its name, nested ones behind a dot.
    pub key: &'static str,
    /// What it holds.
    pub value: KeyType,
    /// Every such line has it.
    pub is_required: bool,
    /// What it says.
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
    key(
        FINDING,
        "fingerprint",
        KeyType::Text,
        true,
        "The same in every run: rule, bus, node and what it is about",
    ),
    key(FINDING, "rule", KeyType::Text, true, "Name of the rule; `cobscope explain RULE` tells more"),
    key(FINDING, "title", KeyType::Text, true, "The defect in a line"),
    key(FINDING, "severity", KeyType::Text, true, "error, warning or note, after what lowers it"),
    key(
        FINDING,
        "standing",
        KeyType::Text,
        true,
        "new: it stands for itself; accepted: the baseline has it; suppressed: by the bus file; absorbed: the finding \
         that explains it says the same",
    ),
    key(FINDING, "bus", KeyType::Text, true, "Name of the bus"),
    key(FINDING, "protocol", KeyType::Text, false, "canopen or j1939: what kind of number `node` is"),
    key(FINDING, "node", KeyType::Count, false, "Node-ID, or J1939 address"),
    key(FINDING, "node_name", KeyType::Text, false, "The user's name of the node"),
    key(FINDING, "about", KeyType::Text, false, "Object, PGN, code, identifier or name it is about"),
    key(FINDING, "text", KeyType::Text, true, "What is wrong"),
    key(FINDING, "count", KeyType::Count, true, "Times it was seen"),
    key(FINDING, "occurrences", KeyType::Groups, true, "The first five and the last five"),
    key(FINDING, "occurrences.t", KeyType::Seconds, true, "When; null in a capture without times"),
    key(FINDING, "occurrences.frames", KeyType::Frames, true, "First and last frame that show it"),
    key(FINDING, "worst", KeyType::Group, false, "The worst, where that is not the first"),
    key(FINDING, "worst.measure", KeyType::Number, false, "How far it is off, in the unit of the rule"),
    key(FINDING, "worst.text", KeyType::Text, true, "What was wrong then"),
    key(FINDING, "worst.t", KeyType::Seconds, true, "When"),
    key(FINDING, "worst.frames", KeyType::Frames, true, "First and last frame"),
    key(FINDING, "cause_finding", KeyType::Count, false, "Finding of the same capture that explains it"),
    key(FINDING, "cause", KeyType::Text, false, "What else explains it"),
    key(FINDING, "downgraded", KeyType::Text, false, "Why it is less severe than its rule says"),
    key(FINDING, "suppressed", KeyType::Text, false, "The bus file's reason why it does not count"),
    key(SUMMARY, "frames", KeyType::Count, true, "Frames read"),
    key(SUMMARY, "verdict", KeyType::Text, true, "pass, fail or unreadable"),
    key(SUMMARY, "failure", KeyType::Text, false, "Why it could not be read, or not to its end"),
    key(TOTAL, "captures", KeyType::Count, true, "Captures judged"),
    key(TOTAL, "failed", KeyType::Count, true, "Captures that fail"),
    key(TOTAL, "unreadable", KeyType::Count, true, "Captures that could not be read, or not to their end"),
    key(COUNTS, "errors", KeyType::Count, true, "New findings that are errors"),
    key(COUNTS, "warnings", KeyType::Count, true, "New findings that are warnings"),
    key(COUNTS, "notes", KeyType::Count, true, "New findings that are notes"),
    key(COUNTS, "accepted", KeyType::Count, true, "Findings the baseline has"),
    key(COUNTS, "suppressed", KeyType::Count, true, "Findings the bus file suppresses"),
    key(SUMMARY, "ungrouped", KeyType::Count, true, "Further times something was wrong that found no room"),
    key(SUMMARY, "quality", KeyType::Texts, true, "What limits the verdicts"),
    key(SUMMARY, "gone", KeyType::Texts, true, "Fingerprints the baseline has that did not come again"),
    key(SUMMARY, "silent", KeyType::Texts, true, "Rules the baseline has exercised that are not any more"),
    key(SUMMARY, "rules", KeyType::Groups, true, "Rules in use"),
    key(SUMMARY, "rules.rule", KeyType::Text, true, "Name"),
    key(SUMMARY, "rules.verdict", KeyType::Text, true, "pass, fail or not-exercised"),
    key(SUMMARY, "rules.passed", KeyType::Count, true, "Times nothing was wrong"),
    key(SUMMARY, "rules.failed", KeyType::Count, true, "Times something was"),
    key(SUMMARY, "rules.waived", KeyType::Count, true, "Times the device's manual excuses it"),
    key(SUMMARY, "cases", KeyType::Groups, true, "Cases of CiA's conformance test plan that rules judge"),
    key(SUMMARY, "cases.case", KeyType::Text, true, "Number of the case"),
    key(SUMMARY, "cases.verdict", KeyType::Text, true, "pass, fail or not-exercised"),
    key(SUMMARY, "cases.passed", KeyType::Count, true, "Times nothing was wrong"),
    key(SUMMARY, "cases.failed", KeyType::Count, true, "Times something was"),
    key(SUMMARY, "cases.waived", KeyType::Count, true, "Times the device's manual excuses it"),
    key(
        SUMMARY,
        "conformance",
        KeyType::Groups,
        true,
        "Cases of a conformance test that was run in the capture",
    ),
    key(SUMMARY, "conformance.case", KeyType::Text, true, "Number of the case"),
    key(
        SUMMARY,
        "conformance.name",
        KeyType::Text,
        true,
        "Its subject; empty for a case the plan does not have",
    ),
    key(SUMMARY, "conformance.tool", KeyType::Text, true, "The test tool's verdict"),
    key(
        SUMMARY,
        "conformance.verdict",
        KeyType::Text,
        true,
        "That of the rules here: pass, fail or not-exercised",
    ),
    key(SUMMARY, "conformance.frames", KeyType::Frames, true, "From its first mark to its last"),
    key(COUNTS, "suppressions", KeyType::Groups, true, "Suppressions of the bus file"),
    key(COUNTS, "suppressions.what", KeyType::Text, true, "What it covers"),
    key(COUNTS, "suppressions.reason", KeyType::Text, true, "The user's reason"),
    key(
        COUNTS,
        "suppressions.met",
        KeyType::Count,
        true,
        "Findings it covers: of the capture, in the total of all",
    ),
    key(COUNTS, "suppressions.ended", KeyType::TextOrNull, true, "The day it ran out"),
    key(TOTAL, "missing", KeyType::Texts, true, "Rules that had to be exercised, and were in no capture"),
    key(TOTAL, "absent", KeyType::Texts, true, "Captures of the baseline that were not judged, which fails"),
    key(TOTAL, "fails", KeyType::Bool, true, "Whether the exit status says that something is wrong"),
];

pub(super) const FORMAT: FindingFormat = FindingFormat {
    name: "jsonl",
    help: "One JSON object a finding and a capture, and a total (docs/check.schema.json)",
    has_lines: false,
    write: |report, _, out| write(report, out),
};

/// Writes all captures, a line at a time: of thousands of findings the text is larger than what is kept of them.
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

fn finding(group: &Group, judged: &Judged, lines: &mut Vec<u8>) {
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
    line.open_list("occurrences");
    for at in group.first.iter().chain(&group.last) {
        line.open("");
        occurrence(&mut line, *at);
        line.close();
    }
    line.close_list();
    if let Some((measure, text, at)) = &group.worst {
        line.open("worst");
        // What never came has no measure.
        if *measure < f64::MAX {
            line.field("measure", FieldValue::Real(*measure));
        }
        line.field("text", FieldValue::Text(text));
        occurrence(&mut line, *at);
        line.close();
    }
    match &group.cause {
        Some(Cause::Group(id)) => line.field("cause_finding", FieldValue::Unsigned(*id)),
        Some(Cause::Quality(text)) => line.field("cause", FieldValue::Text(text)),
        None => {}
    }
    optional(&mut line, "downgraded", group.downgraded.as_deref());
    optional(&mut line, "suppressed", group.suppressed.as_deref());
    line.end();
}

fn optional(line: &mut Object<'_>, key: &'static str, text: Option<&str>) {
    if let Some(text) = text {
        line.field(key, FieldValue::Text(text));
    }
}

fn occurrence(line: &mut Object<'_>, at: Occurrence) {
    line.field("t", at.time.map_or(FieldValue::Null, |Timestamp(time)| FieldValue::Seconds(time)));
    frames(line, at.frames);
}

fn frames(line: &mut Object<'_>, frames: FrameRange) {
    line.open_list("frames");
    line.field("", FieldValue::Unsigned(frames.first));
    line.field("", FieldValue::Unsigned(frames.last));
    line.close_list();
}

fn summary(judged: &Judged, report: &Report, lines: &mut Vec<u8>) {
    let findings = &judged.findings;
    let mut line = Object::begin(lines);
    line.field("kind", FieldValue::Text("summary"));
    line.field("capture", FieldValue::Text(&judged.capture));
    line.field("frames", FieldValue::Unsigned(judged.frames));
    line.field("verdict", FieldValue::Text(judged.outcome(report.least).name()));
    optional(&mut line, "failure", judged.failure.as_deref());
    counts(&mut line, std::slice::from_ref(judged));
    line.field("ungrouped", FieldValue::Unsigned(findings.ungrouped));
    texts(&mut line, "quality", findings.quality.iter());
    texts(&mut line, "gone", judged.comparison.gone.iter().map(|known| &known.fingerprint));
    texts(&mut line, "silent", judged.comparison.silent.iter());
    line.open_list("rules");
    for (rule, tally) in judged.rules() {
        tallied(&mut line, "rule", &rule.name, tally);
    }
    line.close_list();
    line.open_list("cases");
    for (case, tally) in &findings.cases {
        tallied(&mut line, "case", case, *tally);
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

fn counts(line: &mut Object<'_>, captures: &[Judged]) {
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

fn tallied(line: &mut Object<'_>, key: &'static str, name: &str, tally: Tally) {
    line.open("");
    line.field(key, FieldValue::Text(name));
    line.field("verdict", FieldValue::Text(tally.verdict().name()));
    line.field("passed", FieldValue::Unsigned(tally.passed));
    line.field("failed", FieldValue::Unsigned(tally.failed));
    line.field("waived", FieldValue::Unsigned(tally.waived));
    line.close();
}
