//! A report as Markdown for issue trackers. Texts of a capture are in code blocks, so that they form no markup,
//! mention or link.

use std::fmt::Write as _;

use super::glossary::glossary_marks;
use super::model::{CaptureReport, EvidenceFrame, NodeValues, ReportClaim};
use crate::escape::escape;
use crate::words::{count_noun, group_digits};

/// Minimum length of the fence of a code block.
const FENCE: usize = 3;

/// Start of each report.
pub const MARK: &str = "# cobscope: ";

/// The report.
pub fn write_report(report: &CaptureReport) -> String {
    let mut page = MarkdownPage(String::new());
    page.push_heading(1, &format!("cobscope: {}", code_span(&report.title())));
    page.push_text(&format!("Capture {}, {}", code_span(&report.capture.name), extent_text(report)));
    if let Some(failure) = &report.capture.failure {
        page.push_text(&format!("\nIncomplete: {}", code_span(failure)));
    }
    if report.claims.is_empty() {
        page.push_block(&report.account);
    }
    for claim in &report.claims {
        page.push_claim(claim);
    }
    page.push_list("Further stories, without evidence here", &report.further);
    page.push_list("Notes", &report.notes);
    let none = ["none: all values and states in the claims were seen on the bus".to_owned()];
    let is_certain = report.assumptions.is_empty() && !report.claims.is_empty();
    page.push_list("Assumptions (?)", if is_certain { &none } else { &report.assumptions });
    page.push_list("Quality of the capture", &report.quality);
    page.push_list("What the capture cannot show", &report.blind);
    let sources: Vec<_> =
        report.sources.iter().map(|it| format!("{}: {}: {}", it.rule, it.title, it.source)).collect();
    page.push_list("Manual and standard", &sources);
    page.push_list("Devices", &report.devices);
    page.push_list("Timestamps", &report.clock);
    page.push_provenance(report);
    page.push_coverage(report);
    let glossary: Vec<_> = glossary_marks().iter().map(|it| format!("{}: {}", it.mark, it.meaning)).collect();
    page.push_list("Marks", &glossary);
    page.0
}

fn extent_text(report: &CaptureReport) -> String {
    let duration = report.capture.duration.as_ref().map_or_else(String::new, |it| format!(" in {it}"));
    format!("{} frames{duration}, {}", group_digits(report.capture.frames), report.capture.format)
}

struct MarkdownPage(String);

impl MarkdownPage {
    fn push_heading(&mut self, level: usize, text: &str) {
        if !self.0.is_empty() {
            self.0.push('\n');
        }
        let _ = writeln!(self.0, "{} {text}\n", "#".repeat(level));
    }

    fn push_text(&mut self, text: &str) {
        let _ = writeln!(self.0, "{text}");
    }

    /// Lines as a code block, with a fence longer than any of theirs.
    fn push_block(&mut self, lines: &[String]) {
        let lines: Vec<_> = lines.iter().map(|line| escape(line.trim_end())).collect();
        let longest = lines.iter().map(|line| longest_run(line)).max().unwrap_or(0);
        let fence = "`".repeat(FENCE.max(longest + 1));
        let _ = writeln!(self.0, "{fence}text");
        for line in lines {
            let _ = writeln!(self.0, "{line}");
        }
        let _ = writeln!(self.0, "{fence}");
    }

    fn push_list(&mut self, title: &str, texts: &[String]) {
        if texts.is_empty() {
            return;
        }
        self.push_heading(2, title);
        for text in texts {
            let _ = writeln!(self.0, "- {}", code_span(text));
        }
    }

    fn push_claim(&mut self, claim: &ReportClaim) {
        self.push_heading(2, &format!("Claim {}: {}", claim.number, claim.severity.name()));
        self.push_text(&format!("- What: {}, {}", code_span(&claim.title), code_span(&claim.who)));
        self.push_text(&format!("- When: {}", code_span(&claim.when)));
        for source in &claim.sources {
            self.push_text(&format!("- Section: {}", code_span(source)));
        }
        self.push_heading(3, "Story");
        let line = |line: &super::model::ClaimLine| {
            let mark = line.mark.map_or_else(String::new, |mark| format!("({mark})"));
            format!("{:14} {mark:4} {}", line.label.label_word(), line.text)
        };
        self.push_block(&claim.lines.iter().map(line).collect::<Vec<_>>());
        self.push_heading(3, "Frames");
        self.push_block(&frame_lines(claim));
        for values in &claim.values {
            self.push_heading(3, &format!("Object values: {}", code_span(&values.who)));
            self.push_block(&object_lines(values));
        }
        if !claim.context.is_empty() {
            self.push_heading(3, "Before and at that time");
            self.push_block(&claim.context);
        }
    }

    fn push_provenance(&mut self, report: &CaptureReport) {
        let made = &report.provenance;
        let mut lines =
            vec![format!("command  {}", made.command), format!("program  cobscope {}", made.version)];
        for file in &made.files {
            let size =
                if file.size > 0 { format!("{} bytes  ", group_digits(file.size)) } else { String::new() };
            lines.push(format!("{}  {}  {size}{}", file.sha256, file.role, file.name));
        }
        if let Some(own) = &report.attachment {
            let frames = count_noun(own.frames, "frame");
            let timed = if own.is_timed { "" } else { ", timestamps 0: the capture has none" };
            let with =
                own.bus_file.as_ref().map_or_else(String::new, |name| format!(", read with --bus {name}"));
            lines.push(format!("{}  cut-out capture of {frames}{timed}  {}{with}", own.sha256, own.name));
        }
        self.push_heading(2, "How this report was made");
        self.push_block(&lines);
    }

    fn push_coverage(&mut self, report: &CaptureReport) {
        let coverage = &report.coverage;
        let counted = |rules: &[(String, u64)]| {
            let all: Vec<_> = rules.iter().map(|(rule, count)| format!("{rule} {count}")).collect();
            all.join(", ")
        };
        let idle: Vec<_> = coverage.not_exercised.iter().map(|(rule, _)| rule.as_str()).collect();
        self.push_heading(2, "Rules");
        self.push_block(&[
            format!("with defects: {}", counted(&coverage.failed)),
            format!("without a defect: {}", counted(&coverage.passed)),
            format!("not exercised: {}", idle.join(", ")),
        ]);
    }
}

fn frame_lines(claim: &ReportClaim) -> Vec<String> {
    let bytes = claim.evidence.iter().map(|frame| frame.bytes.chars().count()).max().unwrap_or(0);
    let line = |frame: &EvidenceFrame| {
        let meaning = frame.meaning.join("; ");
        let mark = if frame.is_presumed { "?" } else { "" };
        format!(
            "{{{}}}  {}  {}  {:>8}  {:bytes$}  {meaning}{mark}",
            frame.number, frame.time, frame.bus, frame.id, frame.bytes
        )
    };
    claim.evidence.iter().map(line).collect()
}

fn object_lines(values: &NodeValues) -> Vec<String> {
    let rows = values.rows.iter().map(|row| {
        let frame = if row.frame > 0 { format!(" {{{}}}", row.frame) } else { String::new() };
        let parts = [&row.object, &row.name, &row.value, &row.bytes];
        let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).map(String::as_str).collect();
        format!("{}  {}{frame}", parts.join("  "), row.origin)
    });
    rows.collect()
}

/// A text as a code span, with a delimiter longer than any run of backticks in it.
fn code_span(text: &str) -> String {
    let text = escape(text);
    let delimiter = "`".repeat(longest_run(&text) + 1);
    let blank = if text.starts_with('`') || text.ends_with('`') || text.is_empty() { " " } else { "" };
    format!("{delimiter}{blank}{text}{blank}{delimiter}")
}

/// Length of the longest run of backticks.
fn longest_run(text: &str) -> usize {
    text.split(|letter| letter != '`').map(str::len).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backticks_do_not_end_a_code_span() {
        assert_eq!(code_span("a"), "`a`");
        assert_eq!(code_span("`a``b"), "``` `a``b ```");
        assert_eq!(code_span("x\n# y"), "`x\\n# y`");
    }

    #[test]
    fn fences_are_longer_than_those_of_a_capture() {
        let mut page = MarkdownPage(String::new());
        page.push_block(&["````".to_owned()]);
        assert_eq!(page.0, "`````text\n````\n`````\n");
    }
}
