//! `cobscope`: reads CAN traffic and says what the devices did, in lines, in a terminal UI and in CI.

mod cli;
mod cmd;
mod exit_code;
mod select;
mod source;
mod theme;
mod timeline;
mod widgets;

use std::process::ExitCode;

use clap::Parser as _;

/// Runs the program as its command line says.
pub fn run() -> ExitCode {
    let cli = cli::Cli::parse_from(cli::with_default_command(std::env::args_os()));
    cmd::run(cli).into()
}
