//! Options of `objects`.

use std::path::PathBuf;

use clap::Args;

use crate::run::arguments::{InputArgs, NODE_HELP, ReportFormat, examples};
use crate::select::RangeBound;

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope objects customer.log",
    "cobscope objects --node 5 --at 12.5 customer.log",
    "cobscope objects --node 5 --want pump.dcf customer.log",
];

/// Print the object values of nodes, with their origin
///
/// Without --node, the nodes with known objects are listed. --node 5 selects the node; --node 5=PROFILE
/// assigns its profile. They can be combined. Long names and values are truncated; -f json contains them
/// completely.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
#[command(mut_arg("node", |arg| arg.value_name("[BUS:]ID[=PROFILE]").help(NODE_HELP)))]
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
