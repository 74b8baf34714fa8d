//! `cobscope objects`.

use std::path::PathBuf;

use clap::Args;

use super::{InputArgs, ReportFormat};
use crate::select::RangeBound;

/// `cobscope objects`.
#[derive(Debug, Args)]
pub struct ObjectsArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Print values at TIME: 12.5 (seconds from the first frame), #1234 (frame), 22:13:25, a date, or
    /// both (default: end)
    #[arg(long, value_name = "TIME")]
    pub at: Option<RangeBound>,
    /// Compare with the values that a DCF or XDC configures for --node, or for the node of the file
    #[arg(long, value_name = "FILE")]
    pub want: Option<PathBuf>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}
