//! `cobscope`: reads CAN captures and says what the devices did.

mod cli;
mod cmd;
mod exit_code;
mod select;
mod source;

use clap::Parser as _;

fn main() -> std::process::ExitCode {
    let cli = cli::Cli::parse_from(cli::with_default_command(std::env::args_os()));
    cmd::run(cli).into()
}
