//! What differs from a baseline.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

/// A finding that is accepted.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Known {
    /// Name of the capture.
    pub capture: String,
    /// Which finding.
    pub fingerprint: String,
    /// How bad it was.
    pub severity: String,
    /// How often it was seen.
    pub count: u64,
    /// What it said.
    pub text: String,
}

impl Known {
    /// `error node-lost|can0|5: silent since {10}`.
    pub fn line(&self) -> String {
        format!("{} {}: {}", self.severity, self.fingerprint, self.text)
    }
}

/// What differs from the baseline.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Comparison {
    /// Groups it has, at least as severe.
    pub accepted: BTreeSet<u64>,
    /// Findings it has that did not come again.
    pub gone: Vec<Known>,
    /// Rules it saw exercised, which are not any more.
    pub silent: Vec<String>,
}
