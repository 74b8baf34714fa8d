//! `cobscope live`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::duration::parse_duration;
use super::size::{parse_size, part_bytes};
use super::trigger::TriggerArgs;
use super::view::ScreenArgs;
use super::{FailOn, InputArgs, PrintArgs, SelectArgs};

/// `cobscope live`.
#[derive(Debug, Args)]
pub struct LiveArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub select: SelectArgs,
    /// Print events instead of showing them in the terminal UI
    #[arg(long)]
    pub print: bool,
    #[command(flatten)]
    pub lines: PrintArgs,
    /// Run rules, print findings and a summary as check does; exit with 1 for findings at or above --fail-on
    #[arg(long)]
    pub check: bool,
    /// Exit with status 1 for findings at or above SEVERITY
    #[arg(long, value_name = "SEVERITY", default_value = "error", requires = "check")]
    pub fail_on: FailOn,
    /// Stop at the first finding at or above --fail-on
    ///
    /// No later frame is decoded, counted or judged, except those of an open window of --trigger. --record can contain
    /// later frames.
    #[arg(long, requires = "check")]
    pub until_finding: bool,
    /// Stop after N frames (default: never)
    #[arg(short = 'n', value_name = "N")]
    pub frames_wanted: Option<u64>,
    /// Stop after MS milliseconds without a frame (default: never)
    #[arg(short = 'T', value_name = "MS", value_parser = clap::value_parser!(u64).range(1..))]
    pub timeout: Option<u64>,
    /// Record to FILE in the format of its suffix: .log, .pcapng, .mcap, …
    ///
    /// Without FILE, or if FILE is a folder, the file is named candump-DATE_TIME.log. With --trigger, FILE is a
    /// folder for the captures around triggers; it is created if its parent folder exists. - for stdout and a pipe
    /// receive pcapng as the frames come, without panes or text.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = ".")]
    pub record: Option<PathBuf>,
    /// Start a new file at SIZE bytes: 64k or more, 100M, 2G (k, M and G are powers of 1,024)
    #[arg(long, value_name = "SIZE", requires = "record", value_parser = part_bytes)]
    pub record_size: Option<u64>,
    /// Start a new file after TIME: 90s, 10min, 1h
    #[arg(long, value_name = "TIME", requires = "record", value_parser = parse_duration)]
    pub record_time: Option<Duration>,
    /// Keep only the newest N files
    #[arg(long, value_name = "N", requires = "record")]
    pub record_files: Option<u32>,
    #[command(flatten)]
    pub triggers: TriggerArgs,
    /// Read files to their end and wait for appended data: candump text, TRC, ASC, CSV, pcapng, MCAP
    #[arg(long)]
    pub follow: bool,
    /// Keep up to SIZE bytes of data in the terminal UI; older frames are dropped with a note (k, M, G: powers of 1,024)
    #[arg(long, value_name = "SIZE", default_value = "2G", value_parser = parse_size)]
    pub keep: u64,
    #[command(flatten)]
    pub screen: ScreenArgs,
}
