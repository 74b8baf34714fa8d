//! Declaration of a rule: name, severity, tolerances and documentation, taken from the file of the rule.

use std::sync::Arc;

use crate::event::KindSet;
use crate::finding::documentation::section_text;
use crate::finding::{MergedFindings, RuleInfo, RuleOrigin, Severity};

/// Headings of every rule documentation, in this order.
pub const HEADINGS: [&str; 5] =
    ["What it checks", "Why it matters", "Source", "What to look at first", "Mutation"];

/// A limit of a rule that the bus file can change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Key in `[rules.<name>]`.
    pub key: &'static str,
    /// Value without a setting in the bus file.
    pub default: f64,
    /// Unit: `ms`, `%`, empty for a count.
    pub unit: &'static str,
    /// Meaning of the limit.
    pub text: &'static str,
}

/// PDOs that a rule receives; all but [`All`](Self::All) are without remote requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PdoSubset {
    /// PDOs of both directions and remote requests.
    All,
    /// PDOs that nodes transmit.
    Transmitted,
    /// PDOs that nodes receive.
    Received,
    /// PDOs that nodes receive, with a changed payload.
    ReceivedChanged,
    /// PDOs with a confirmed mapping.
    Mapped,
    /// PDOs with a changed payload.
    Changed,
}

/// SDO transfers that a rule receives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransferSubset {
    /// Transfers of any object.
    All,
    /// Transfers of objects in the communication profile area (CiA 301 §7.4.1).
    Communication,
}

/// Declaration of a general rule.
#[derive(Debug, Clone, Copy)]
pub struct Declaration {
    /// Name in kebab-case; it names the defect.
    pub name: &'static str,
    /// Maximum severity of a finding.
    pub severity: Severity,
    /// Title: the defect in at most eight words.
    pub title: &'static str,
    /// Documentation: doc comment of the rule.
    pub explanation: &'static str,
    /// Event kinds that the rule receives.
    pub kinds: KindSet,
    /// PDOs that the rule receives, if `kinds` contains PDOs.
    pub pdos: PdoSubset,
    /// SDO transfers that the rule receives, if `kinds` contains them.
    pub transfers: TransferSubset,
    /// What a capture must contain for a verdict of the rule.
    pub needs: &'static str,
    /// Cases of CiA's conformance test plan that the rule checks.
    pub cases: &'static [&'static str],
    /// Subset of `cases` to which every verdict of the rule applies. For each other case, the rule decides
    /// per verdict, or only a marked test run shows it.
    pub shows: &'static [&'static str],
    /// Limits that the bus file can change.
    pub tolerances: &'static [Tolerance],
    /// The rule checks times.
    pub is_timing: bool,
    /// The rule does not receive events with frames before and after a hole: frames may be missing in it.
    pub skips_holes: bool,
    /// Which of its findings are printed as one, if they have the same reason.
    pub merge: MergedFindings,
    /// The rule is active by default.
    pub is_on: bool,
    /// KIND column of its events in text output, at most six letters.
    pub word: &'static str,
}

impl Declaration {
    /// Defaults of all fields.
    pub const PLAIN: Self = Self {
        name: "",
        severity: Severity::Warning,
        title: "",
        explanation: "",
        kinds: KindSet::NONE,
        pdos: PdoSubset::All,
        transfers: TransferSubset::All,
        needs: "",
        cases: &[],
        shows: &[],
        tolerances: &[],
        is_timing: false,
        skips_holes: false,
        merge: MergedFindings::Index,
        is_on: true,
        word: "RULE",
    };

    /// Description of the rule for output.
    pub fn rule_info(&self) -> RuleInfo {
        RuleInfo {
            name: self.name.into(),
            severity: self.severity,
            title: self.title.into(),
            explanation: self.explanation.into(),
            needs: self.needs.into(),
            cases: self.cases.iter().map(|case| Arc::from(*case)).collect(),
            shows: self.shows.iter().map(|case| Arc::from(*case)).collect(),
            origin: RuleOrigin::General,
            is_timing: self.is_timing,
            merge: self.merge,
            is_on: self.is_on,
            word: self.word,
            // Both are in the documentation.
            source: None,
            next_step: None,
        }
    }

    /// Documentation for display, with what the rule needs in a capture.
    pub fn manual_text(&self) -> String {
        let mut letters = self.needs.chars();
        let first = letters.next().map(|first| first.to_ascii_uppercase());
        let needs: String = first.into_iter().chain(letters).collect();
        format_manual(self.explanation).replacen(
            "# Why it matters",
            &format!("# Needs\n{needs}.\n\n# Why it matters"),
            1,
        )
    }

    /// Text below a heading of the documentation.
    pub fn doc_section(&self, heading: &str) -> Option<&'static str> {
        section_text(self.explanation, heading)
    }
}

/// All headings with their text, each joined to one paragraph.
pub fn all_sections(explanation: &str) -> Vec<(&str, String)> {
    let mut all: Vec<(&str, String)> = Vec::new();
    for line in explanation.lines() {
        match (line.strip_prefix("# "), all.last_mut()) {
            (Some(heading), _) => all.push((heading.trim(), String::new())),
            (None, Some((_, text))) if !line.trim().is_empty() => {
                if !text.is_empty() {
                    text.push(' ');
                }
                text.push_str(line.trim());
            }
            _ => {}
        }
    }
    all
}

/// Documentation for display: without leading blanks and without the section for tests.
pub fn format_manual(explanation: &str) -> String {
    let lines = explanation.lines().map(|line| line.strip_prefix(' ').unwrap_or(line));
    let lines: Vec<_> =
        lines.take_while(|line| line.trim().strip_prefix("# ") != HEADINGS.last().copied()).collect();
    lines.join("\n").trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_end_at_the_next_heading() {
        let text = " # One\n a b\n c\n # Two\n d\n";
        assert_eq!(section_text(text, "One").map(str::trim), Some("a b\n c"));
        assert_eq!(section_text(text, "Two").map(str::trim), Some("d"));
        assert_eq!(section_text(text, "Three"), None);
        assert_eq!(format_manual(" # One\n a b\n\n # Mutation\n d\n"), "# One\na b");
    }
}
