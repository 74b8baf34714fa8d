//! Options of `diff`.

use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use cobscope_decoder::comparison::DifferenceSection;
use cobscope_decoder::query::Filter;

use crate::run::arguments::{EXIT_STATUS, InputArgs, examples};
use crate::select::RangeBound;

/// Examples in the help.
const EXAMPLES: &str = examples![
    "cobscope diff good.log bad.log --bus machine.toml",
    "cobscope diff --at-event 'kind == boot-up && node == 2' good.log bad.log",
    "cobscope diff --only configuration,timing -f json golden/ run/",
];

/// Compare the behaviour in two captures: configuration, nodes, states, timing, faults
///
/// Captures are compared by meaning and aligned by role: bus name, name of the node in the bus file, node-ID with vendor
/// and product, vendor and product alone. Actual values, counters, error histories and serial numbers are not
/// compared. GOOD and BAD are two files or folders; more files must form two series. A subject that one capture never
/// showed is "not seen" and not a difference. The exit status is 0 without a difference and 1 with one.
///
/// Default tolerances, in percent of the smaller value: median of a period 5, 99th percentile of its intervals (from
/// 100 intervals on) 20, longest interval 100, median and 99th percentile of latencies 100, rates of counts 100, bus
/// load 20, range of a set point 20. Differences of times below 5 ms are ignored for gaps and latencies. The table
/// [diff] of the bus file changes them.
#[derive(Debug, Args)]
#[command(
    mut_arg("captures", |arg| arg.value_name("GOOD BAD").help("Captures to compare: files or folders")),
    mut_arg("join", |arg| {
        let help = "Read all files of a folder as parts of one capture, also if their relative clocks start again";
        arg.help(help).long_help(help)
    }),
    override_usage = "cobscope diff [OPTIONS] <GOOD> <BAD>",
    after_help = format!("{EXAMPLES}\n\n{EXIT_STATUS}")
)]
pub struct DiffArgs {
    #[command(flatten)]
    pub input: InputArgs,
    /// Compare only these sections (repeatable, or separated by commas)
    #[arg(long, value_name = "SECTION", value_delimiter = ',', value_parser = section_parser())]
    pub only: Vec<DifferenceSection>,
    /// Also compare the steps from the first event on that matches EXPR, such as 'kind == boot-up && node == 2'
    ///
    /// Steps are the NMT commands, states, SDO transfers, EMCY, trouble codes and procedures of the node of that event, in
    /// their order. The first step that differs is printed first.
    #[arg(long, value_name = "EXPR")]
    pub at_event: Option<Filter>,
    /// Compare both captures from WHEN on: 12.5 (seconds from the first frame), #1234 (frame), 22:13:25, a date, or both
    ///
    /// Parameters and identities are those in force at the end of the range, also if they were written or read before it.
    #[arg(long, value_name = "WHEN")]
    pub from: Option<RangeBound>,
    /// Compare both captures up to the first frame after WHEN, in the form of --from
    #[arg(long, value_name = "WHEN")]
    pub to: Option<RangeBound>,
    /// Print all differences, and everything that one capture never showed
    #[arg(short, long)]
    pub verbose: bool,
    /// Output format
    #[arg(short, long, value_name = "FORMAT", default_value = "text")]
    pub format: DiffFormat,
    /// Write to FILE instead of stdout; an earlier comparison is replaced, no other file
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

fn section_parser() -> impl TypedValueParser<Value = DifferenceSection> {
    let names = DifferenceSection::ALL.iter().map(|section| section.name());
    PossibleValuesParser::new(names).map(|name| {
        let found = DifferenceSection::ALL.iter().copied().find(|section| section.name() == name);
        found.unwrap_or(DifferenceSection::Configuration)
    })
}

/// Formats of `diff`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DiffFormat {
    /// Text with tables
    Text,
    /// One JSON object per line
    Json,
    /// One HTML page without scripts, for screen and A4
    Html,
}
