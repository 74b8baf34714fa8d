//! Rows of `hypotheses.toml`.

use std::sync::OnceLock;

use serde::Deserialize;

use crate::finding::{MergedFindings, RuleInfo, RuleOrigin, Severity};
use crate::profile::read_compiled;

/// A failure mode of a part of the machine.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct Hypothesis {
    /// Name, as that of a rule.
    pub id: String,
    /// Part of the machine that fails.
    pub component: String,
    /// How it fails.
    pub mode: String,
    /// Highest severity of the conclusion.
    severity: RowSeverity,
    /// The defect in at most eight words.
    pub title: String,
    /// Whose findings are its consequences.
    #[serde(default)]
    pub explains: ExplainedFindings,
    /// Rules whose findings state the same failure, in place of the conclusion.
    #[serde(default)]
    pub stated_by: Vec<String>,
    /// What the capture must show.
    pub observed: String,
    /// What to do for exactly this cause, most likely first.
    pub steps: Vec<String>,
    /// What to record or read to confirm it.
    pub record: String,
    /// Clauses.
    pub source: String,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum RowSeverity {
    Error,
    Warning,
}

/// Findings that a failure explains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ExplainedFindings {
    /// None: a rule that reports the same failure says it in its place.
    #[default]
    Same,
    /// Those of its nodes.
    Own,
    /// Those of its nodes, and those of all nodes about times and communication.
    Bus,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct HypothesesFile {
    hypothesis: Vec<Hypothesis>,
}

impl Hypothesis {
    /// The row as a rule of findings.
    pub fn rule_info(&self) -> RuleInfo {
        RuleInfo {
            name: self.id.as_str().into(),
            severity: match self.severity {
                RowSeverity::Error => Severity::Error,
                RowSeverity::Warning => Severity::Warning,
            },
            title: self.title.as_str().into(),
            explanation: self.manual_text().into(),
            needs: "periodic messages with times".into(),
            cases: Vec::new(),
            shows: Vec::new(),
            origin: RuleOrigin::Conclusion,
            is_timing: true,
            merge: MergedFindings::Subject,
            is_on: true,
            word: "RULE",
            source: Some(self.source.as_str().into()),
            next_step: self.steps.first().map(|step| step.as_str().into()),
        }
    }

    /// The row as text in Markdown.
    pub fn manual_text(&self) -> String {
        let steps: String = self.steps.iter().map(|step| format!("- {step}\n")).collect();
        format!(
            "# What it concludes\n{} ({}: {}).\n\n# What the capture must show\n{}\n\n# What to do\n{steps}\n# What to record next\n{}\n\n# Source\n{}",
            self.title, self.component, self.mode, self.observed, self.record, self.source
        )
    }
}

/// All rows, in the order of the file.
pub fn all_hypotheses() -> &'static [Hypothesis] {
    static ROWS: OnceLock<Vec<Hypothesis>> = OnceLock::new();
    // A unit test checks that the file is valid; an invalid file would yield no conclusions.
    ROWS.get_or_init(|| {
        read_compiled::<HypothesesFile>(include_str!(concat!(env!("OUT_DIR"), "/hypotheses")))
            .map_or_else(|_| Vec::new(), |file| file.hypothesis)
    })
}

/// The row with this name.
pub fn find_hypothesis(id: &str) -> Option<&'static Hypothesis> {
    all_hypotheses().iter().find(|row| row.id == id)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rows_are_valid_and_differ() {
        let text = toml::from_str::<HypothesesFile>(include_str!("hypotheses.toml")).unwrap();
        assert_eq!(all_hypotheses(), text.hypothesis);
        let mut names: Vec<_> = all_hypotheses().iter().map(|row| row.id.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), all_hypotheses().len());
        for row in all_hypotheses() {
            assert!(!row.steps.is_empty() && row.title.split(' ').count() <= 8, "{}", row.id);
        }
    }
}
