//! Options that several subcommands have, their parsers, and texts of their help.

mod formats;
mod input;
mod quantities;

use std::ffi::OsString;

use clap::{Args, Command};

pub use formats::{Color, FailOn, ReportFormat};
pub use input::{
    EdsArg, InputArgs, NODE_HELP, NodeArg, NodeOption, ProtocolOption, SelectArgs, StampStyle,
    TimeUnitOption, find_zone, node_choices, parse_count, parse_date,
};
pub(crate) use input::{filter_grammar, filter_help, finding_filter_help, from_help};
pub use quantities::{parse_duration, parse_side, parse_size, part_bytes};

/// Exit statuses, as in the README.
pub const EXIT_STATUS: &str = "\
Exit status:
  0  success, even if some lines are unreadable
  1  check, live --check: findings at or above --fail-on, or a required rule is not exercised;
     diff: the captures differ
  2  the command line is invalid, or an output cannot be created
  3  a capture is unreadable, incomplete or without frames, or an output is incomplete;
     check: a node of --only-node sent no frame
  4  a profile, bus file, device file, DBC or baseline is invalid or unreadable";

/// Examples in the help of a command. A test parses each of them.
macro_rules! examples {
    ($first:literal $(, $more:literal)* $(,)?) => {
        concat!("Examples:\n  ", $first $(, "\n  ", $more)*)
    };
}
pub(crate) use examples;

/// The options of a command from its words on the command line.
///
/// # Errors
/// If an option is not valid; with the text that the command line prints.
pub fn parse_words<A: Args>(
    command: &'static str,
    words: impl IntoIterator<Item = OsString>,
) -> Result<A, clap::Error> {
    let program = Command::new("cobscope").subcommand(A::augment_args(Command::new(command)));
    let start = ["cobscope", command].map(OsString::from);
    let matches = program.try_get_matches_from(start.into_iter().chain(words))?;
    A::from_arg_matches(matches.subcommand_matches(command).unwrap_or(&matches))
}
