//! `cobscope view`.

use std::path::PathBuf;

use clap::Args;
use cobscope_decoder::query::Filter;

use super::{Color, InputArgs, filter_help};
use crate::panes::{PaneId, PaneLayout};
use crate::select::RangeBound;
use crate::theme::ThemeName;

/// `cobscope view`.
#[derive(Debug, Args)]
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

/// Options for the screen.
#[derive(Debug, Args)]
pub struct ScreenArgs {
    /// Show PANE first (default: events)
    #[arg(long, value_name = "PANE")]
    pub pane: Option<PaneId>,
    /// Show the panes of LAYOUT together (default: one; in a large terminal diagnose)
    #[arg(long, value_name = "LAYOUT")]
    pub layout: Option<PaneLayout>,
    /// Use colours for a dark or light background (default: auto)
    #[arg(long, value_name = "THEME")]
    pub theme: Option<ThemeName>,
    /// Show only ASCII characters; others become their substitute or ?
    #[arg(long)]
    pub ascii: bool,
}
