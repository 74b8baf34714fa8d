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

use crate::cli::{Cli, Command};
use crate::exit_code::Exit;
use crate::path_text;
pub use extcap::{answer, set_program};
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub use live::over_datagrams;
use messages::complain;
pub use view::open as open_view;

/// Prints help, or an error of the command line; file names in it may contain control characters.
pub fn refuse(error: &clap::Error) -> Exit {
    let text = error.render().to_string();
    let safe: Vec<_> = text.lines().map(escape).collect();
    if safe.iter().any(|line| matches!(line, Cow::Owned(_))) {
        let _ = writeln!(std::io::stderr(), "{}", safe.join("\n"));
    } else {
        // With its colours.
        let _ = error.print();
    }
    if error.use_stderr() { Exit::Usage } else { Exit::Clean }
}

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
    if let Some(folder) = cli.command.profile_folders().iter().find(|folder| !folder.is_dir()) {
        complain(&anyhow::anyhow!("--profiles {}: not a folder", path_text::shown(folder)));
        return Exit::Profile;
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
        Command::Extcap(arguments) => extcap::run(&arguments),
        Command::Mcp(arguments) => mcp::run(&arguments),
        #[cfg(feature = "parquet")]
        Command::Lake { command } => lake::run(&command),
        Command::Completions { shell } => shell::completions(shell),
        Command::Man { of } => shell::man(of.as_deref()),
    }
}
