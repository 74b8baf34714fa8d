//! Options of `check`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use cobscope_decoder::sink::findings::{FINDING_FORMATS, FindingFormat};

use crate::run::arguments::{
    Color, EXIT_STATUS, FailOn, InputArgs, SelectArgs, examples, finding_filter_help, from_help, parse_count,
    parse_date,
};

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope check --node 2=rexroth-sydfec customer.log",
    "cobscope check --baseline known.json captures/",
    "cobscope check -f junit -o findings.xml --fail-on warning captures/",
];

/// Check captures against the rules of standards, of manuals and of the bus file
///
/// For a folder, all captures in it and in its subfolders are checked, in the order of their names;
/// hidden files and other files are skipped. The exit status is 1 if there are findings at or above
/// --fail-on, if a rule of --require-exercised is not exercised, if a rule is no longer exercised that is
/// exercised in the baseline, or if a capture of the baseline in a folder was not checked.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{EXIT_STATUS}"))]
#[command(mut_arg("filter", |arg| arg.help("Print only findings that match EXPR, such as 'node == 5 && severity == error'").long_help(finding_filter_help!("Print only findings that match EXPR"))))]
#[command(mut_arg("from", |arg| arg.help("Print only findings present from WHEN on: 12.5 (seconds), #1234 (frame), 22:13:25, a date, or both").long_help(from_help!("Print only findings present from WHEN on"))))]
#[command(mut_arg("to", |arg| arg.help("Print only findings present up to WHEN, in the form of --from")))]
#[command(mut_arg("only_node", |arg| arg.help("Print only findings of a node: 5, can0:5, sa:0x80 (repeatable)")))]
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
