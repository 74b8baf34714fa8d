//! Reports on checked captures, one module per format.
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
pub mod jsonl;
mod junit;
pub mod records;
mod report;
mod sarif;
mod text;

pub use format::{FindingFormat, FindingTextOptions};
pub use report::{CaptureOutcome, CapturePart, CaptureResult, FindingStanding, FindingsReport, RuleCoverage};

/// All findings formats.
pub const FINDING_FORMATS: &[FindingFormat] =
    &[text::FORMAT, jsonl::FORMAT, junit::FORMAT, sarif::FORMAT, github::FORMAT];
