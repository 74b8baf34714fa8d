//! Options of `lake`.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, Subcommand};
use regex_lite::Regex;

use crate::run::arguments::{InputArgs, examples, parse_count, parse_date};

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope lake add lake/ --bus excavator-7.toml captures/",
    "cobscope lake add lake/ --machine-from 'machines/([^/]+)/' machines/",
];

/// Collect captures of many machines in tables that DuckDB, Polars and Spark read
///
/// A lake is a folder of Parquet files, partitioned by machine and day: captures, findings, events, signals, objects,
/// and frames on request. docs/lake.md describes the columns and has queries.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct LakeArgs {
    /// Command to run
    #[command(subcommand)]
    pub command: LakeCommand,
}

/// Commands of `lake`.
#[derive(Debug, Subcommand)]
pub enum LakeCommand {
    /// Add captures to a lake; captures with the same content are added once
    ///
    /// Files have names such as lake/findings/machine=excavator-7/day=2024-01-31/HASH.parquet, with the hash of the content
    /// of the capture. They are written to lake/_staging and then renamed, those of captures last. An interrupted run is
    /// completed or discarded by the next one. Days are UTC; a capture without a date has day=unknown.
    #[command(
        mut_arg("captures", |arg| arg.help("Captures to add: files, or folders with all their files")),
        after_help = EXAMPLES
    )]
    Add(Box<LakeAddArgs>),
}

/// `cobscope lake add`.
#[derive(Debug, Args)]
pub struct LakeAddArgs {
    /// Folder of the lake, created if needed
    #[arg(value_name = "DIR")]
    pub lake: PathBuf,
    #[command(flatten)]
    pub input: InputArgs,
    /// Use NAME as the name of the machine (default: machine in the bus file, else unknown)
    #[arg(long, value_name = "NAME")]
    pub machine: Option<String>,
    /// Take the name of the machine from the path of each capture: the first group of REGEX, such as 'machines/([^/]+)/'
    #[arg(long, value_name = "REGEX", conflicts_with = "machine")]
    pub machine_from: Option<MachinePattern>,
    /// Use DATE as the day of captures without a date (default: unknown)
    #[arg(long, value_name = "DATE", value_parser = parse_date)]
    pub day: Option<jiff::civil::Date>,
    /// Also add all frames
    #[arg(long)]
    pub frames: bool,
    /// Also add events without new information, and those of messages whose values are in signals
    #[arg(long)]
    pub all_events: bool,
    /// Also add values side by side, one table per message: wide/MACHINE/BUS_MESSAGE/YYYY/MM/DD/HASH.parquet with the
    /// columns t and one per signal
    #[arg(long)]
    pub wide: bool,
    /// Add captures again that are in the lake, after a change of profiles or of the program
    #[arg(long)]
    pub replace: bool,
    /// Add N captures in parallel (default: number of processors)
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub threads: Option<NonZeroUsize>,
    /// Also use the profiles in $XDG_CONFIG_HOME/cobscope/profiles
    ///
    /// Without this option the result does not depend on the configuration of the user.
    #[arg(long)]
    pub user_profiles: bool,
}

/// Pattern whose first group in a path is the name of the machine.
#[derive(Debug, Clone)]
pub struct MachinePattern(Regex);

impl FromStr for MachinePattern {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let pattern = Regex::new(text).map_err(|error| error.to_string())?;
        if pattern.captures_len() < 2 {
            return Err("no group; expected one around the name, such as 'machines/([^/]+)/'".to_owned());
        }
        Ok(Self(pattern))
    }
}

impl MachinePattern {
    /// Name of the machine in a path, with `/` between folders on each system.
    pub fn name<'a>(&self, path: &'a str) -> Option<&'a str> {
        self.0.captures(path)?.get(1).map(|group| group.as_str())
    }

    /// The pattern as typed.
    pub fn text(&self) -> &str {
        self.0.as_str()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_is_the_first_group() {
        let pattern: MachinePattern = "machines/([^/]+)/(.*)".parse().unwrap();
        assert_eq!(pattern.name("data/machines/ex-7/2024/a.log"), Some("ex-7"));
        assert_eq!(pattern.name("data/other/a.log"), None);
        let error = "machines/[^/]+/".parse::<MachinePattern>().unwrap_err();
        assert_eq!(error, "no group; expected one around the name, such as 'machines/([^/]+)/'");
        assert!("(".parse::<MachinePattern>().is_err());
    }
}
