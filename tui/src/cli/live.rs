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
    /// Run rules, print findings and a summary as check does; exit with 1 for findings at or above --fail-on
    #[arg(long)]
    pub check: bool,
    /// Exit with status 1 for findings at or above SEVERITY
    #[arg(long, value_name = "SEVERITY", default_value = "error")]
    pub fail_on: FailOn,
    /// Stop at the first finding at or above --fail-on
    #[arg(long, requires = "check")]
    pub until_finding: bool,
    /// Stop after N frames (default: never)
    #[arg(short = 'n', value_name = "N")]
    pub frames_wanted: Option<u64>,
    /// Stop after MS milliseconds without a frame (default: never)
    #[arg(short = 'T', value_name = "MS")]
    pub timeout: Option<u64>,
    /// Record to FILE in the format of its suffix: .log, .pcapng, .mcap, …
    ///
    /// Without FILE, or if FILE is a folder, the file is named candump-DATE_TIME.log.
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = ".")]
    pub record: Option<PathBuf>,
    /// Start a new file at SIZE bytes: 64k or more, 100M, 2G
    #[arg(long, value_name = "SIZE", requires = "record", value_parser = part_bytes)]
    pub record_size: Option<u64>,
    /// Start a new file after TIME: 90s, 10min, 1h
    #[arg(long, value_name = "TIME", requires = "record", value_parser = duration)]
    pub record_time: Option<Duration>,
    /// Keep only the newest N files
    #[arg(long, value_name = "N", requires = "record")]
    pub record_files: Option<u32>,
    /// Read files to their end and wait for appended data
    #[arg(long)]
    pub follow: bool,
    /// Keep up to SIZE bytes of data in the terminal UI; older frames are dropped with a note
    #[arg(long, value_name = "SIZE", default_value = "2G", value_parser = bytes)]
    pub keep: u64,
    #[command(flatten)]
    pub screen: ScreenArgs,
}

/// `90s`, `10min`, `1h`.
fn duration(text: &str) -> Result<Duration, String> {
    let wrong = || format!("found {text}; expected a time such as 90s, 10min or 1h");
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
