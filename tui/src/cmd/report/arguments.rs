//! Options of `report`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};

use crate::run::arguments::{
    InputArgs, NODE_HELP, SelectArgs, examples, finding_filter_help, from_help, parse_count,
};

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope report customer.log -o case.html",
    "cobscope report --node 2=rexroth-sydfec --story 1 --attach customer.log -o case.html",
    "cobscope report captures/ -o reports/",
];

/// Write a page with the claim, its evidence and its origin, to mail and print
///
/// The page contains the stories of why with numbered frames, plots, object values, manual sections,
/// assumptions, quality and hashes of the capture; it needs no script and no network. For a folder or
/// several captures, --output names a folder: it gets one page per capture and an index page. --node 5
/// selects the node; --node 5=PROFILE assigns its profile.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
#[command(mut_arg("node", |arg| arg.value_name("[BUS:]ID[=PROFILE]").help(NODE_HELP)))]
#[command(mut_arg("filter", |arg| arg.help("Report only findings that match EXPR").long_help(finding_filter_help!("Report only findings that match EXPR"))))]
#[command(mut_arg("from", |arg| arg.help("Report only findings present from WHEN on: 12.5 (seconds), #1234 (frame), 22:13:25, a date, or both").long_help(from_help!("Report only findings present from WHEN on"))))]
#[command(mut_arg("to", |arg| arg.help("Report only findings present up to WHEN, in the form of --from")))]
#[command(mut_arg("only_node", |arg| arg.help("Report only findings of a node: 5, can0:5, sa:0x80 (repeatable)")))]
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
