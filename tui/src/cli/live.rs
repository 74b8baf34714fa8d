//! `cobscope live`.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::size::{bytes, part_bytes};
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
    /// Judge, print findings, and say at the end what check says; ends with 1 where there are findings at or above
    /// --fail-on
    #[arg(long)]
    pub check: bool,
    /// Findings from which on the exit status is 1
    #[arg(long, value_name = "SEVERITY", default_value = "error")]
    pub fail_on: FailOn,
    /// End at the first finding at or above --fail-on
    #[arg(long, requires = "check")]
    pub until_finding: bool,
    /// End after N frames
    #[arg(short = 'n', value_name = "N")]
    pub frames_wanted: Option<u64>,
    /// End when no frame came for MS milliseconds
    #[arg(short = 'T', value_name = "MS")]
    pub timeout: Option<u64>,
    /// Record what comes to FILE, in the format of the end of its name (.log, .pcapng, .mcap …); without FILE, or for a folder,
    /// to candump-DATE_TIME.log
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = ".")]
    pub record: Option<PathBuf>,
    /// Begin a new file when one has SIZE bytes: 64k or more, 100M, 2G
    #[arg(long, value_name = "SIZE", requires = "record", value_parser = part_bytes)]
    pub record_size: Option<u64>,
    /// Begin a new file after TIME: 10min, 1h
    #[arg(long, value_name = "TIME", requires = "record", value_parser = duration)]
    pub record_time: Option<Duration>,
    /// Keep the newest N files only
    #[arg(long, value_name = "N", requires = "record")]
    pub record_files: Option<u32>,
    /// Read files to their end and wait for what is added
    #[arg(long)]
    pub follow: bool,
    /// How much the terminal UI keeps to go back to; older frames are dropped, which is said
    #[arg(long, value_name = "SIZE", default_value = "2G", value_parser = bytes)]
    pub keep: u64,
    #[command(flatten)]
    pub screen: ScreenArgs,
}

/// `90s`, `10min`, `1h`.
fn duration(text: &str) -> Result<Duration, String> {
    let wrong = || format!("found {text}, expected a time such as 90s, 10min or 1h");
    let at = text.find(|character: char| !character.is_ascii_digit()).ok_or_else(wrong)?;
    let (number, unit) = text.split_at_checked(at).ok_or_else(wrong)?;
    let seconds = match unit {
        "s" => 1,
        "min" | "m" => 60,
        "h" => 3_600,
        _ => return Err(wrong()),
    };
    let number: u64 = number.parse().map_err(|_| wrong())?;
    number.checked_mul(seconds).filter(|seconds| *seconds > 0).map(Duration::from_secs).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times() {
        assert_eq!(duration("10min"), Ok(Duration::from_mins(10)));
        assert_eq!(duration("90s"), Ok(Duration::from_secs(90)));
        for text in ["", "10", "min", "0s", "1d"] {
            assert!(duration(text).is_err(), "{text}");
        }
    }
}
