//! `cobscope view`.

use clap::{Args, ValueEnum};
use cobscope_decoder::query::Filter;

use super::{Color, InputArgs, filter_help};
use crate::panes::PaneId;
use crate::select::Bound;

/// `cobscope view`.
#[derive(Debug, Args)]
pub struct ViewArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Where to begin: 12.5 (seconds from the first frame), #1234 (frame), or a date and time
    #[arg(long, value_name = "TIME")]
    pub at: Option<Bound>,
    /// Show only events that EXPR matches, such as 'kind == emcy && node == 4'
    #[arg(long, value_name = "EXPR", long_help = filter_help!("Show", "--all"))]
    pub filter: Option<Filter>,
    /// Show repetitions too, not only what says something new
    #[arg(long)]
    pub all: bool,
    /// Let captures begin at the same moment, whatever their dates
    #[arg(long)]
    pub align: bool,
    #[command(flatten)]
    pub screen: ScreenArgs,
    /// Colours: auto uses them unless NO_COLOR is set
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    pub color: Color,
}

/// How the screen looks.
#[derive(Debug, Args)]
pub struct ScreenArgs {
    /// Pane shown first
    #[arg(long, value_name = "PANE", default_value = "events")]
    pub pane: PaneId,
    /// What the terminal's background is
    #[arg(long, value_name = "THEME", default_value = "dark")]
    pub theme: ThemeName,
    /// Draw lines and plots with ASCII characters
    #[arg(long)]
    pub ascii: bool,
}

/// What the terminal's background is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ThemeName {
    /// Light text on dark ground
    Dark,
    /// Dark text on light ground
    Light,
}
