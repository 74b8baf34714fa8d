//! Findings as GitHub Actions workflow commands; each finding becomes an annotation at its line of the
//! capture.

use std::fmt::Write as _;

use super::baseline::portable_name;
use super::format::{FindingFormat, write_at_once};
use super::report::{
    ABSENT, CaptureOutcome, CaptureResult, FindingsReport, MISSING, NOTHING_CHECKED, SILENT,
};
use super::text;
use crate::diagnosis::incident::{IncidentFinding, group_incidents};
use crate::escape::escape;
use crate::finding::phrase::{finding_sentence, node_phrase};
use crate::finding::{Severity, SuppressionUse};

pub(super) const FORMAT: FindingFormat = FindingFormat {
    name: "github",
    help: "GitHub Actions workflow commands: annotations at the lines of captures",
    mark: " unreadable; ",
    has_lines: true,
    write: |report, _, out| write_at_once(out, |text| write_github(report, text)),
};

/// Writes one command per finding, worst first within a capture, then suppressions, and the total as plain
/// text.
fn write_github(report: &FindingsReport, out: &mut String) {
    for judged in &report.captures {
        if let Some(failure) = &judged.failure {
            write_command(out, "error", &file_place(judged.first_file(), None), "unreadable", failure);
        }
        if judged.overall_outcome(report.least) == CaptureOutcome::Unchecked {
            let place = file_place(judged.first_file(), None);
            write_command(out, "notice", &place, "nothing-checked", NOTHING_CHECKED);
        }
        for note in &judged.findings.quality {
            write_command(out, "notice", &file_place(judged.first_file(), None), "quality", note);
        }
        for rule in &judged.comparison.silent {
            write_command(out, "error", &file_place(judged.first_file(), None), rule, SILENT);
        }
        for known in &judged.comparison.gone {
            write_command(out, "notice", &file_place(judged.first_file(), None), "gone", &known.known_line());
        }
        for found in group_incidents(judged.new_findings()).iter().flat_map(|incident| &incident.findings) {
            write_finding(judged, found, out);
        }
    }
    for rule in &report.missing {
        write_command(out, "error", "", rule, MISSING);
    }
    for capture in &report.absent {
        write_command(out, "error", &format!("file={},", escape_property(capture)), "absent", ABSENT);
    }
    let suppressions = report.suppressions();
    let messages = |one: &SuppressionUse| [one.suppressed_text(), one.review_reason()];
    for text in suppressions.iter().flat_map(messages).flatten() {
        write_command(out, "notice", "", "suppression", &text);
    }
    let _ = writeln!(out, "{}", text::total_text(report));
}

fn write_finding(judged: &CaptureResult, found: &IncidentFinding<'_>, out: &mut String) {
    let group = found.group;
    let level = match found.severity() {
        Severity::Error => "error",
        Severity::Warning => "warning",
        Severity::Note => "notice",
    };
    let place =
        file_place(judged.file_of(group.first_occurrence()), judged.line_of(group.first_occurrence()));
    let lines = [format!("{}  {}", node_phrase(group), finding_sentence(group))]
        .into_iter()
        .chain(found.member_text())
        .chain(judged.finding_notes(group));
    // GitHub unescapes line ends, so each line is escaped separately.
    let text = lines.map(|line| escape(&line).into_owned()).collect::<Vec<_>>().join("\n");
    write_command(out, level, &place, &group.rule, &text);
}

/// `file=captures/a.log,line=12,`.
fn file_place(file: &str, line: Option<u64>) -> String {
    let file = escape_property(&portable_name(file));
    match line {
        Some(line) => format!("file={file},line={line},"),
        None => format!("file={file},"),
    }
}

fn write_command(out: &mut String, level: &str, place: &str, title: &str, text: &str) {
    let lines = text.lines().map(escape).collect::<Vec<_>>().join("\n");
    let _ = writeln!(out, "::{level} {place}title={}::{}", escape_property(title), escape_data(&lines));
}

/// Escapes the message of a workflow command.
fn escape_data(text: &str) -> String {
    text.replace('%', "%25").replace('\r', "%0D").replace('\n', "%0A")
}

/// Escapes a property of a workflow command.
fn escape_property(text: &str) -> String {
    escape_data(&escape(text)).replace(':', "%3A").replace(',', "%2C")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_ends_a_command_or_begins_another() {
        let mut out = String::new();
        write_command(&mut out, "error", "", "a,b:c", "50 % \n::error::x\u{1b}");
        assert_eq!(out, "::error title=a%2Cb%3Ac::50 %25 %0A::error::x\\u{1b}\n");
        assert_eq!(escape_property("a\nb"), "a\\nb");
    }
}
