//! `cobscope live`: live buses.

mod lines;
mod pump;
mod screen;
mod sources;

use std::io::{IsTerminal as _, Write as _};

use cobscope_decoder::sink::escape;

use super::messages::complain;
use super::output::print;
use crate::cli::LiveArgs;
use crate::exit_code::Exit;
use crate::source::live::{adapters, socketcan};
use sources::{shown, specs};

/// Runs the command.
pub fn run(arguments: &LiveArgs) -> Exit {
    if arguments.input.captures.is_empty() {
        return list();
    }
    let wants_lines = arguments.print || arguments.check;
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

/// Lists the CAN interfaces and the adapters whose driver is installed.
fn list() -> Exit {
    let mut lines: Vec<_> = socketcan::all().iter().map(shown).collect();
    lines.extend(adapters::all().iter().map(|line| escape(line).into_owned()));
    let mut text = String::new();
    for line in &lines {
        text.push_str(line);
        text.push('\n');
    }
    let hint = if lines.is_empty() {
        "no CAN interface and no adapter on this computer; "
    } else {
        "cobscope live NAME shows one of them, any shows all interfaces; "
    };
    let written = print(text.as_bytes());
    let _ = writeln!(
        std::io::stderr(),
        "cobscope: {hint}other sources: slcan:/dev/ttyACM0@500000 (serial adapter), pcan:USB1@500k (PEAK), kvaser:0@500k \
         (Kvaser), socketcand://HOST/can0 (server), - (candump text on stdin)"
    );
    if lines.is_empty() { Exit::Capture } else { written }
}
