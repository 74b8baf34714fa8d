//! `cobscope objects`.

use std::path::PathBuf;

use clap::Args;

use super::{InputArgs, ReportFormat};
use crate::select::Bound;

/// `cobscope objects`.
#[derive(Debug, Args)]
pub struct ObjectsArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Show them as they were then: 12.5 (seconds from the first frame), #1234 (frame), or a date and time
    #[arg(long, value_name = "TIME")]
    pub at: Option<Bound>,
    /// Compare them with what a DCF or XDC wants of --node, else of the node of that file
    #[arg(long, value_name = "FILE")]
    pub want: Option<PathBuf>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}
