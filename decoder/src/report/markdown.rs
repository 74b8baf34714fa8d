//! A report as Markdown for issue trackers. Texts of a capture are in code blocks, so that they form no markup,
//! mention or link.

use std::fmt::Write as _;

use super::glossary::marks;
use super::model::{Claim, EvidenceFrame, NodeValues, Report};
use crate::escape::escape;
use crate::words::{grouped, plural};

/// Minimum length of the fence of a code block.
const FENCE: usize = 3;

/// Start of each report.
pub const MARK: &str = "# cobscope: ";

/// The report.
pub fn write(report: &Report) -> String {
    let mut page = Page(String::new());
    page.heading(1, &format!("cobscope: {}", code(&report.title())));
    page.text(&format!("Capture {}, {}", code(&report.capture.name), extent(report)));
    if let Some(failure) = &report.capture.failure {
        page.text(&format!("\nIncomplete: {}", code(failure)));
    }
    if report.claims.is_empty() {
        page.block(&report.account);
    }
    for claim in &report.claims {
        page.claim(claim);
    }
    page.list("Further stories, without evidence here", &report.further);
    page.list("Notes", &report.notes);
    let none = ["none: all values and states in the claims were seen on the bus".to_owned()];
    let is_sure = report.assumptions.is_empty() && !report.claims.is_empty();
    page.list("Assumptions (?)", if is_sure { &none } else { &report.assumptions });
    page.list("Quality of the capture", &report.quality);
    page.list("What the capture cannot show", &report.blind);
    let sources: Vec<_> =
        report.sources.iter().map(|it| format!("{}: {}: {}", it.rule, it.title, it.source)).collect();
    page.list("Manual and standard", &sources);
    page.list("Devices", &report.devices);
    page.list("Timestamps", &report.clock);
    page.provenance(report);
    page.coverage(report);
    let glossary: Vec<_> = marks().iter().map(|it| format!("{}: {}", it.mark, it.meaning)).collect();
    page.list("Marks", &glossary);
    page.0
}

fn extent(report: &Report) -> String {
    let duration = report.capture.duration.as_ref().map_or_else(String::new, |it| format!(" in {it}"));
    format!("{} frames{duration}, {}", grouped(report.capture.frames), report.capture.format)
}

struct Page(String);

impl Page {
    fn heading(&mut self, level: usize, text: &str) {
        if !self.0.is_empty() {
            self.0.push('\n');
        }
        let _ = writeln!(self.0, "{} {text}\n", "#".repeat(level));
    }

    fn text(&mut self, text: &str) {
        let _ = writeln!(self.0, "{text}");
    }

    /// Lines as a code block, with a fence longer than any of theirs.
    fn block(&mut self, lines: &[String]) {
        let lines: Vec<_> = lines.iter().map(|line| escape(line.trim_end())).collect();
        let longest = lines.iter().map(|line| longest_run(line)).max().unwrap_or(0);
        let fence = "`".repeat(FENCE.max(longest + 1));
        let _ = writeln!(self.0, "{fence}text");
        for line in lines {
            let _ = writeln!(self.0, "{line}");
        }
        let _ = writeln!(self.0, "{fence}");
    }

    fn list(&mut self, title: &str, texts: &[String]) {
        if texts.is_empty() {
            return;
        }
        self.heading(2, title);
        for text in texts {
            let _ = writeln!(self.0, "- {}", code(text));
        }
    }

    fn claim(&mut self, claim: &Claim) {
        self.heading(2, &format!("Claim {}: {}", claim.number, claim.severity.name()));
        self.text(&format!("- What: {}, {}", code(&claim.title), code(&claim.who)));
        self.text(&format!("- When: {}", code(&claim.when)));
        for source in &claim.sources {
            self.text(&format!("- Section: {}", code(source)));
        }
        self.heading(3, "Story");
        let line = |line: &super::model::ClaimLine| {
            let mark = line.mark.map_or_else(String::new, |mark| format!("({mark})"));
            format!("{:14} {mark:4} {}", line.label.word(), line.text)
        };
        self.block(&claim.lines.iter().map(line).collect::<Vec<_>>());
        self.heading(3, "Frames");
        self.block(&frames(claim));
        for values in &claim.values {
            self.heading(3, &format!("Object values: {}", code(&values.who)));
            self.block(&objects(values));
        }
        if !claim.context.is_empty() {
            self.heading(3, "Before and at that time");
            self.block(&claim.context);
        }
    }

    fn provenance(&mut self, report: &Report) {
        let made = &report.provenance;
        let mut lines =
            vec![format!("command  {}", made.command), format!("program  cobscope {}", made.version)];
        for file in &made.files {
            let size = if file.size > 0 { format!("{} bytes  ", grouped(file.size)) } else { String::new() };
            lines.push(format!("{}  {}  {size}{}", file.sha256, file.role, file.name));
        }
        if let Some(own) = &report.attachment {
            let frames = plural(own.frames, "frame");
            let timed = if own.is_timed { "" } else { ", timestamps 0: the capture has none" };
            let with =
                own.bus_file.as_ref().map_or_else(String::new, |name| format!(", read with --bus {name}"));
            lines.push(format!("{}  cut-out capture of {frames}{timed}  {}{with}", own.sha256, own.name));
        }
        self.heading(2, "How this report was made");
        self.block(&lines);
    }

    fn coverage(&mut self, report: &Report) {
        let coverage = &report.coverage;
        let counted = |rules: &[(String, u64)]| {
            let all: Vec<_> = rules.iter().map(|(rule, count)| format!("{rule} {count}")).collect();
            all.join(", ")
        };
        let idle: Vec<_> = coverage.not_exercised.iter().map(|(rule, _)| rule.as_str()).collect();
        self.heading(2, "Rules");
        self.block(&[
            format!("with defects: {}", counted(&coverage.failed)),
            format!("without a defect: {}", counted(&coverage.passed)),
            format!("not exercised: {}", idle.join(", ")),
        ]);
    }
}

fn frames(claim: &Claim) -> Vec<String> {
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

fn objects(values: &NodeValues) -> Vec<String> {
    let rows = values.rows.iter().map(|row| {
        let frame = if row.frame > 0 { format!(" {{{}}}", row.frame) } else { String::new() };
        let parts = [&row.object, &row.name, &row.value, &row.bytes];
        let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).map(String::as_str).collect();
        format!("{}  {}{frame}", parts.join("  "), row.origin)
    });
    rows.collect()
}

/// A text as a code span, with a delimiter longer than any run of backticks in it.
fn code(text: &str) -> String {
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
        assert_eq!(code("a"), "`a`");
        assert_eq!(code("`a``b"), "``` `a``b ```");
        assert_eq!(code("x\n# y"), "`x\\n# y`");
    }

    #[test]
    fn fences_are_longer_than_those_of_a_capture() {
        let mut page = Page(String::new());
        page.block(&["````".to_owned()]);
        assert_eq!(page.0, "`````text\n````\n`````\n");
    }
}
