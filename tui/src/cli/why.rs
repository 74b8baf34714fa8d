//! `cobscope why`.

use clap::Args;

use super::input::parse_count;
use super::{InputArgs, ReportFormat, SelectArgs};
use crate::select::RangeBound;

/// `cobscope why`.
#[derive(Debug, Args)]
pub struct WhyArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub select: SelectArgs,
    /// Show the latest story before TIME: 12.5 (seconds from the first frame), #1234 (frame), 22:13:25, a date,
    /// or both
    #[arg(long, value_name = "TIME")]
    pub at: Option<RangeBound>,
    /// Show story N only; stories are numbered by importance
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub story: Option<std::num::NonZeroUsize>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}
