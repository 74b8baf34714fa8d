//! `cobscope live`: buses as they are now.

mod lines;
mod pump;
mod screen;

use std::io::{IsTerminal as _, Write as _};
use std::path::Path;

use anyhow::{Context as _, bail};
use cobscope_decoder::frame::LinkState;
use cobscope_decoder::sink::escape;

use super::input::read_options;
use super::messages::complain;
use super::output::print;
use crate::cli::LiveArgs;
use crate::exit_code::Exit;
use crate::record::{RecordOptions, Recorder};
use crate::source::live::{BusStatus, Source, SourceSpec, lines as text, slcan, socketcan, socketcand};

/// Runs the command.
pub fn run(arguments: &LiveArgs) -> Exit {
    if arguments.input.captures.is_empty() {
        return list();
    }
    let wants_lines = arguments.print || arguments.check;
    if !wants_lines && !std::io::stdout().is_terminal() {
        complain(&anyhow::anyhow!("standard output is no terminal; for lines use --print"));
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

/// Watches datagrams that stand for frames.
///
/// # Errors
/// As the command itself.
#[cfg(all(target_os = "linux", feature = "socketcan"))]
pub fn over_datagrams(arguments: &LiveArgs, socket: std::net::UdpSocket) -> anyhow::Result<()> {
    let sources = || Ok(vec![socketcan::stand_in(socket)?]);
    lines::watch(arguments, sources).map(|_| ()).map_err(|(_, error)| error)
}

/// What went wrong before anything was watched.
type Refusal = (Exit, anyhow::Error);

/// Says which interfaces there are.
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
        "cobscope live NAME watches one of them, any watches all; "
    };
    let written = print(text.as_bytes());
    let _ = writeln!(
        std::io::stderr(),
        "cobscope: {hint}serial adapters are slcan:/dev/ttyACM0@500000, servers socketcand://HOST/can0, \
         - is text on standard input"
    );
    if interfaces.is_empty() { Exit::Capture } else { written }
}

/// `can0: up, 250000 bit/s, error active`.
fn shown(status: &BusStatus) -> String {
    let rate = status.bit_rate.map_or(String::new(), |rate| format!(", {rate} bit/s"));
    let controller = status.controller.as_ref().map_or(String::new(), |controller| format!(", {controller}"));
    let stamps = status.stamps.whose().map_or(String::new(), |whose| format!(", stamps of {whose}"));
    escape(&format!("{}: {}{rate}{controller}{stamps}", status.name, status.state.name())).into_owned()
}

fn specs(arguments: &LiveArgs) -> anyhow::Result<Vec<SourceSpec>> {
    let spec = |path: &Path| -> anyhow::Result<SourceSpec> {
        let name = path.to_str().with_context(|| format!("{}: is no name of a source", path.display()))?;
        let spec = name.parse::<SourceSpec>().map_err(|error| anyhow::anyhow!("{name}: {error}"))?;
        if matches!(spec, SourceSpec::File(_)) && !arguments.follow {
            bail!("{name}: is a file; cobscope view {name} shows what is in it, --follow what is added too");
        }
        Ok(spec)
    };
    arguments.input.captures.iter().map(|path| spec(path)).collect()
}

/// Opens the sources. All CAN interfaces of this computer are one.
fn open(arguments: &LiveArgs, specs: Vec<SourceSpec>) -> anyhow::Result<Vec<Box<dyn Source>>> {
    let read = read_options(&arguments.input);
    let (mut sources, mut interfaces) = (Vec::new(), Vec::new());
    for spec in specs {
        match spec {
            SourceSpec::SocketCan(spec) => interfaces.push(spec),
            SourceSpec::Slcan { device, bit_rate } => sources.push(slcan::open(&device, bit_rate)?),
            SourceSpec::Socketcand { address, bus } => sources.push(socketcand::open(&address, &bus)?),
            SourceSpec::Stdin => sources.push(text::stdin(read)?),
            SourceSpec::File(path) => sources.push(text::follow(&path, read)?),
        }
    }
    if !interfaces.is_empty() {
        sources.push(socketcan::open(&interfaces)?);
    }
    Ok(sources)
}

/// The record, where one is wanted.
fn recorder(arguments: &LiveArgs) -> anyhow::Result<Option<Recorder>> {
    let Some(path) = &arguments.record else { return Ok(None) };
    let options = RecordOptions {
        path: Some(path.clone()),
        max_bytes: arguments.record_size,
        max_time: arguments.record_time,
        files: arguments.record_files,
    };
    Recorder::open(&options, jiff::Zoned::now().datetime()).map(Some)
}

/// Whether an interface has to be brought up before anything comes.
fn is_down(status: &BusStatus) -> bool {
    status.state == LinkState::Down
}
