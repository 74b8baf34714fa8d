//! Findings as GitHub Actions workflow commands; each finding becomes an annotation at its line of the
//! capture.

use std::fmt::Write as _;

use super::baseline::portable;
use super::format::{FindingFormat, write_at_once};
use super::report::{ABSENT, CaptureResult, MISSING, Report, SILENT};
use super::text;
use crate::diagnosis::incident::{IncidentFinding, incidents};
use crate::escape::escape;
use crate::finding::phrase::{sentence, who};
use crate::finding::{Severity, SuppressionUse};

pub(super) const FORMAT: FindingFormat = FindingFormat {
    name: "github",
    help: "GitHub Actions workflow commands: annotations at the lines of captures",
    mark: " unreadable; ",
    has_lines: true,
    write: |report, _, out| write_at_once(out, |text| write(report, text)),
};

/// Writes one command per finding, worst first within a capture, then suppressions, and the total as plain
/// text.
fn write(report: &Report, out: &mut String) {
    for judged in &report.captures {
        if let Some(failure) = &judged.failure {
            command(out, "error", &place(judged.first_file(), None), "unreadable", failure);
        }
        for note in &judged.findings.quality {
            command(out, "notice", &place(judged.first_file(), None), "quality", note);
        }
        for rule in &judged.comparison.silent {
            command(out, "error", &place(judged.first_file(), None), rule, SILENT);
        }
        for known in &judged.comparison.gone {
            command(out, "notice", &place(judged.first_file(), None), "gone", &known.line());
        }
        for found in incidents(judged.telling()).iter().flat_map(|incident| &incident.findings) {
            finding(judged, found, out);
        }
    }
    for rule in &report.missing {
        command(out, "error", "", rule, MISSING);
    }
    for capture in &report.absent {
        command(out, "error", &format!("file={},", property(capture)), "absent", ABSENT);
    }
    let suppressions = report.suppressions();
    let messages = |one: &SuppressionUse| [one.covered(), one.complaint()];
    for text in suppressions.iter().flat_map(messages).flatten() {
        command(out, "notice", "", "suppression", &text);
    }
    let _ = writeln!(out, "{}", text::total(report));
}

fn finding(judged: &CaptureResult, found: &IncidentFinding<'_>, out: &mut String) {
    let group = found.group;
    let level = match found.severity() {
        Severity::Error => "error",
        Severity::Warning => "warning",
        Severity::Note => "notice",
    };
    let place = place(judged.file(group.began()), judged.line(group.began()));
    let lines = [format!("{}  {}", who(group), sentence(group))]
        .into_iter()
        .chain(found.also())
        .chain(judged.notes(group));
    // GitHub unescapes line ends, so each line is escaped separately.
    let text = lines.map(|line| escape(&line).into_owned()).collect::<Vec<_>>().join("\n");
    command(out, level, &place, &group.rule, &text);
}

/// `file=captures/a.log,line=12,`.
fn place(file: &str, line: Option<u64>) -> String {
    let file = property(&portable(file));
    match line {
        Some(line) => format!("file={file},line={line},"),
        None => format!("file={file},"),
    }
}

fn command(out: &mut String, level: &str, place: &str, title: &str, text: &str) {
    let lines = text.lines().map(escape).collect::<Vec<_>>().join("\n");
    let _ = writeln!(out, "::{level} {place}title={}::{}", property(title), data(&lines));
}

/// Escapes the message of a workflow command.
fn data(text: &str) -> String {
    text.replace('%', "%25").replace('\r', "%0D").replace('\n', "%0A")
}

/// Escapes a property of a workflow command.
fn property(text: &str) -> String {
    data(&escape(text)).replace(':', "%3A").replace(',', "%2C")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_text_ends_a_command_or_begins_another() {
        let mut out = String::new();
        command(&mut out, "error", "", "a,b:c", "50 % \n::error::x\u{1b}");
        assert_eq!(out, "::error title=a%2Cb%3Ac::50 %25 %0A::error::x\\u{1b}\n");
        assert_eq!(property("a\nb"), "a\\nb");
    }
}
