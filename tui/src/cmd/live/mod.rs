//! `cobscope live`: live buses.

mod arguments;
mod cut_lines;
mod cuts;
mod interruption;
mod lines;
mod program;
mod pump;
mod screen;
mod sources;
mod stream;
mod triggers;
mod viewer;

use std::io::IsTerminal as _;
use std::path::Path;

use cobscope_decoder::sink::escape;

use crate::exit_code::ExitStatus;
use crate::path_text::path_text as shown_path;
use crate::run::messages::{Refusal, print_error, print_note};
use crate::run::output::print_text;
use crate::source::live::{SERIAL_EXAMPLE, adapters, socketcan};
pub use arguments::LiveArgs;
use sources::{shown, specs};

/// Runs the command.
pub fn run(arguments: &LiveArgs) -> ExitStatus {
    if arguments.input.captures.is_empty() {
        return list();
    }
    let wants_lines = arguments.print || arguments.check || arguments.triggers.is_any();
    let is_stream = arguments.record.as_deref().is_some_and(stream::is_stream);
    if !wants_lines && !is_stream && !std::io::stdout().is_terminal() {
        print_error(&anyhow::anyhow!("stdout is not a terminal; for text output use --print"));
        return ExitStatus::Usage;
    }
    opened(arguments, wants_lines).unwrap_or_else(|(exit, error)| {
        print_error(&error);
        exit
    })
}

fn opened(arguments: &LiveArgs, wants_lines: bool) -> Result<ExitStatus, Refusal> {
    let specs = specs(arguments).map_err(|error| (ExitStatus::Usage, error))?;
    // Triggers refuse anything but a folder.
    let is_stream = |path: &&Path| stream::is_stream(path) && !arguments.triggers.is_any();
    match arguments.record.as_deref().filter(is_stream) {
        Some(path) if wants_lines => Err((ExitStatus::Usage, not_a_stream(path))),
        Some(path) => stream::run(arguments, specs, path, false),
        None if wants_lines => lines::run(arguments, specs),
        None => screen::run(arguments, specs),
    }
}

/// Writes the frames of a source to a pipe, with their meaning as comments.
///
/// # Errors
/// If the source is not valid, or as for [`stream::run`].
pub(super) fn commented(arguments: &LiveArgs, pipe: &Path) -> Result<ExitStatus, Refusal> {
    let specs = specs(arguments).map_err(|error| (ExitStatus::Usage, error))?;
    stream::run(arguments, specs, pipe, true)
}

fn not_a_stream(path: &Path) -> anyhow::Error {
    let name = shown_path(path);
    anyhow::anyhow!("--record {name}: the stream needs a command of its own, without --print and --check")
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
fn list() -> ExitStatus {
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
    let written = print_text(text.as_bytes());
    print_note(&format!(
        "{hint}other sources: {SERIAL_EXAMPLE} (serial adapter), pcan:USB1@500k (PEAK), kvaser:0@500k (Kvaser), \
         gs_usb:@500k (candleLight, CANable), socketcand://HOST/can0 (server), - (candump text on stdin)"
    ));
    if lines.is_empty() { ExitStatus::Capture } else { written }
}
