//! Differences from a baseline.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

/// A finding in the baseline.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KnownFinding {
    /// Name of the capture.
    pub capture: String,
    /// Fingerprint of the finding.
    pub fingerprint: String,
    /// Severity when the baseline was written.
    pub severity: String,
    /// Number of occurrences when the baseline was written.
    pub count: u64,
    /// Finding text.
    pub text: String,
}

impl KnownFinding {
    /// `error node-lost|can0|5: silent since {10}`.
    pub fn known_line(&self) -> String {
        format!("{} {}: {}", self.severity, self.fingerprint, self.text)
    }
}

/// Differences between a capture and the baseline.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct BaselineComparison {
    /// Ids of groups that are in the baseline with at least the same severity.
    pub accepted: BTreeSet<u64>,
    /// Findings in the baseline that did not occur.
    pub gone: Vec<KnownFinding>,
    /// Rules exercised in the baseline but not in this run.
    pub silent: Vec<String>,
}
