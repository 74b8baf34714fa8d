//! Findings as text: capture quality first, then findings with the worst first and consequences below their
//! cause, and a table of all captures at the end.

use std::fmt::Write as _;

use super::format::{FindingFormat, TextOptions, write_at_once};
use super::report::{ABSENT, CaptureResult, MISSING, Outcome, Report, SILENT, Standing};
use super::{conformance, coverage};
use crate::diagnosis::incident::{AbsorbedFindings, IncidentFinding, absorbed, incidents};
use crate::diagnosis::{Diagnosis, Setting, stories};
use crate::escape::escape;
use crate::finding::phrase::{seconds, sentence, what, who};
use crate::finding::{Group, Severity, SuppressionUse, Verdict};
use crate::sink::table::{Align, Table};
use crate::words::plural;

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
struct Page<'a> {
    out: &'a mut String,
    options: TextOptions,
}

pub(super) const FORMAT: FindingFormat = FindingFormat {
    name: "text",
    help: "One line per finding, and a summary table",
    mark: " unreadable; ",
    has_lines: false,
    write: |report, options, out| write_at_once(out, |text| write(report, options, text)),
};

/// Writes the complete report.
fn write(report: &Report, options: TextOptions, out: &mut String) {
    let mut page = Page { out, options };
    let common = common_notes(report);
    page.common(report, &common);
    for judged in &report.captures {
        page.capture(judged, &common);
    }
    page.suppressions(report);
    if options.coverage {
        coverage::write(report, page.out);
    }
    page.summary(report);
}

/// Quality notes that apply to all captures, if there are several.
fn common_notes(report: &Report) -> Vec<&str> {
    let [first, others @ ..] = report.captures.as_slice() else { return Vec::new() };
    let is_common = |note: &&String| others.iter().all(|judged| judged.findings.quality.contains(note));
    let notes = first.findings.quality.iter().filter(|note| !others.is_empty() && is_common(note));
    notes.map(String::as_str).collect()
}

impl Page<'_> {
    fn line(&mut self, color: &str, text: &str) {
        let text = escape(text);
        let _ = if self.options.color && !color.is_empty() {
            writeln!(self.out, "{color}{text}\x1b[0m")
        } else {
            writeln!(self.out, "{text}")
        };
    }

    /// A coloured label, followed by text.
    fn labelled(&mut self, depth: usize, (color, label): (&str, &str), text: &str) {
        let indent = "  ".repeat(depth);
        let text = escape(text);
        let _ = if self.options.color {
            writeln!(self.out, "{indent}{color}{label:8}\x1b[0m {text}")
        } else {
            writeln!(self.out, "{indent}{label:8} {text}")
        };
    }

    fn below(&mut self, depth: usize, text: &str) {
        let indent = "  ".repeat(depth);
        let text = escape(text);
        let _ = writeln!(self.out, "{indent}{INDENT}{text}");
    }

    /// One capture; omitted if there is nothing to report.
    fn capture(&mut self, judged: &CaptureResult, common: &[&str]) {
        let start = self.out.len();
        let duration = judged.first.zip(judged.last).map(|(first, last)| seconds(last.since(first)));
        let duration = duration.map_or_else(String::new, |duration| format!(", {duration}"));
        let frames = usize::try_from(judged.frames).unwrap_or(usize::MAX);
        self.line(BOLD, &format!("== {} ({}{duration})", judged.capture, plural(frames, "frame")));
        let after_heading = self.out.len();
        self.quality(judged, common);
        self.incidents(judged);
        self.stories(judged);
        conformance::write(judged, self.out);
        self.baseline(judged);
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
    fn common(&mut self, report: &Report, notes: &[&str]) {
        if !notes.is_empty() {
            self.line(BOLD, &format!("== all {}", plural(report.captures.len(), "capture")));
            for note in notes {
                self.labelled(0, (YELLOW, "quality"), note);
            }
            self.out.push('\n');
        }
    }

    fn quality(&mut self, judged: &CaptureResult, common: &[&str]) {
        if let Some(failure) = &judged.failure {
            self.labelled(0, (RED, "unread"), failure);
        }
        for note in judged.findings.quality.iter().filter(|note| !common.contains(&note.as_str())) {
            self.labelled(0, (YELLOW, "quality"), note);
        }
    }

    fn incidents(&mut self, judged: &CaptureResult) {
        let incidents = incidents(judged.telling());
        let absorbed = absorbed(&judged.findings);
        let shown = if self.options.verbose { usize::MAX } else { SHOWN_INCIDENTS };
        for finding in incidents.iter().take(shown).flat_map(|incident| &incident.findings) {
            self.finding(finding, judged, absorbed.get(&finding.group.id));
        }
        let rest: usize = incidents.iter().skip(shown).map(|incident| incident.findings.len()).sum();
        if rest > 0 {
            self.line(
                "",
                &format!("{INDENT}and {} more; use --verbose to print all", plural(rest, "finding")),
            );
        }
        let ungrouped = judged.findings.ungrouped;
        if ungrouped > 0 {
            self.line("", &format!("{INDENT}{ungrouped} further occurrences not recorded (limit reached)"));
        }
    }

    /// The stories of `why`: cause, effects and steps.
    fn stories(&mut self, judged: &CaptureResult) {
        let setting = Setting { zero: judged.first, ..Setting::default() };
        let diagnosis = Diagnosis::of(&judged.findings, judged.telling(), setting);
        for story in diagnosis.stories.iter().take(SHOWN_STORIES) {
            self.line("", "");
            for line in story.brief() {
                let label = line.label.word();
                let _ = if self.options.color {
                    writeln!(self.out, "{BOLD}{label:14}\x1b[0m {}", escape(&line.text))
                } else {
                    writeln!(self.out, "{}", format!("{label:14} {}", escape(&line.text)).trim_end())
                };
            }
        }
        let rest = diagnosis.stories.len().saturating_sub(SHOWN_STORIES);
        if rest > 0 {
            self.line("", &format!("{INDENT}and {} more; cobscope why --story N prints one", stories(rest)));
        }
    }

    fn finding(
        &mut self,
        finding: &IncidentFinding<'_>,
        judged: &CaptureResult,
        absorbed: Option<&AbsorbedFindings>,
    ) {
        let IncidentFinding { depth, group, .. } = *finding;
        let who = who(group);
        let gap = if who.is_empty() { "" } else { "  " };
        let text = format!("{who}{gap}{} [{}]", sentence(group), group.rule);
        self.labelled(depth, label(finding.severity()), &text);
        if let Some(also) = finding.also() {
            self.below(depth, &also);
        }
        for note in judged.notes(group) {
            self.below(depth, &note);
        }
        if let Some(absorbed) = absorbed {
            self.below(depth, &format!("also covers {absorbed}"));
        }
        if self.options.verbose {
            self.occurrences(depth, group, judged);
        }
    }

    fn occurrences(&mut self, depth: usize, group: &Group, judged: &CaptureResult) {
        let kept = group.first.iter().chain(&group.last);
        let kept: Vec<_> = kept.map(|at| judged.moment(*at)).collect();
        if kept.len() > 2 {
            self.below(depth, &format!("occurrences: {}", kept.join(", ")));
        }
    }

    fn baseline(&mut self, judged: &CaptureResult) {
        for rule in &judged.comparison.silent {
            let text = format!("{rule} is {SILENT}");
            self.labelled(0, (RED, "silent"), &text);
        }
        for known in &judged.comparison.gone {
            self.labelled(0, (GREEN, "gone"), &known.line());
        }
    }

    /// Accepted and suppressed findings, with reasons.
    fn set_aside(&mut self, judged: &CaptureResult) {
        for group in &judged.findings.groups {
            let reason = match judged.standing(group) {
                Standing::New | Standing::Absorbed => continue,
                Standing::Accepted => "in the baseline",
                Standing::Suppressed => group.suppressed.as_deref().unwrap_or_default(),
            };
            let label = judged.standing(group).name();
            let text = format!("{}  {} [{}]", who(group), what(group), group.rule);
            let _ = writeln!(self.out, "{label:10} {}", escape(&text));
            let _ = writeln!(self.out, "           {}; {}", escape(&judged.when(group)), escape(reason));
        }
    }

    fn suppressions(&mut self, report: &Report) {
        let all = report.suppressions();
        for complaint in all.iter().filter_map(SuppressionUse::complaint) {
            self.labelled(0, label(Severity::Note), &complaint);
        }
        for covered in all.iter().filter_map(SuppressionUse::covered) {
            if self.options.verbose || self.options.coverage {
                self.line(DIM, &covered);
            }
        }
    }

    fn summary(&mut self, report: &Report) {
        let has_accepted = report.has_baseline;
        let mut columns =
            vec![("CAPTURE", Align::Left), ("ERRORS", Align::Right), ("WARNINGS", Align::Right)];
        columns.push(("NOTES", Align::Right));
        if has_accepted {
            columns.push(("ACCEPTED", Align::Right));
            columns.push(("GONE", Align::Right));
        }
        columns.extend([("PASSED", Align::Right), ("NOT EXERCISED", Align::Right), ("VERDICT", Align::Left)]);
        let mut table = Table::new(&columns);
        for judged in &report.captures {
            let number = |severity| judged.number(severity).to_string();
            let mut row = vec![judged.capture.clone(), number(Severity::Error), number(Severity::Warning)];
            row.push(number(Severity::Note));
            if has_accepted {
                row.push(judged.number_of(Standing::Accepted).to_string());
                row.push(judged.comparison.gone.len().to_string());
            }
            row.push(judged.verdicts(Verdict::Pass).to_string());
            row.push(judged.verdicts(Verdict::NotExercised).to_string());
            row.push(verdict(judged.outcome(report.least), judged).to_owned());
            table.row(row);
        }
        table.write(0, self.out);
        for rule in &report.missing {
            self.labelled(0, (RED, "missing"), &format!("{rule} {MISSING}"));
        }
        for capture in &report.absent {
            self.labelled(0, (RED, "absent"), &format!("{capture}: {ABSENT}"));
        }
        self.line(if report.fails() { RED } else { GREEN }, &total(report));
    }
}

/// `3 captures: 1 failed; 2 errors, 1 warning, 0 notes`.
pub(super) fn total(report: &Report) -> String {
    let of = |wanted| report.captures.iter().filter(|one| one.outcome(report.least) == wanted).count();
    let number = |severity| report.captures.iter().map(|judged| judged.number(severity)).sum::<usize>();
    let mut text = format!(
        "{}: {} failed, {} unreadable; {}, {}, {}",
        plural(report.captures.len(), "capture"),
        of(Outcome::Failed),
        of(Outcome::Unreadable),
        plural(number(Severity::Error), "error"),
        plural(number(Severity::Warning), "warning"),
        plural(number(Severity::Note), "note"),
    );
    for standing in [Standing::Accepted, Standing::Suppressed] {
        let count: usize = report.captures.iter().map(|judged| judged.number_of(standing)).sum();
        if count > 0 {
            let _ = write!(text, ", {count} {}", standing.name());
        }
    }
    if !report.absent.is_empty() {
        let _ = write!(text, "; {} of the baseline absent", plural(report.absent.len(), "capture"));
    }
    text
}

/// Verdict column; a capture without any verdict has not passed.
fn verdict(outcome: Outcome, judged: &CaptureResult) -> &'static str {
    let is_exercised = judged.rules().any(|(_, tally)| tally.verdict() != Verdict::NotExercised);
    match outcome {
        Outcome::Passed if !is_exercised => "nothing checked",
        Outcome::Passed => "passed",
        Outcome::Failed => "FAILED",
        Outcome::Unreadable => "UNREADABLE",
    }
}

const fn label(severity: Severity) -> (&'static str, &'static str) {
    match severity {
        Severity::Error => (RED, "error"),
        Severity::Warning => (YELLOW, "warning"),
        Severity::Note => (DIM, "note"),
    }
}
