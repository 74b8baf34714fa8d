//! `cobscope`: reads CAN traffic and says what the devices did, in lines, in a terminal UI and in CI.

pub mod action;
pub mod app;
mod bucket;
mod cli;
mod cmd;
mod exit_code;
mod figures;
pub mod keymap;
pub mod panes;
mod record;
mod select;
mod source;
mod state;
mod terminal;
pub mod theme;
pub mod timeline;
pub mod widgets;
mod words;

use std::io::IsTerminal as _;
use std::process::ExitCode;
use std::sync::mpsc::Receiver;

use clap::Parser as _;

use app::App;
use timeline::News;

/// Runs the program as its command line says.
pub fn run() -> ExitCode {
    let cli =
        cli::Cli::parse_from(cli::with_default_command(std::env::args_os(), std::io::stdout().is_terminal()));
    cmd::run(cli).into()
}

/// The terminal UI as a command line has it (`view …`), without a terminal, and what its background finds.
///
/// # Errors
/// A command line that is not that of `view`, or what the command itself would complain about.
pub fn open_view(arguments: &[String]) -> anyhow::Result<(App, Receiver<News>)> {
    let words = std::iter::once("cobscope").chain(arguments.iter().map(String::as_str));
    let cli::Command::View(view) = cli::Cli::try_parse_from(words)?.command else {
        anyhow::bail!("{} is not the command view", arguments.join(" "));
    };
    cmd::open_view(&view, arguments)
}

/// `live - …` over datagrams that stand for frames, each a `struct can_frame`: what receiving costs can be measured
/// where the kernel has no CAN.
///
/// # Errors
/// A command line that is not that of `live`, or what the command itself would complain about.
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub fn live_over_datagrams(arguments: &[String], socket: std::net::UdpSocket) -> anyhow::Result<()> {
    let words = std::iter::once("cobscope").chain(arguments.iter().map(String::as_str));
    let cli::Command::Live(live) = cli::Cli::try_parse_from(words)?.command else {
        anyhow::bail!("{} is not the command live", arguments.join(" "));
    };
    cmd::over_datagrams(&live, socket)
}
