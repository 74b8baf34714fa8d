//! The subcommands, one module each.

mod captures;
mod check;
mod convert;
mod cut;
mod decode;
mod decoding;
mod describe;
mod diff;
mod explain;
mod facts;
mod input;
mod live;
mod messages;
mod objects;
mod output;
mod print;
mod profiles;
mod reassign;
mod remarks;
mod report;
mod rules;
mod screen_settings;
mod selected_findings;
mod shell;
mod stats;
mod view;
mod why;

use std::io::IsTerminal as _;

use crate::cli::{Cli, Command};
use crate::exit_code::Exit;
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub use live::over_datagrams;
use messages::complain;
pub use view::open as open_view;

/// Runs the command.
pub fn run(cli: Cli) -> Exit {
    if cli.command.captures().is_some_and(<[_]>::is_empty) && std::io::stdin().is_terminal() {
        complain(&anyhow::anyhow!("no capture; give a file, or - for stdin"));
        return Exit::Usage;
    }
    if let Err(error) = cli.command.check_nodes() {
        complain(&anyhow::Error::msg(error));
        return Exit::Usage;
    }
    match cli.command {
        Command::View(arguments) => view::run(&arguments),
        Command::Live(arguments) => live::run(&arguments),
        Command::Decode(arguments) => decode::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Stats(arguments) => stats::run(&arguments),
        Command::Objects(arguments) => objects::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Rules(arguments) => rules::run(&arguments),
        Command::Why(arguments) => why::run(&arguments),
        Command::Diff(arguments) => diff::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Explain { thing, device, profiles } => explain::run(&thing, device.as_deref(), &profiles),
        Command::Profiles { command, profiles } => profiles::run(&command, &input::catalogue(&profiles)),
        Command::Completions { shell } => shell::completions(shell),
        Command::Man { of } => shell::man(of.as_deref()),
    }
}
