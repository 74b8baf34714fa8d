//! `cobscope`: decodes CAN traffic and prints the events of the devices, shows them in a terminal UI, and
//! checks them in CI.

pub mod action;
pub mod app;
pub mod ascii;
mod bucket;
mod cmd;
mod config;
mod device_name;
mod exit_code;
mod file_identity;
pub mod keymap;
mod output_file;
pub mod panes;
mod path_text;
mod record;
mod run;
mod select;
mod source;
mod state;
mod terminal;
pub mod theme;
pub mod timeline;
pub mod widgets;
mod words;

use std::ffi::OsString;
use std::io::IsTerminal as _;
use std::process::ExitCode;
use std::sync::mpsc::Receiver;

use clap::Parser as _;

use app::App;
pub use cmd::embedded;
pub use exit_code::ExitStatus;
use timeline::TimelineNews;

/// Runs the program with the arguments of the process.
pub fn run() -> ExitCode {
    run_with(process_arguments()).into()
}

/// Runs the program inside of another one: `arguments` are its path and the arguments after it.
pub fn run_embedded(arguments: Vec<OsString>) -> ExitStatus {
    if let Some(path) = arguments.first() {
        cmd::set_program(path.into());
    }
    run_with(arguments)
}

fn run_with(arguments: Vec<OsString>) -> ExitStatus {
    if cmd::is_extcap_call(&arguments) {
        return match cmd::ExtcapCall::try_parse_from(arguments) {
            Ok(call) => cmd::answer_call(&call),
            Err(error) => cmd::print_refusal(&error),
        };
    }
    let arguments = cmd::with_default_command(arguments.into_iter(), std::io::stdout().is_terminal());
    match cmd::Cli::parse_arguments(&arguments) {
        Ok(cli) => cmd::run(cli),
        Err(error) => cmd::print_refusal(&error),
    }
}

/// Arguments of the process. Shells of Windows leave it to programs to expand `*.log`.
fn process_arguments() -> Vec<OsString> {
    #[cfg(windows)]
    return wild::args_os().collect();
    #[cfg(not(windows))]
    return std::env::args_os().collect();
}

/// Opens the terminal UI for a command line (`view …`) without a terminal; also returns the results of its
/// background threads.
///
/// # Errors
/// If the command is not `view`, or for the errors of `view` itself.
pub fn open_view(arguments: &[String]) -> anyhow::Result<(App, Receiver<TimelineNews>)> {
    let words = std::iter::once("cobscope").chain(arguments.iter().map(String::as_str));
    let cmd::CliCommand::View(view) = cmd::Cli::try_parse_from(words)?.command else {
        anyhow::bail!("{}: expected the command view", arguments.join(" "));
    };
    cmd::open_view(&view, arguments)
}

/// Runs `live - …` on datagrams, each with one `struct can_frame`, to measure the cost of reception on a
/// kernel without CAN.
///
/// # Errors
/// If the command is not `live`, or for the errors of `live` itself.
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub fn live_over_datagrams(arguments: &[String], socket: std::net::UdpSocket) -> anyhow::Result<()> {
    let words = std::iter::once("cobscope").chain(arguments.iter().map(String::as_str));
    let cmd::CliCommand::Live(live) = cmd::Cli::try_parse_from(words)?.command else {
        anyhow::bail!("{}: expected the command live", arguments.join(" "));
    };
    cmd::over_datagrams(&live, socket)
}
