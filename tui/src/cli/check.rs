//! `cobscope check`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use cobscope_decoder::finding::Severity;
use cobscope_decoder::sink::findings::{FINDING_FORMATS, FindingFormat};

use super::input::{parse_count, parse_date};
use super::{Color, InputArgs, SelectArgs};

/// `cobscope check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    pub input: InputArgs,
    #[command(flatten)]
    pub select: SelectArgs,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text", value_parser = finding_formats())]
    pub format: &'static FindingFormat,
    /// Write to FILE instead of stdout; an earlier report is replaced, no other file
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write a report page per failed capture, and an index page, to the folder DIR
    #[arg(long, value_name = "DIR")]
    pub report: Option<PathBuf>,
    /// Exit with status 1 for findings at or above SEVERITY
    #[arg(long, value_name = "SEVERITY", default_value = "error")]
    pub fail_on: FailOn,
    /// Check with these rules only (repeatable, or separated by commas; pdo-* for a prefix)
    #[arg(long = "select", value_name = "RULE", value_delimiter = ',')]
    pub selected_rules: Vec<String>,
    /// Check without these rules (repeatable, or separated by commas; pdo-* for a prefix)
    #[arg(long = "ignore", value_name = "RULE", value_delimiter = ',')]
    pub ignored_rules: Vec<String>,
    /// Accept the findings in a baseline FILE; only new or more severe ones fail (JSON, see
    /// --update-baseline)
    #[arg(long, value_name = "FILE")]
    pub baseline: Option<PathBuf>,
    /// Write the current findings to the file of --baseline instead of comparing with it
    ///
    /// Entries of captures that are not checked in this run are kept.
    #[arg(long, requires = "baseline")]
    pub update_baseline: bool,
    /// Fail if a RULE is not exercised in any capture (repeatable, or separated by commas)
    #[arg(long, value_name = "RULE", value_delimiter = ',')]
    pub require_exercised: Vec<String>,
    /// Print verdict counts of each rule and each case of the CiA conformance test plan (text; jsonl always
    /// has them)
    #[arg(long)]
    pub coverage: bool,
    /// Print all recorded occurrences, and suppressed and accepted findings (text)
    #[arg(short, long)]
    pub verbose: bool,
    /// Check N captures in parallel (default: number of processors)
    #[arg(long, value_name = "N", value_parser = parse_count)]
    pub threads: Option<NonZeroUsize>,
    /// Compare the expiry dates of suppressions with DATE (default: today)
    #[arg(long, value_name = "DATE", value_parser = parse_date)]
    pub today: Option<jiff::civil::Date>,
    /// Also use the profiles in $XDG_CONFIG_HOME/cobscope/profiles
    ///
    /// Without this option the result does not depend on the configuration of the user.
    #[arg(long)]
    pub user_profiles: bool,
    /// Use colours; auto: on a terminal unless NO_COLOR is set
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    pub color: Color,
}

/// Parser for findings formats.
fn finding_formats() -> impl TypedValueParser<Value = &'static FindingFormat> {
    let names = FINDING_FORMATS.iter().map(|format| PossibleValue::new(format.name).help(format.help));
    // clap has already rejected other names.
    PossibleValuesParser::new(names)
        .try_map(|name| FINDING_FORMATS.iter().find(|format| format.name == name).ok_or("unknown format"))
}

/// Lowest severity that makes `check` and `live` fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FailOn {
    /// Errors
    Error,
    /// Errors and warnings
    Warning,
    /// All findings
    Note,
    /// No finding
    Never,
}

impl FailOn {
    /// Lowest severity that fails; `None` for never.
    pub fn lowest_severity(self) -> Option<Severity> {
        match self {
            Self::Error => Some(Severity::Error),
            Self::Warning => Some(Severity::Warning),
            Self::Note => Some(Severity::Note),
            Self::Never => None,
        }
    }
}
