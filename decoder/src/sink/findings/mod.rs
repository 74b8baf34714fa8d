//! What was judged of captures, one format a file.
//!
//! ```text
//! Findings of each capture ─compare─▶ Report ─▶ text, jsonl, junit, sarif, github
//!                  baseline ───┘
//! ```

pub mod baseline;
mod comparison;
mod conformance;
mod coverage;
mod format;
mod github;
pub mod incident;
pub mod jsonl;
mod junit;
mod report;
mod sarif;
mod text;

pub use format::{FindingFormat, TextOptions};
pub use report::{Coverage, Judged, Outcome, Report, Standing, moment, notes, what, when, who};

/// All formats of findings.
pub const FINDING_FORMATS: &[FindingFormat] =
    &[text::FORMAT, jsonl::FORMAT, junit::FORMAT, sarif::FORMAT, github::FORMAT];
