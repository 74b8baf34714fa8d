//! What a rule says of itself, in the doc comment of its file: the one place its name, severity, tolerances
//! and explanation are written.

use std::sync::Arc;

use crate::finding::{RuleInfo, RuleOrigin, Severity};

/// Headings of every explanation, in this order.
pub const HEADINGS: [&str; 5] =
    ["What it checks", "Why it matters", "Source", "What to look at first", "Mutation"];

/// A tolerance the bus file can set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Key in `[rules.<name>]`.
    pub key: &'static str,
    /// Value where nothing is set.
    pub default: f64,
    /// Unit: `ms`, `%`, empty for a count.
    pub unit: &'static str,
    /// What it limits.
    pub text: &'static str,
}

/// What a general rule says of itself.
#[derive(Debug, Clone, Copy)]
pub struct Declaration {
    /// Name in kebab-case: it says the defect.
    pub name: &'static str,
    /// How bad a finding is at most.
    pub severity: Severity,
    /// The defect in a line.
    pub title: &'static str,
    /// Doc comment.
    pub explanation: &'static str,
    /// Kinds of events it looks at. Of PDOs, `tpdo` and `rpdo` mean those of one direction, `pdo-changed` those with
    /// another payload, all without requests; `pdo-request` requests alone.
    pub kinds: &'static [&'static str],
    /// Cases of CiA's test plan it judges.
    pub cases: &'static [&'static str],
    /// Those of them that any verdict of it is one of. Of the others it says which it is one of, or only a marked test
    /// run tells.
    pub shows: &'static [&'static str],
    /// What can be set.
    pub tolerances: &'static [Tolerance],
    /// It judges times.
    pub is_timing: bool,
    /// It is used without being asked for.
    pub is_on: bool,
    /// KIND of its line in text, at most six letters.
    pub word: &'static str,
}

impl Declaration {
    /// What a declaration says where it says nothing.
    pub const PLAIN: Self = Self {
        name: "",
        severity: Severity::Warning,
        title: "",
        explanation: "",
        kinds: &[],
        cases: &[],
        shows: &[],
        tolerances: &[],
        is_timing: false,
        is_on: true,
        word: "RULE",
    };

    /// The same as output needs it.
    pub fn info(&self) -> RuleInfo {
        RuleInfo {
            name: self.name.into(),
            severity: self.severity,
            title: self.title.into(),
            explanation: self.explanation.into(),
            cases: self.cases.iter().map(|case| Arc::from(*case)).collect(),
            shows: self.shows.iter().map(|case| Arc::from(*case)).collect(),
            origin: RuleOrigin::General,
            is_timing: self.is_timing,
            is_on: self.is_on,
            word: self.word,
            source: self.section("Source").map(|text| text.trim().into()),
        }
    }

    /// The text under a heading.
    pub fn section(&self, heading: &str) -> Option<&'static str> {
        section(self.explanation, heading)
    }
}

/// The text under a heading of an explanation.
pub fn section<'a>(explanation: &'a str, heading: &str) -> Option<&'a str> {
    let mut at = 0;
    for line in explanation.split_inclusive('\n') {
        at += line.len();
        if line.trim().strip_prefix("# ") == Some(heading) {
            let rest = explanation.get(at..)?;
            let end = rest.find("\n # ").or_else(|| rest.find("\n# ")).unwrap_or(rest.len());
            return rest.get(..end);
        }
    }
    None
}

/// Headings with their text, each in one paragraph.
pub fn sections(explanation: &str) -> Vec<(&str, String)> {
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

/// An explanation as it is read: without the blank each line begins with, and without what is for tests only.
pub fn manual(explanation: &str) -> String {
    let lines = explanation.lines().map(|line| line.strip_prefix(' ').unwrap_or(line));
    let lines: Vec<_> = lines.take_while(|line| line.trim() != "# Mutation").collect();
    lines.join("\n").trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sections_end_at_the_next_heading() {
        let text = " # One\n a b\n c\n # Two\n d\n";
        assert_eq!(section(text, "One").map(str::trim), Some("a b\n c"));
        assert_eq!(section(text, "Two").map(str::trim), Some("d"));
        assert_eq!(section(text, "Three"), None);
        assert_eq!(manual(" # One\n a b\n\n # Mutation\n d\n"), "# One\na b");
    }
}
