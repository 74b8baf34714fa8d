//! `cobscope check`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use cobscope_decoder::finding::Severity;
use cobscope_decoder::sink::findings::{FINDING_FORMATS, FindingFormat};

use super::{Color, InputArgs};

/// `cobscope check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text", value_parser = formats())]
    pub format: &'static FindingFormat,
    /// Write to FILE instead of standard output
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Findings from which on the exit status is 1
    #[arg(long, value_name = "SEVERITY", default_value = "error")]
    pub fail_on: FailOn,
    /// Findings that are known and accepted: only others, and worse ones, fail (JSON, see --update-baseline)
    #[arg(long, value_name = "FILE")]
    pub baseline: Option<PathBuf>,
    /// Write what is found now to the file of --baseline, instead of comparing with it; what it has of captures that
    /// are not judged this time stays
    #[arg(long, requires = "baseline")]
    pub update_baseline: bool,
    /// Fail if one of these rules had nothing to judge in any capture
    #[arg(long, value_name = "RULE", value_delimiter = ',')]
    pub require_exercised: Vec<String>,
    /// Show how often each rule, and each case of CiA's conformance test plan, was judged (text; jsonl always
    /// says it)
    #[arg(long)]
    pub coverage: bool,
    /// Show every occurrence that was kept, and what is suppressed or accepted (text)
    #[arg(short, long)]
    pub verbose: bool,
    /// Captures judged at the same time; the output is the same (default: as many as there are processors)
    #[arg(long, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    /// Day on which suppressions of the bus file may have run out (default: today)
    #[arg(long, value_name = "DATE", value_parser = date)]
    pub today: Option<jiff::civil::Date>,
    /// Use the profiles in $XDG_CONFIG_HOME/cobscope/profiles too; without, every machine judges alike
    #[arg(long)]
    pub user_profiles: bool,
    /// Colours: auto uses them on a terminal unless NO_COLOR is set
    #[arg(long, value_name = "WHEN", default_value = "auto")]
    pub color: Color,
}

/// The formats of findings.
fn formats() -> impl TypedValueParser<Value = &'static FindingFormat> {
    let names = FINDING_FORMATS.iter().map(|format| PossibleValue::new(format.name).help(format.help));
    // Other names are refused before.
    PossibleValuesParser::new(names)
        .try_map(|name| FINDING_FORMATS.iter().find(|format| format.name == name).ok_or("unknown format"))
}

/// Findings that make `check` and `live` fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FailOn {
    /// Errors
    Error,
    /// Errors and warnings
    Warning,
    /// All
    Note,
    /// None
    Never,
}

impl FailOn {
    /// The least severity that fails.
    pub fn least(self) -> Option<Severity> {
        match self {
            Self::Error => Some(Severity::Error),
            Self::Warning => Some(Severity::Warning),
            Self::Note => Some(Severity::Note),
            Self::Never => None,
        }
    }
}

fn date(text: &str) -> Result<jiff::civil::Date, &'static str> {
    text.parse().map_err(|_| "expected a date, as 2026-01-31")
}
