//! Findings as text: capture quality first, then findings with the worst first and consequences below their
//! cause, and a table of all captures at the end.

use std::fmt::Write as _;

use super::format::{FindingFormat, FindingTextOptions, write_at_once};
use super::report::{
    ABSENT, CaptureOutcome, CaptureResult, FindingStanding, FindingsReport, MISSING, SILENT,
};
use super::{conformance, coverage};
use crate::diagnosis::incident::{AbsorbedFindings, IncidentFinding, absorbed_findings, group_incidents};
use crate::diagnosis::{Diagnosis, DiagnosisContext, story_count};
use crate::escape::escape;
use crate::figures::format_time;
use crate::finding::phrase::{finding_sentence, node_phrase, subject_phrase};
use crate::finding::{FindingGroup, RuleOutcome, Severity, SuppressionUse};
use crate::sink::table::{CellAlignment, TextTable};
use crate::words::count_noun;

/// Maximum number of incidents printed per capture without `--verbose`; the others are counted.
const SHOWN_INCIDENTS: usize = 50;

/// Maximum number of stories printed per capture.
const SHOWN_STORIES: usize = 3;

/// Indentation of lines below a label.
const INDENT: &str = "         ";

const RED: &str = "\x1b[31m";
const YELLOW: &str = "\x1b[33m";
const GREEN: &str = "\x1b[32m";
const BOLD: &str = "\x1b[1m";
const DIM: &str = "\x1b[2m";

/// Text under construction.
struct FindingsPage<'a> {
    out: &'a mut String,
    options: FindingTextOptions,
}

pub(super) const FORMAT: FindingFormat = FindingFormat {
    name: "text",
    help: "One line per finding, and a summary table",
    mark: " unreadable; ",
    has_lines: false,
    write: |report, options, out| write_at_once(out, |text| write_findings(report, options, text)),
};

/// Writes the complete report.
fn write_findings(report: &FindingsReport, options: FindingTextOptions, out: &mut String) {
    let mut page = FindingsPage { out, options };
    let common = common_notes(report);
    page.push_common(report, &common);
    for judged in &report.captures {
        page.push_capture(judged, &common);
    }
    page.push_suppressions(report);
    if options.coverage {
        coverage::write_coverage(report, page.out);
    }
    page.push_summary(report);
}

/// Quality notes that apply to all captures, if there are several.
fn common_notes(report: &FindingsReport) -> Vec<&str> {
    let [first, others @ ..] = report.captures.as_slice() else { return Vec::new() };
    let is_common = |note: &&String| others.iter().all(|judged| judged.findings.quality.contains(note));
    let notes = first.findings.quality.iter().filter(|note| !others.is_empty() && is_common(note));
    notes.map(String::as_str).collect()
}

impl FindingsPage<'_> {
    fn push_line(&mut self, color: &str, text: &str) {
        let text = escape(text);
        let _ = if self.options.color && !color.is_empty() {
            writeln!(self.out, "{color}{text}\x1b[0m")
        } else {
            writeln!(self.out, "{text}")
        };
    }

    /// A coloured label, followed by text.
    fn push_labelled(&mut self, depth: usize, (color, label): (&str, &str), text: &str) {
        let indent = "  ".repeat(depth);
        let text = escape(text);
        let _ = if self.options.color {
            writeln!(self.out, "{indent}{color}{label:8}\x1b[0m {text}")
        } else {
            writeln!(self.out, "{indent}{label:8} {text}")
        };
    }

    fn push_indented(&mut self, depth: usize, text: &str) {
        let indent = "  ".repeat(depth);
        let text = escape(text);
        let _ = writeln!(self.out, "{indent}{INDENT}{text}");
    }

    /// One capture; omitted if there is nothing to report.
    fn push_capture(&mut self, judged: &CaptureResult, common: &[&str]) {
        let start = self.out.len();
        let duration = judged.first.zip(judged.last).map(|(first, last)| last.since(first));
        // A clock that was set back may end before its first frame; the quality states it.
        let duration = duration.filter(|duration| *duration >= 0);
        let duration = duration.map_or_else(String::new, |duration| format!(", {}", format_time(duration)));
        let frames = usize::try_from(judged.frames).unwrap_or(usize::MAX);
        self.push_line(BOLD, &format!("== {} ({}{duration})", judged.capture, count_noun(frames, "frame")));
        let after_heading = self.out.len();
        self.push_quality(judged, common);
        self.push_incidents(judged);
        self.push_stories(judged);
        conformance::write_conformance(judged, self.out);
        self.push_baseline(judged);
        if self.options.verbose {
            self.set_aside(judged);
        }
        if self.out.len() == after_heading {
            self.out.truncate(start);
        } else {
            self.out.push('\n');
        }
    }

    /// Quality notes that apply to all captures.
    fn push_common(&mut self, report: &FindingsReport, notes: &[&str]) {
        if !notes.is_empty() {
            self.push_line(BOLD, &format!("== all {}", count_noun(report.captures.len(), "capture")));
            for note in notes {
                self.push_labelled(0, (YELLOW, "quality"), note);
            }
            self.out.push('\n');
        }
    }

    fn push_quality(&mut self, judged: &CaptureResult, common: &[&str]) {
        if let Some(failure) = &judged.failure {
            self.push_labelled(0, (RED, "unread"), failure);
        }
        for note in judged.findings.quality.iter().filter(|note| !common.contains(&note.as_str())) {
            self.push_labelled(0, (YELLOW, "quality"), note);
        }
    }

    fn push_incidents(&mut self, judged: &CaptureResult) {
        let incidents = group_incidents(judged.new_findings());
        let absorbed = absorbed_findings(&judged.findings);
        let shown = if self.options.verbose { usize::MAX } else { SHOWN_INCIDENTS };
        for finding in incidents.iter().take(shown).flat_map(|incident| &incident.findings) {
            self.push_finding(finding, judged, absorbed.get(&finding.group.id));
        }
        let rest: usize = incidents.iter().skip(shown).map(|incident| incident.findings.len()).sum();
        if rest > 0 {
            self.push_line(
                "",
                &format!("{INDENT}and {} more; use --verbose to print all", count_noun(rest, "finding")),
            );
        }
        let ungrouped = judged.findings.ungrouped;
        if ungrouped > 0 {
            self.push_line(
                "",
                &format!("{INDENT}{ungrouped} further occurrences not recorded (limit reached)"),
            );
        }
    }

    /// The stories of `why`: cause, effects and steps.
    fn push_stories(&mut self, judged: &CaptureResult) {
        let setting = DiagnosisContext { zero: judged.first, ..DiagnosisContext::default() };
        let diagnosis = Diagnosis::diagnose_findings(&judged.findings, judged.new_findings(), setting);
        for story in diagnosis.stories.iter().take(SHOWN_STORIES) {
            self.push_line("", "");
            for line in story.brief_lines() {
                let label = line.label.label_word();
                let _ = if self.options.color {
                    writeln!(self.out, "{BOLD}{label:14}\x1b[0m {}", escape(&line.text))
                } else {
                    writeln!(self.out, "{}", format!("{label:14} {}", escape(&line.text)).trim_end())
                };
            }
        }
        let rest = diagnosis.stories.len().saturating_sub(SHOWN_STORIES);
        if rest > 0 {
            self.push_line(
                "",
                &format!("{INDENT}and {} more; cobscope why --story N prints one", story_count(rest)),
            );
        }
    }

    fn push_finding(
        &mut self,
        finding: &IncidentFinding<'_>,
        judged: &CaptureResult,
        absorbed: Option<&AbsorbedFindings>,
    ) {
        let IncidentFinding { depth, group, .. } = *finding;
        let who = node_phrase(group);
        let gap = if who.is_empty() { "" } else { "  " };
        let text = format!("{who}{gap}{} [{}]", finding_sentence(group), group.rule);
        self.push_labelled(depth, severity_label(finding.severity()), &text);
        if let Some(also) = finding.member_text() {
            self.push_indented(depth, &also);
        }
        for note in judged.finding_notes(group) {
            self.push_indented(depth, &note);
        }
        if let Some(absorbed) = absorbed {
            self.push_indented(depth, &format!("also covers {absorbed}"));
        }
        if self.options.verbose {
            self.push_occurrences(depth, group, judged);
        }
    }

    fn push_occurrences(&mut self, depth: usize, group: &FindingGroup, judged: &CaptureResult) {
        let kept = group.first.iter().chain(&group.last);
        let kept: Vec<_> = kept.map(|at| judged.moment_text(*at)).collect();
        if kept.len() > 2 {
            self.push_indented(depth, &format!("occurrences: {}", kept.join(", ")));
        }
    }

    fn push_baseline(&mut self, judged: &CaptureResult) {
        for rule in &judged.comparison.silent {
            let text = format!("{rule} is {SILENT}");
            self.push_labelled(0, (RED, "silent"), &text);
        }
        for known in &judged.comparison.gone {
            self.push_labelled(0, (GREEN, "gone"), &known.known_line());
        }
    }

    /// Accepted and suppressed findings, with reasons.
    fn set_aside(&mut self, judged: &CaptureResult) {
        for group in &judged.findings.groups {
            let reason = match judged.standing_of(group) {
                FindingStanding::New | FindingStanding::Absorbed => continue,
                FindingStanding::Accepted => "in the baseline",
                FindingStanding::Suppressed => group.suppressed.as_deref().unwrap_or_default(),
            };
            let label = judged.standing_of(group).name();
            let text = format!("{}  {} [{}]", node_phrase(group), subject_phrase(group), group.rule);
            let _ = writeln!(self.out, "{label:10} {}", escape(&text));
            let _ =
                writeln!(self.out, "           {}; {}", escape(&judged.period_text(group)), escape(reason));
        }
    }

    fn push_suppressions(&mut self, report: &FindingsReport) {
        let all = report.suppressions();
        for complaint in all.iter().filter_map(SuppressionUse::review_reason) {
            self.push_labelled(0, severity_label(Severity::Note), &complaint);
        }
        for covered in all.iter().filter_map(SuppressionUse::suppressed_text) {
            if self.options.verbose || self.options.coverage {
                self.push_line(DIM, &covered);
            }
        }
    }

    fn push_summary(&mut self, report: &FindingsReport) {
        let has_accepted = report.has_baseline;
        let mut columns = vec![
            ("CAPTURE", CellAlignment::Left),
            ("ERRORS", CellAlignment::Right),
            ("WARNINGS", CellAlignment::Right),
        ];
        columns.push(("NOTES", CellAlignment::Right));
        if has_accepted {
            columns.push(("ACCEPTED", CellAlignment::Right));
            columns.push(("GONE", CellAlignment::Right));
        }
        columns.extend([
            ("PASSED", CellAlignment::Right),
            ("NOT EXERCISED", CellAlignment::Right),
            ("VERDICT", CellAlignment::Left),
        ]);
        let mut table = TextTable::new(&columns);
        for judged in &report.captures {
            let number = |severity| judged.printed_count(severity).to_string();
            let mut row = vec![judged.capture.clone(), number(Severity::Error), number(Severity::Warning)];
            row.push(number(Severity::Note));
            if has_accepted {
                row.push(judged.number_of(FindingStanding::Accepted).to_string());
                row.push(judged.comparison.gone.len().to_string());
            }
            row.push(judged.verdict_count(RuleOutcome::Pass).to_string());
            row.push(judged.verdict_count(RuleOutcome::NotExercised).to_string());
            row.push(verdict_text(judged.overall_outcome(report.least), judged));
            table.add_row(row);
        }
        table.write_table(0, self.out);
        for rule in &report.missing {
            self.push_labelled(0, (RED, "missing"), &format!("{rule} {MISSING}"));
        }
        for capture in &report.absent {
            self.push_labelled(0, (RED, "absent"), &format!("{capture}: {ABSENT}"));
        }
        self.push_line(if report.has_failed() { RED } else { GREEN }, &total_text(report));
    }
}

/// `3 captures: 1 failed; 2 errors, 1 warning, 0 notes`.
pub(super) fn total_text(report: &FindingsReport) -> String {
    let of =
        |wanted| report.captures.iter().filter(|one| one.overall_outcome(report.least) == wanted).count();
    let number =
        |severity| report.captures.iter().map(|judged| judged.printed_count(severity)).sum::<usize>();
    let mut text = format!(
        "{}: {} failed, {} unreadable; {}, {}, {}",
        count_noun(report.captures.len(), "capture"),
        of(CaptureOutcome::Failed),
        of(CaptureOutcome::Unreadable),
        count_noun(number(Severity::Error), "error"),
        count_noun(number(Severity::Warning), "warning"),
        count_noun(number(Severity::Note), "note"),
    );
    match of(CaptureOutcome::Unchecked) {
        0 => {}
        count => {
            let _ = write!(text, "; nothing checked in {}", count_noun(count, "capture"));
        }
    }
    for standing in [FindingStanding::Accepted, FindingStanding::Suppressed] {
        let count: usize = report.captures.iter().map(|judged| judged.number_of(standing)).sum();
        if count > 0 {
            let _ = write!(text, ", {count} {}", standing.name());
        }
    }
    if !report.absent.is_empty() {
        let _ = write!(text, "; {} of the baseline absent", count_noun(report.absent.len(), "capture"));
    }
    text
}

/// Verdict column; a capture with findings below the limit has not passed.
fn verdict_text(outcome: CaptureOutcome, judged: &CaptureResult) -> String {
    let text = match outcome {
        CaptureOutcome::Unchecked => "nothing checked",
        CaptureOutcome::Passed => "passed",
        CaptureOutcome::Failed => "FAILED",
        CaptureOutcome::Unreadable => "UNREADABLE",
    };
    let worst = [Severity::Error, Severity::Warning, Severity::Note].into_iter().find_map(|severity| {
        let count = judged.printed_count(severity);
        (count > 0).then(|| count_noun(count, severity.name()))
    });
    worst.filter(|_| outcome == CaptureOutcome::Passed).unwrap_or_else(|| text.to_owned())
}

const fn severity_label(severity: Severity) -> (&'static str, &'static str) {
    match severity {
        Severity::Error => (RED, "error"),
        Severity::Warning => (YELLOW, "warning"),
        Severity::Note => (DIM, "note"),
    }
}
