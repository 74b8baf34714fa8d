//! Options of `view`.

use std::path::PathBuf;

use clap::Args;
use cobscope_decoder::query::Filter;

use crate::run::arguments::{Color, InputArgs, examples, filter_help};
use crate::run::screen::ScreenArgs;
use crate::select::RangeBound;

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope view customer.log",
    "cobscope view --node 2=rexroth-sydfec --pane signals a.log b.log",
    "cobscope view --layout list --at 12.5 --filter 'node == 5' customer.log",
];

/// Show captures in a terminal UI: events, nodes, signals and findings at any moment
///
/// Several captures are merged by time. Press ? for the list of keys.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ViewArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Start at TIME: 12.5 (seconds from the first frame), #1234 (frame), 22:13:25, a date, or both
    /// (default: most likely cause, else first frame)
    #[arg(long, value_name = "TIME")]
    pub at: Option<RangeBound>,
    /// Show only events that match EXPR, such as 'kind == emcy && node == 4'
    #[arg(long, value_name = "EXPR", long_help = filter_help!("Show", "--all"))]
    pub filter: Option<Filter>,
    /// Also show repeated events, not only new information
    #[arg(long)]
    pub all: bool,
    /// Mark nodes, objects and findings that differ from GOOD, a capture or a folder with its parts
    ///
    /// The captures are compared as by diff GOOD CAPTURE, in the background.
    #[arg(long, value_name = "GOOD")]
    pub against: Option<PathBuf>,
    /// Align the start of captures that have unrelated clocks
    #[arg(long)]
    pub align: bool,
    #[command(flatten)]
    pub screen: ScreenArgs,
    /// Use colours; auto: unless NO_COLOR is set
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    pub color: Color,
}
