//! `cobscope why`.

use clap::Args;

use super::{InputArgs, ReportFormat};
use crate::select::Bound;

/// `cobscope why`.
#[derive(Debug, Args)]
pub struct WhyArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Look from this moment back, for the latest fault: 12.5 (seconds from the first frame), #1234 (frame), or a date and time
    #[arg(long, value_name = "TIME")]
    pub at: Option<Bound>,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: ReportFormat,
}
