//! `cobscope live`: live buses.

mod cut_lines;
mod cuts;
mod lines;
mod program;
mod pump;
mod screen;
mod sources;
mod triggers;
mod viewer;

use std::io::IsTerminal as _;

use super::messages::{complain, note};
use super::output::print;
use crate::cli::LiveArgs;
use crate::exit_code::Exit;
use crate::source::live::socketcan;
use sources::{shown, specs};

/// Runs the command.
pub fn run(arguments: &LiveArgs) -> Exit {
    if arguments.input.captures.is_empty() {
        return list();
    }
    let wants_lines = arguments.print || arguments.check || arguments.triggers.is_any();
    if !wants_lines && !std::io::stdout().is_terminal() {
        complain(&anyhow::anyhow!("stdout is not a terminal; for text output use --print"));
        return Exit::Usage;
    }
    let specs = match specs(arguments) {
        Ok(specs) => specs,
        Err(error) => {
            complain(&error);
            return Exit::Usage;
        }
    };
    let opened = if wants_lines { lines::run(arguments, specs) } else { screen::run(arguments, specs) };
    opened.unwrap_or_else(|(exit, error)| {
        complain(&error);
        exit
    })
}

/// Reads frames from datagrams instead of CAN.
///
/// # Errors
/// As for the command.
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub fn over_datagrams(arguments: &LiveArgs, socket: std::net::UdpSocket) -> anyhow::Result<()> {
    let sources = || Ok(vec![socketcan::stand_in(socket)?]);
    lines::watch(arguments, sources).map(|_| ()).map_err(|(_, error)| error)
}

/// Lists the CAN interfaces.
fn list() -> Exit {
    let interfaces = socketcan::all();
    let mut text = String::new();
    for status in &interfaces {
        text.push_str(&shown(status));
        text.push('\n');
    }
    let hint = if interfaces.is_empty() {
        "no CAN interface on this computer; "
    } else {
        "cobscope live NAME shows one of them, any shows all; "
    };
    let written = print(text.as_bytes());
    note(&format!(
        "{hint}other sources: slcan:/dev/ttyACM0@500000 (serial adapter), socketcand://HOST/can0 (server), \
         - (candump text on stdin)"
    ));
    if interfaces.is_empty() { Exit::Capture } else { written }
}
