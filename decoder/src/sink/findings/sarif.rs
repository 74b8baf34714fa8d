//! SARIF 2.1.0 (OASIS): one run over all captures, for code scanning and editors.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;
use serde_json::{Value, json};

use super::baseline::portable_name;
use super::format::{FindingFormat, write_at_once};
use super::report::{
    ABSENT, CaptureOutcome, CaptureResult, FindingStanding, FindingsReport, MISSING, NOTHING_CHECKED, SILENT,
};
use crate::escape::{escape, escape_json};
use crate::finding::phrase::{finding_sentence, node_phrase, subject_phrase};
use crate::finding::{FindingGroup, Occurrence, RuleInfo, RuleOrigin, Severity, SuppressionUse};
use crate::rules::format_manual;

/// Page of the program, shown next to its results.
const INFORMATION: &str = "https://crates.io/crates/cobscope";

/// URL of the schema.
const SCHEMA: &str =
    "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json";

/// Names of the fingerprint: our own name, and the name that GitHub uses. Without it, GitHub hashes the line,
/// which contains a timestamp and therefore differs in each capture.
const FINGERPRINTS: [&str; 2] = ["cobscopeGroup/v1", "primaryLocationLineHash"];

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct SarifLog {
    #[serde(rename = "$schema")]
    schema: &'static str,
    version: &'static str,
    runs: [SarifRun; 1],
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct SarifRun {
    tool: Value,
    invocations: [Value; 1],
    artifacts: Vec<Value>,
    column_kind: &'static str,
    results: Vec<SarifResult>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct SarifResult {
    rule_id: String,
    rule_index: usize,
    level: &'static str,
    message: Value,
    locations: [Value; 1],
    #[serde(skip_serializing_if = "Vec::is_empty")]
    related_locations: Vec<Value>,
    partial_fingerprints: Value,
    #[serde(skip_serializing_if = "Option::is_none")]
    baseline_state: Option<&'static str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    suppressions: Vec<Value>,
    properties: Value,
}

pub(super) const FORMAT: FindingFormat = FindingFormat {
    name: "sarif",
    help: "SARIF 2.1.0 for code scanning",
    mark: "\"name\": \"cobscope\"",
    has_lines: true,
    write: |report, _, out| write_at_once(out, |text| write_sarif(report, text)),
};

/// Writes all captures.
fn write_sarif(report: &FindingsReport, out: &mut String) {
    let coverage = report.rule_coverage();
    let places: BTreeMap<&str, usize> =
        coverage.iter().enumerate().map(|(place, one)| (&*one.rule.name, place)).collect();
    let rules: Vec<_> = coverage.iter().map(|one| sarif_rule(one.rule)).collect();
    let artifacts =
        report.captures.iter().flat_map(capture_files).map(|file| json!({"location": {"uri": to_uri(file)}}));
    let mut results = Vec::new();
    for (place, judged) in with_places(report) {
        for group in &judged.findings.groups {
            let standing = judged.standing_of(group);
            if standing != FindingStanding::Absorbed
                && let Some(rule_index) = places.get(&*group.rule)
            {
                results.push(sarif_result(group, judged, (place, *rule_index), report.has_baseline));
            }
        }
    }
    let log = SarifLog {
        schema: SCHEMA,
        version: "2.1.0",
        runs: [SarifRun {
            tool: json!({"driver": {
                "name": "cobscope",
                "informationUri": INFORMATION,
                "version": env!("CARGO_PKG_VERSION"),
                "semanticVersion": env!("CARGO_PKG_VERSION"),
                "rules": rules,
            }}),
            invocations: [sarif_invocation(report)],
            artifacts: artifacts.collect(),
            column_kind: "unicodeCodePoints",
            results,
        }],
    };
    out.push_str(&escape_json(&serde_json::to_string_pretty(&log).unwrap_or_default()));
    out.push('\n');
}

/// SARIF description of a rule.
fn sarif_rule(rule: &RuleInfo) -> Value {
    let markdown = format_manual(&rule.explanation);
    let text = markdown.lines().map(|line| line.trim_start_matches("# ")).collect::<Vec<_>>().join("\n");
    let mut tags = vec![rule.origin.name().to_owned()];
    tags.extend(rule.cases.iter().map(|case| format!("ctt-{case}")));
    if rule.is_timing {
        tags.push("timing".into());
    }
    let title = title_sentence(&rule.title);
    let (text, markdown) = if text.is_empty() { (title.clone(), title.clone()) } else { (text, markdown) };
    json!({
        "id": *rule.name,
        "shortDescription": {"text": title},
        "fullDescription": {"text": title},
        "help": {"text": text, "markdown": markdown},
        "defaultConfiguration": {"level": sarif_level(rule.severity), "enabled": rule.is_on},
        "properties": {
            "tags": tags,
            "precision": if rule.origin == RuleOrigin::General { "high" } else { "very-high" },
            "problem.severity": github_severity(rule.severity),
        },
    })
}

/// Capture quality, unreadable captures, and unused entries of the bus file.
fn sarif_invocation(report: &FindingsReport) -> Value {
    let mut notifications = Vec::new();
    for (place, judged) in with_places(report) {
        let location =
            || json!([{"physicalLocation": {"artifactLocation": sarif_artifact(judged, place, 0)}}]);
        let is_unchecked = judged.overall_outcome(report.least) == CaptureOutcome::Unchecked;
        let unchecked = is_unchecked.then(|| NOTHING_CHECKED.to_owned());
        for note in unchecked.iter().chain(&judged.findings.quality) {
            let text = escape(note).into_owned();
            notifications
                .push(json!({"level": "warning", "message": {"text": text}, "locations": location()}));
        }
        for rule in &judged.comparison.silent {
            let text = format!("{rule} is {SILENT}");
            notifications
                .push(json!({"level": "error", "message": {"text": escape(&text)}, "locations": location()}));
        }
        for known in &judged.comparison.gone {
            let text = escape(&format!("gone: {}", known.known_line())).into_owned();
            notifications.push(json!({"level": "note", "message": {"text": text}, "locations": location()}));
        }
        if let Some(failure) = &judged.failure {
            let text = escape(failure).into_owned();
            notifications.push(json!({"level": "error", "message": {"text": text}, "locations": location()}));
        }
    }
    for rule in &report.missing {
        let text = format!("{rule} {MISSING}");
        notifications.push(json!({"level": "error", "message": {"text": escape(&text)}}));
    }
    for capture in &report.absent {
        let text = format!("{capture}: {ABSENT}");
        notifications.push(json!({"level": "error", "message": {"text": escape(&text)}}));
    }
    for complaint in report.suppressions().iter().filter_map(SuppressionUse::review_reason) {
        notifications.push(json!({"level": "note", "message": {"text": escape(&complaint)}}));
    }
    let is_complete = report.captures.iter().all(|judged| judged.failure.is_none());
    json!({"executionSuccessful": is_complete, "toolExecutionNotifications": notifications})
}

fn sarif_result(
    group: &FindingGroup,
    judged: &CaptureResult,
    (place, rule_index): (usize, usize),
    has_baseline: bool,
) -> SarifResult {
    let standing = judged.standing_of(group);
    let lines = [format!("{}  {}", node_phrase(group), finding_sentence(group))]
        .into_iter()
        .chain(judged.finding_notes(group));
    let text = lines.map(|line| escape(&line).into_owned()).collect::<Vec<_>>().join("\n");
    let mut related = Vec::new();
    if let Some((_, text, at)) = &group.worst {
        related.push(sarif_location(group, judged, place, *at, Some(&format!("worst: {text}"))));
    }
    for cause in judged.findings.causes_of(group) {
        let text = format!("follows from: {}", subject_phrase(cause));
        related.push(sarif_location(cause, judged, place, cause.first_occurrence(), Some(&text)));
    }
    let reason = group.suppressed.as_deref();
    let suppressions =
        reason.map(|reason| json!({"kind": "external", "justification": escape(reason).into_owned()}));
    let state = if standing == FindingStanding::Accepted { "unchanged" } else { "new" };
    SarifResult {
        rule_id: group.rule.to_string(),
        rule_index,
        level: sarif_level(group.severity),
        message: json!({"text": text}),
        locations: [sarif_location(group, judged, place, group.first_occurrence(), None)],
        related_locations: related,
        partial_fingerprints: FINGERPRINTS
            .map(|name| (name, escape(&group.fingerprint()).into_owned()))
            .into_iter()
            .collect(),
        baseline_state: has_baseline.then_some(state),
        suppressions: suppressions.into_iter().collect(),
        properties: json!({"count": group.count, "standing": standing.name()}),
    }
}

/// Location of an occurrence: the frames, and the line for text captures.
fn sarif_location(
    group: &FindingGroup,
    judged: &CaptureResult,
    place: usize,
    at: Occurrence,
    text: Option<&str>,
) -> Value {
    let artifact = sarif_artifact(judged, place, at.frames.last);
    let physical = match judged.line_of(at) {
        Some(line) => json!({"artifactLocation": artifact, "region": {"startLine": line}}),
        None => json!({"artifactLocation": artifact}),
    };
    let frames = if at.frames.first == at.frames.last {
        format!("frame {}", at.frames.last)
    } else {
        format!("frames {}-{}", at.frames.first, at.frames.last)
    };
    let name = escape(&node_phrase(group)).into_owned();
    let logical =
        json!([{"name": frames, "fullyQualifiedName": format!("{name} {frames}"), "kind": "frame"}]);
    match text {
        Some(text) => json!({
            "physicalLocation": physical,
            "logicalLocations": logical,
            "message": {"text": escape(text)},
        }),
        None => json!({"physicalLocation": physical, "logicalLocations": logical}),
    }
}

/// File with a frame; `place` is the index of the first file of the capture.
fn sarif_artifact(judged: &CaptureResult, place: usize, frame: u64) -> Value {
    let (part, file) = judged.part_of(frame).unwrap_or((0, &judged.capture));
    json!({"uri": to_uri(file), "index": place + part})
}

/// Files of a capture: its parts, or itself.
fn capture_files(judged: &CaptureResult) -> Vec<&str> {
    if judged.parts.is_empty() {
        return vec![&judged.capture];
    }
    judged.parts.iter().map(|part| part.file.as_str()).collect()
}

/// Captures, each with the index of its first file.
fn with_places(report: &FindingsReport) -> impl Iterator<Item = (usize, &CaptureResult)> {
    report.captures.iter().scan(0, |next, judged| {
        let place = *next;
        *next += capture_files(judged).len();
        Some((place, judged))
    })
}

const fn sarif_level(severity: Severity) -> &'static str {
    severity.name()
}

/// GitHub's severity name.
const fn github_severity(severity: Severity) -> &'static str {
    match severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
        Severity::Note => "recommendation",
    }
}

/// The title as a sentence, capitalised and with a full stop.
fn title_sentence(title: &str) -> String {
    let mut letters = title.chars();
    let first = letters.next().map(|letter| letter.to_uppercase().to_string());
    format!("{}{}.", first.unwrap_or_default(), letters.as_str())
}

/// A path as a URI reference (RFC 3986): relative paths stay relative, special bytes are percent-encoded.
fn to_uri(capture: &str) -> String {
    uri_reference(&portable_name(capture), cfg!(windows))
}

fn uri_reference(path: &str, is_windows: bool) -> String {
    let (mut uri, rest) = match path.as_bytes() {
        // RFC 8089: a share is a path of its server, and a drive keeps its colon.
        [b'/', b'/', ..] if is_windows => ("file:".to_owned(), path),
        [drive @ (b'A'..=b'Z' | b'a'..=b'z'), b':', b'/', ..] if is_windows => {
            (format!("file:///{}:", char::from(*drive)), path.get(2..).unwrap_or_default())
        }
        [b'/', ..] => ("file://".to_owned(), path),
        _ => (String::new(), path),
    };
    for byte in rest.bytes() {
        if byte.is_ascii_alphanumeric() || b"/._~-".contains(&byte) {
            uri.push(char::from(byte));
        } else {
            let _ = write!(uri, "%{byte:02X}");
        }
    }
    uri
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_references() {
        assert_eq!(to_uri("./a b/ä.log"), "a%20b/%C3%A4.log");
        assert_eq!(to_uri("/tmp/x:1.log"), "file:///tmp/x%3A1.log");
        let on_windows = |path| uri_reference(path, true);
        assert_eq!(on_windows("C:/logs/a b:1.log"), "file:///C:/logs/a%20b%3A1.log");
        assert_eq!(on_windows("//server/share/a.log"), "file://server/share/a.log");
        assert_eq!(on_windows("logs/a.log"), "logs/a.log");
        assert_eq!(title_sentence("a node is lost"), "A node is lost.");
    }
}
