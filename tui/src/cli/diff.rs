//! `cobscope diff`.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use cobscope_decoder::comparison::DifferenceSection;
use cobscope_decoder::query::Filter;

use super::{DiffFormat, InputArgs};
use crate::select::RangeBound;

/// `cobscope diff`.
#[derive(Debug, Args)]
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
