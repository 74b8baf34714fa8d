//! The subcommands, one module each.

mod against;
mod captures;
mod check;
mod convert;
mod cut;
mod decode;
mod decoding;
mod describe;
mod diff;
pub mod embedded;
mod explain;
mod extcap;
mod facts;
mod frame_comment;
mod input;
#[cfg(feature = "parquet")]
mod lake;
#[cfg(feature = "parquet")]
mod lake_index;
mod live;
mod mcp;
mod messages;
mod objects;
mod output;
mod page_writer;
mod print;
mod profiles;
mod reassign;
mod remarks;
mod replaced;
mod report;
mod results;
mod rules;
mod screen_settings;
mod selected_findings;
mod shell;
mod stats;
mod view;
mod why;

use std::borrow::Cow;
use std::io::{IsTerminal as _, Write as _};

use cobscope_decoder::sink::escape;

use crate::cli::{Cli, CliCommand};
use crate::exit_code::ExitStatus;
use crate::path_text;
pub use extcap::{answer_call, set_program};
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub use live::over_datagrams;
use messages::print_error;
pub use view::open_view;

/// Prints help, or an error of the command line; file names in it may contain control characters.
pub fn print_refusal(error: &clap::Error) -> ExitStatus {
    let text = error.render().to_string();
    let safe: Vec<_> = text.lines().map(escape).collect();
    if safe.iter().any(|line| matches!(line, Cow::Owned(_))) {
        let _ = writeln!(std::io::stderr(), "{}", safe.join("\n"));
    } else {
        // With its colours.
        let _ = error.print();
    }
    if error.use_stderr() { ExitStatus::Usage } else { ExitStatus::Clean }
}

/// Runs the command.
pub fn run(cli: Cli) -> ExitStatus {
    if cli.command.captures().is_some_and(<[_]>::is_empty) && std::io::stdin().is_terminal() {
        print_error(&anyhow::anyhow!("no capture; give a file, or - for stdin"));
        return ExitStatus::Usage;
    }
    if let Err(error) = cli.command.check_nodes() {
        print_error(&anyhow::Error::msg(error));
        return ExitStatus::Usage;
    }
    if let Some(folder) = cli.command.profile_folders().iter().find(|folder| !folder.is_dir()) {
        print_error(&anyhow::anyhow!("--profiles {}: not a folder", path_text::path_text(folder)));
        return ExitStatus::Profile;
    }
    match cli.command {
        CliCommand::View(arguments) => view::run(&arguments),
        CliCommand::Live(arguments) => live::run(&arguments),
        CliCommand::Decode(arguments) => decode::run(&arguments),
        CliCommand::Convert(arguments) => convert::run(&arguments),
        CliCommand::Stats(arguments) => stats::run(&arguments),
        CliCommand::Objects(arguments) => objects::run(&arguments),
        CliCommand::Check(arguments) => check::run(&arguments),
        CliCommand::Rules(arguments) => rules::run(&arguments),
        CliCommand::Why(arguments) => why::run(&arguments),
        CliCommand::Diff(arguments) => diff::run(&arguments),
        CliCommand::Report(arguments) => report::run(&arguments),
        CliCommand::Explain { thing, device, profiles } => explain::run(&thing, device.as_deref(), &profiles),
        CliCommand::Profiles { command, profiles } => {
            profiles::run(&command, &input::load_catalogue(&profiles))
        }
        CliCommand::Extcap(arguments) => extcap::run(&arguments),
        CliCommand::Mcp(arguments) => mcp::run(&arguments),
        #[cfg(feature = "parquet")]
        CliCommand::Lake { command } => lake::run(&command),
        CliCommand::Completions { shell } => shell::print_completions(shell),
        CliCommand::Man { of } => shell::print_manual(of.as_deref()),
    }
}
