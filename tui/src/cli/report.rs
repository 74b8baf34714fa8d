//! `cobscope report`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};

use super::input::parse_count;
use super::{InputArgs, SelectArgs};

/// `cobscope report`.
#[derive(Debug, Args)]
pub struct ReportArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub select: SelectArgs,
    /// Report on the fleet of a lake (cobscope lake add): machines by week, worst stories, captures; HTML only
    #[cfg(feature = "parquet")]
    #[arg(
        long,
        value_name = "DIR",
        conflicts_with_all = ["captures", "format", "story", "finding", "attach"]
    )]
    pub lake: Option<PathBuf>,
    /// Write to FILE instead of stdout; for a folder or several captures, the folder of the pages; earlier
    /// pages are replaced, no other file
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "html")]
    pub format: PageStyle,
    /// Report story N only; stories are numbered as by why
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub story: Option<std::num::NonZeroUsize>,
    /// Report only stories with a finding: the name of its rule, or its number, the key finding
    /// of check -f jsonl
    #[arg(long, value_name = "RULE|NUMBER", conflicts_with = "story")]
    pub finding: Option<FindingArg>,
    /// Add the frames around the claims as pcapng with comments: next to the page, with a bus file of the state before
    /// them, or embedded in the page
    #[arg(
        long,
        value_name = "WHERE",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "file"
    )]
    pub attach: Option<AttachPlace>,
}

impl ReportArgs {
    /// Whether a lake is reported on, in place of captures.
    pub fn has_lake(&self) -> bool {
        #[cfg(feature = "parquet")]
        return self.lake.is_some();
        #[cfg(not(feature = "parquet"))]
        return false;
    }
}

/// Formats of `report`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PageStyle {
    /// One HTML page without scripts, for screen and A4
    Html,
    /// Markdown for issue trackers, without plots
    Md,
}

/// Place of the cut-out capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AttachPlace {
    /// A file next to the page: case.pcapng for case.html
    File,
    /// In the page (HTML)
    Embedded,
}

/// A finding to report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FindingArg {
    /// Number in order of appearance.
    Id(u64),
    /// Name of the rule.
    Rule(String),
}

impl FromStr for FindingArg {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(text.parse().map_or_else(|_| Self::Rule(text.to_owned()), Self::Id))
    }
}
