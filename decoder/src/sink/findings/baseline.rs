//! Baseline: a file of known and accepted findings, one line per finding, sorted for readable diffs.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

pub use super::comparison::{BaselineComparison, KnownFinding};
use super::report::{CaptureResult, FindingStanding, FindingsReport};
use crate::finding::{RuleOutcome, Severity};

/// Version of the file format.
const VERSION: u32 = 1;

/// Findings and verdicts of captures when the file was written.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    version: u32,
    findings: Vec<KnownFinding>,
    verdicts: Vec<KnownVerdict>,
}

/// Verdict of an exercised rule.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KnownVerdict {
    capture: String,
    rule: String,
    verdict: String,
}

/// Captures of an earlier baseline that were not checked this time.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct UnjudgedCaptures {
    /// Number of captures whose entries are kept.
    pub kept: usize,
    /// Captures whose entries are dropped.
    pub dropped: Vec<String>,
}

impl Baseline {
    /// Parses a baseline file.
    ///
    /// # Errors
    /// A message with line and column if `text` is not a valid baseline.
    pub fn parse_baseline(text: &str) -> Result<Self, String> {
        let baseline: Self = serde_json::from_str(text).map_err(|error| plain_error(&error))?;
        if baseline.version != VERSION {
            return Err(format!("version {}; expected {VERSION}", baseline.version));
        }
        let unknown = baseline.findings.iter().find(|known| parse_severity(&known.severity).is_none());
        match unknown {
            Some(known) => Err(format!("{}: unknown severity '{}'", known.fingerprint, known.severity)),
            None => Ok(baseline),
        }
    }

    /// Baseline of a report; suppressed findings are not included.
    pub fn baseline_of(report: &FindingsReport) -> Self {
        let mut baseline = Self { version: VERSION, ..Self::default() };
        for judged in report.captures.iter().filter(|judged| judged.failure.is_none()) {
            let capture = portable_name(&judged.capture);
            let groups = judged.findings.groups.iter();
            let groups = groups.filter(|group| {
                matches!(judged.standing_of(group), FindingStanding::New | FindingStanding::Accepted)
            });
            baseline.findings.extend(groups.map(|group| KnownFinding {
                capture: capture.clone(),
                fingerprint: group.fingerprint(),
                severity: group.severity.name().to_owned(),
                count: group.count,
                text: group.text.clone(),
            }));
            let exercised = judged.rules().filter(|(_, tally)| tally.verdict() != RuleOutcome::NotExercised);
            baseline.verdicts.extend(exercised.map(|(rule, tally)| KnownVerdict {
                capture: capture.clone(),
                rule: rule.name.to_string(),
                verdict: tally.verdict().name().to_owned(),
            }));
        }
        baseline.findings.sort();
        baseline.verdicts.sort();
        baseline
    }

    /// Content of the file: one line per finding.
    pub fn baseline_text(&self) -> String {
        let list = |lines: Vec<String>| {
            if lines.is_empty() { String::new() } else { format!("\n    {}\n  ", lines.join(",\n    ")) }
        };
        let line = |known: serde_json::Result<String>| known.unwrap_or_default();
        let findings = self.findings.iter().map(|known| line(serde_json::to_string(known)));
        let verdicts = self.verdicts.iter().map(|known| line(serde_json::to_string(known)));
        format!(
            "{{\n  \"version\": {},\n  \"findings\": [{}],\n  \"verdicts\": [{}]\n}}\n",
            self.version,
            list(findings.collect()),
            list(verdicts.collect())
        )
    }

    /// Compares all captures of a report with the baseline.
    pub fn compare_report(&self, report: &mut FindingsReport) {
        report.has_baseline = true;
        for judged in &mut report.captures {
            judged.comparison = self.compare_capture(judged);
        }
        report.absent = self.unchecked_captures(report);
    }

    /// Copies the entries of `before` for captures that were not checked, if `is_there` is true for the
    /// capture.
    pub fn keep_entries(
        &mut self,
        before: &Self,
        report: &FindingsReport,
        is_there: impl Fn(&str) -> bool,
    ) -> UnjudgedCaptures {
        let mut others = UnjudgedCaptures::default();
        for capture in before.unchecked_captures(report) {
            if !is_there(&capture) {
                others.dropped.push(capture);
                continue;
            }
            others.kept += 1;
            let findings = before.findings.iter().filter(|known| known.capture == capture);
            self.findings.extend(findings.cloned());
            let verdicts = before.verdicts.iter().filter(|known| known.capture == capture);
            self.verdicts.extend(verdicts.cloned());
        }
        self.findings.sort();
        self.verdicts.sort();
        others
    }

    /// Captures of the baseline that were not checked.
    fn unchecked_captures(&self, report: &FindingsReport) -> Vec<String> {
        let judged: BTreeSet<String> =
            report.captures.iter().map(|one| portable_name(&one.capture)).collect();
        let known = self.verdicts.iter().map(|known| &known.capture);
        let known: BTreeSet<_> = known.chain(self.findings.iter().map(|known| &known.capture)).collect();
        known.into_iter().filter(|capture| !judged.contains(*capture)).cloned().collect()
    }

    fn compare_capture(&self, judged: &CaptureResult) -> BaselineComparison {
        let mut comparison = BaselineComparison::default();
        // After an incomplete read no finding can be reported as gone.
        if judged.failure.is_some() && judged.findings.rules.is_empty() {
            return comparison;
        }
        let capture = portable_name(&judged.capture);
        let own = self.findings.iter().filter(|known| known.capture == capture);
        let known: BTreeMap<&str, &KnownFinding> =
            own.map(|known| (known.fingerprint.as_str(), known)).collect();
        let mut seen = BTreeSet::new();
        for group in &judged.findings.groups {
            let fingerprint = group.fingerprint();
            let Some((name, known)) = known.get_key_value(fingerprint.as_str()) else { continue };
            seen.insert(*name);
            if parse_severity(&known.severity).is_some_and(|severity| group.severity <= severity) {
                comparison.accepted.insert(group.id);
            }
        }
        if judged.failure.is_some() {
            return comparison;
        }
        let gone = known.into_iter().filter(|(name, _)| !seen.contains(name));
        comparison.gone = gone.map(|(_, known)| known.clone()).collect();
        let exercised = judged.rules().filter(|(_, tally)| tally.verdict() != RuleOutcome::NotExercised);
        let exercised: BTreeSet<Arc<str>> = exercised.map(|(rule, _)| Arc::clone(&rule.name)).collect();
        let before = self.verdicts.iter().filter(|known| known.capture == capture);
        let silent = before.filter(|known| !exercised.contains(known.rule.as_str()));
        comparison.silent = silent.map(|known| known.rule.clone()).collect();
        comparison
    }
}

/// JSON parser message without Rust terms.
fn plain_error(error: &serde_json::Error) -> String {
    let text = error.to_string();
    let text = match text.strip_prefix("EOF while parsing ") {
        Some(rest) => format!("the file ends inside {rest}"),
        None => text,
    };
    [
        ("expected struct Baseline", "expected an object"),
        ("expected struct", "expected"),
        ("expected a sequence", "expected a list"),
        ("invalid type: ", "found "),
        ("found map", "found an object"),
    ]
    .iter()
    .fold(text, |text, (jargon, word)| text.replace(jargon, word))
}

fn parse_severity(name: &str) -> Option<Severity> {
    [Severity::Note, Severity::Warning, Severity::Error].into_iter().find(|severity| severity.name() == name)
}

/// Capture name that is equal on all systems: `./a\b.log` becomes `a/b.log`.
pub(crate) fn portable_name(capture: &str) -> String {
    let path = if cfg!(windows) { capture.replace('\\', "/") } else { capture.to_owned() };
    let path = path.trim_start_matches("./");
    path.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_baseline_can_be_written_and_parsed() {
        let known = KnownFinding {
            capture: "a.log".into(),
            fingerprint: "node-lost|can0|5".into(),
            severity: "error".into(),
            count: 2,
            text: "silent \u{1b}".into(),
        };
        let verdict =
            KnownVerdict { capture: "a.log".into(), rule: "node-lost".into(), verdict: "fail".into() };
        let baseline = Baseline { version: 1, findings: vec![known; 2], verdicts: vec![verdict] };
        let text = baseline.baseline_text();
        assert_eq!(Baseline::parse_baseline(&text).unwrap(), baseline);
        assert_eq!(text.lines().count(), 10, "{text}");
        let empty = Baseline { version: 1, ..Baseline::default() };
        assert_eq!(Baseline::parse_baseline(&empty.baseline_text()).unwrap(), empty);
    }

    #[test]
    fn an_invalid_baseline_is_rejected_with_its_position() {
        let error = Baseline::parse_baseline("{\n  \"version\": 1,\n  x\n}").unwrap_err();
        assert!(error.contains("line 3 column 3"), "{error}");
        let cut = Baseline::parse_baseline("{\"version\": 1,").unwrap_err();
        assert_eq!(cut, "the file ends inside a value at line 1 column 14");
        let text = "{\"version\": 9, \"findings\": [], \"verdicts\": []}";
        assert_eq!(Baseline::parse_baseline(text).unwrap_err(), "version 9; expected 1");
    }

    #[test]
    fn capture_names_are_portable() {
        assert_eq!(portable_name("./fixtures/a.log"), "fixtures/a.log");
        assert_eq!(portable_name("../a.log"), "../a.log");
    }
}
