//! The subcommands, one file or folder each: arguments, help, examples, reading, answer and exit status.

mod check;
mod command_line;
mod convert;
mod decode;
mod diff;
pub mod embedded;
mod explain;
mod extcap;
#[cfg(feature = "parquet")]
mod lake;
mod live;
mod mcp;
mod objects;
mod profiles;
mod report;
mod rules;
mod shell;
mod stats;
mod view;
mod why;

use std::borrow::Cow;
use std::io::{IsTerminal as _, Write as _};

use clap::CommandFactory as _;
use cobscope_decoder::sink::escape;

use crate::exit_code::ExitStatus;
use crate::path_text;
use crate::run::messages::print_error;
pub use command_line::{Cli, CliCommand, with_default_command};
pub use extcap::{ExtcapCall, answer_call, is_extcap_call, set_program};
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub use live::over_datagrams;
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
    if cli.command.reads_stdin() && std::io::stdin().is_terminal() {
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
        CliCommand::Explain(arguments) => explain::run(&arguments),
        CliCommand::Profiles(arguments) => profiles::run(&arguments),
        CliCommand::Extcap(arguments) => extcap::run(&arguments),
        CliCommand::Mcp(arguments) => mcp::run(&arguments),
        #[cfg(feature = "parquet")]
        CliCommand::Lake(arguments) => lake::run(&arguments),
        CliCommand::Completions(arguments) => shell::print_completions(&arguments, Cli::command()),
        CliCommand::Man(arguments) => shell::print_manual(&arguments, Cli::command()),
    }
}
