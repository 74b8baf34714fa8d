//! The comparison as text: differences by section, most important first, then counts.

use std::fmt::Write as _;

use super::difference::{
    CaptureComparison, ComparedSide, Difference, DifferenceKind, DifferenceSection, Observation, SubjectNoun,
    UnobservedSubject,
};
use super::record::{CaptureRecord, EvidenceMark};
pub(crate) use super::times::format_seconds;
use crate::escape::escape;
use crate::words::{count_noun, group_digits};

/// Maximum number of lines by default.
const SHOWN_LINES: usize = 40;

/// Maximum number of findings per capture that the other one did not show, by default.
const SHOWN_ABSENT: usize = 5;

/// Maximum number of characters of a value by default.
const SHOWN_VALUE: usize = 120;

/// Width of the section column.
const LABEL: usize = 18;

/// Text between the two captures, in the first line.
pub const MARK: &str = "   BAD ";

/// Writes the comparison; `is_complete` prints every difference and everything that was not seen.
pub fn write_comparison(
    comparison: &CaptureComparison,
    (good, bad): (&CaptureRecord, &CaptureRecord),
    is_complete: bool,
    output: &mut String,
) {
    let mut page =
        ComparisonText { output, is_complete, rest: if is_complete { usize::MAX } else { SHOWN_LINES } };
    page.write_comparison(&format!("GOOD {}{MARK}{}", capture_length(good), capture_length(bad)));
    let closing = closing_lines(comparison, is_complete);
    page.rest = page.rest.saturating_sub(closing.len());
    page.push_differences(comparison);
    page.rest = usize::MAX;
    for (label, text) in closing {
        page.push_line(label, &text);
    }
}

/// `good.log 612.0 s, 1,204 frames`.
fn capture_length(record: &CaptureRecord) -> String {
    let duration = record.duration.map_or("without timestamps".to_owned(), format_seconds);
    format!("{} {duration}, {} frames", record.name, group_digits(record.frames))
}

struct ComparisonText<'a> {
    output: &'a mut String,
    is_complete: bool,
    /// Lines that may still be written.
    rest: usize,
}

impl ComparisonText<'_> {
    fn push_line(&mut self, label: &str, text: &str) {
        self.write_comparison(&format!("{label:<LABEL$}{text}"));
    }

    fn write_comparison(&mut self, line: &str) {
        self.rest = self.rest.saturating_sub(1);
        let _ = writeln!(self.output, "{}", escape(line.trim_end()));
    }

    /// Sections in the order of their first difference.
    fn push_differences(&mut self, comparison: &CaptureComparison) {
        let of_differences = comparison
            .differences
            .iter()
            .map(|it| (it.weight, difference_label(it), self.difference_text(it)));
        let of_not_seen = comparison.not_seen.iter().filter(|it| it.weight > 0.0);
        let of_not_seen =
            of_not_seen.map(|it| (it.weight, not_seen_by(it.by), self.cut_text(&absence_text(it))));
        let mut rows: Vec<_> = of_differences.chain(of_not_seen).collect();
        rows.sort_by(|one, other| other.0.total_cmp(&one.0));
        let mut groups: Vec<(&'static str, Vec<String>)> = Vec::new();
        for (_, title, text) in rows {
            match groups.iter_mut().find(|(known, _)| *known == title) {
                Some((_, group)) => group.push(text),
                None => groups.push((title, vec![text])),
            }
        }
        let mut hidden = 0;
        for (title, group) in groups {
            let mut label = title;
            for text in group {
                // The last line states how many are not printed.
                if self.rest <= 1 {
                    hidden += 1;
                    continue;
                }
                self.push_line(label, &text);
                label = "";
            }
        }
        if hidden > 0 {
            self.push_line("", &format!("{} more (-v)", count_noun(hidden, "difference")));
        }
    }

    fn difference_text(&self, difference: &Difference) -> String {
        let Difference { kind, subject, aspect, good, bad, note, .. } = difference;
        let values = self.value_text(difference);
        let is_finding = matches!(
            kind,
            DifferenceKind::Finding | DifferenceKind::StoryEnded | DifferenceKind::FindingEnded
        );
        let rule = if is_finding { format!("[{aspect}]") } else { String::new() };
        let aspect = if is_finding { "" } else { aspect };
        // The text of a finding starts with its node.
        let subject = if is_finding && values.starts_with(subject.as_str()) { "" } else { subject };
        let parts = [subject, aspect, values.as_str(), note.as_str(), rule.as_str()];
        let text = parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("  ");
        let mut marks =
            [good, bad].map(|value| value.as_ref().map_or(EvidenceMark::default(), |value| value.mark));
        if values.contains('{') {
            marks = marks.map(|mark| EvidenceMark { frame: 0, ..mark });
        }
        text + &evidence_text(marks)
    }

    /// `2000 | 800`; only the value itself if the other capture has none and the section states it.
    fn value_text(&self, difference: &Difference) -> String {
        let value = |value: &Observation| self.cut_text(&value.text);
        match (&difference.good, &difference.bad) {
            (Some(good), Some(bad)) => format!("{} | {}", value(good), value(bad)),
            (Some(only), None) | (None, Some(only)) if difference.section == DifferenceSection::Faults => {
                value(only)
            }
            (Some(good), None) => format!("{} | not seen", value(good)),
            (None, Some(bad)) => format!("not seen | {}", value(bad)),
            (None, None) => String::new(),
        }
    }

    fn cut_text(&self, text: &str) -> String {
        if self.is_complete || text.chars().count() <= SHOWN_VALUE {
            return text.to_owned();
        }
        text.chars().take(SHOWN_VALUE).chain(['…']).collect()
    }
}

/// ` {96}`, ` {96 | 131}`: evidence of the second capture, and of the first one.
fn evidence_text([good, bad]: [EvidenceMark; 2]) -> String {
    let time = bad.time.map_or(String::new(), |time| format!(" at {}", format_seconds(time)));
    match (good.frame, bad.frame) {
        (0, 0) => time,
        (0, frame) => format!("{time} {{{frame}}}"),
        (frame, 0) => format!(" {{{frame} | –}}"),
        (one, other) => format!("{time} {{{one} | {other}}}"),
    }
}

/// Label of a difference.
pub(crate) fn difference_label(difference: &Difference) -> &'static str {
    match (difference.section, &difference.good, &difference.bad) {
        (DifferenceSection::Sequence, ..) => "SEQUENCE",
        (DifferenceSection::Faults, None, _) => "NEW IN BAD",
        (DifferenceSection::Faults, _, None) => "ONLY IN GOOD",
        (DifferenceSection::Faults, ..) => "FAULTS",
        (DifferenceSection::Configuration, ..) => "CONFIGURATION",
        (DifferenceSection::Nodes, ..) => "NODES",
        (DifferenceSection::States, ..) => "STATES",
        (DifferenceSection::SetPoints, ..) => "SET POINTS",
        (DifferenceSection::Timing, ..) => "TIMING",
        (DifferenceSection::Load, ..) => "LOAD",
    }
}

/// Lines after the differences: counts, limits, result.
fn closing_lines(comparison: &CaptureComparison, is_complete: bool) -> Vec<(&'static str, String)> {
    let mut lines = Vec::new();
    let equal: Vec<_> =
        comparison.equal.iter().map(|((_, noun), count)| count_noun(*count, noun.name())).collect();
    if !equal.is_empty() {
        lines.push(("EQUAL", equal.join(", ")));
    }
    for side in [ComparedSide::Good, ComparedSide::Bad] {
        let labels = std::iter::once(not_seen_by(side)).chain(std::iter::repeat(""));
        lines.extend(labels.zip(not_seen(comparison, side, is_complete)));
    }
    lines.extend(comparison.limits.iter().map(|(_, limit)| ("NOT COMPARED", limit.clone())));
    if comparison.is_equal() {
        lines.push(("", "no difference within the tolerances".to_owned()));
    }
    lines
}

/// Label of what one capture never showed.
pub(crate) const fn not_seen_by(side: ComparedSide) -> &'static str {
    match side {
        ComparedSide::Good => "NOT SEEN IN GOOD",
        ComparedSide::Bad => "NOT SEEN IN BAD",
    }
}

/// Text of one subject that was not seen.
fn absence_text(it: &UnobservedSubject) -> String {
    let aspect = if it.aspect.is_empty() { String::new() } else { format!("  {}", it.aspect) };
    let has_frame = it.mark.frame != 0 && !aspect.contains('{');
    let frame = if has_frame { format!(" {{{}}}", it.mark.frame) } else { String::new() };
    let is_named = !it.subject.is_empty() && it.aspect.starts_with(it.subject.as_str());
    let text =
        if is_named { format!("{}{frame}", it.aspect) } else { format!("{}{aspect}{frame}", it.subject) };
    text.trim_start().to_owned()
}

/// Counts by noun; with `-v`, and for findings, error frames and buses, each subject.
fn not_seen(comparison: &CaptureComparison, side: ComparedSide, is_complete: bool) -> Vec<String> {
    let own = || comparison.not_seen.iter().filter(|it| it.by == side && it.weight <= 0.0);
    let is_listed = |noun: SubjectNoun| {
        is_complete || matches!(noun, SubjectNoun::Finding | SubjectNoun::ErrorFrame | SubjectNoun::Bus)
    };
    let mut counts: Vec<(SubjectNoun, u64)> = Vec::new();
    for it in own().filter(|it| !is_listed(it.noun)) {
        match counts.iter_mut().find(|(noun, _)| *noun == it.noun) {
            Some((_, count)) => *count += 1,
            None => counts.push((it.noun, 1)),
        }
    }
    let mut lines: Vec<String> = own().filter(|it| is_listed(it.noun)).map(absence_text).collect();
    let hidden = lines.len().saturating_sub(if is_complete { usize::MAX } else { SHOWN_ABSENT });
    lines.truncate(lines.len() - hidden);
    let mut counts: Vec<_> = counts.into_iter().map(|(noun, count)| count_noun(count, noun.name())).collect();
    if hidden > 0 {
        counts.push(count_noun(hidden as u64, "further finding"));
    }
    if !counts.is_empty() {
        lines.push(counts.join(", "));
    }
    lines
}
