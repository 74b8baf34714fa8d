//! Sources and recording, from the command line.

use std::path::Path;

use anyhow::{Context as _, bail};
use cobscope_decoder::frame::LinkState;
use cobscope_decoder::sink::escape;

use super::arguments::LiveArgs;
use crate::record::{RecordOptions, Recorder};
use crate::run::input::read_options;
use crate::source::live::{
    BusStatus, LiveSource, SourceSpec, adapters, lines as text, slcan, socketcan, socketcand,
};

pub(super) fn specs(arguments: &LiveArgs) -> anyhow::Result<Vec<SourceSpec>> {
    let spec = |path: &Path| -> anyhow::Result<SourceSpec> {
        let name = path.to_str().with_context(|| {
            format!(
                "{}: not a valid source; expected can0, slcan:PORT@RATE, pcan:USB1@RATE, kvaser:0@RATE, gs_usb:@RATE, \
                 socketcand://HOST/BUS, - or a file",
                path.display()
            )
        })?;
        let spec = name.parse::<SourceSpec>().map_err(|error| anyhow::anyhow!("{name}: {error}"))?;
        if matches!(spec, SourceSpec::File(_)) && !arguments.follow {
            bail!("{name}: is a file; use cobscope view {name}, or --follow for a growing file");
        }
        Ok(spec)
    };
    arguments.input.captures.iter().map(|path| spec(path)).collect()
}

/// Opens the sources; all CAN interfaces of this computer are one source.
pub(super) fn open(arguments: &LiveArgs, specs: Vec<SourceSpec>) -> anyhow::Result<Vec<Box<dyn LiveSource>>> {
    let read = read_options(&arguments.input);
    let (mut sources, mut interfaces) = (Vec::new(), Vec::new());
    for spec in specs {
        match spec {
            SourceSpec::SocketCan(spec) => interfaces.push(spec),
            SourceSpec::Slcan { device, bit_rate } => sources.push(slcan::open(&device, bit_rate)?),
            SourceSpec::Adapter(spec) => sources.push(adapters::open(&spec)?),
            SourceSpec::Socketcand { address, bus } => sources.push(socketcand::open(&address, &bus)?),
            SourceSpec::Stdin => sources.push(text::stdin(read.clone())?),
            SourceSpec::File(path) => sources.push(text::follow(&path, read.clone())?),
        }
    }
    if !interfaces.is_empty() {
        sources.push(socketcan::open(&interfaces)?);
    }
    Ok(sources)
}

/// Recorder for `--record`, unless only the frames around triggers are recorded.
pub(super) fn recorder(arguments: &LiveArgs) -> anyhow::Result<Option<Recorder>> {
    let Some(path) = arguments.record.as_ref().filter(|_| !arguments.triggers.is_any()) else {
        return Ok(None);
    };
    let options = RecordOptions {
        path: Some(path.clone()),
        max_bytes: arguments.record_size,
        max_time: arguments.record_time,
        files: arguments.record_files,
    };
    Recorder::open(&options, jiff::Zoned::now().datetime()).map(Some)
}

/// Whether an interface is down and must be brought up first.
pub(super) fn is_down(status: &BusStatus) -> bool {
    status.state == LinkState::Down
}

/// `can0: up, 250000 bit/s, error active, acknowledges frames (listen-only off), timestamps by the kernel`.
pub(super) fn shown(status: &BusStatus) -> String {
    let rate = status.bit_rate.map_or(String::new(), |rate| format!(", {rate} bit/s"));
    let controller = status.controller.as_ref().map_or(String::new(), |controller| format!(", {controller}"));
    let mode = status.mode.map_or(String::new(), |mode| format!(", {}", mode.mode_text()));
    let stamps = status.stamps.clock_name().map_or(String::new(), |whose| format!(", timestamps by {whose}"));
    escape(&format!("{}: {}{rate}{controller}{mode}{stamps}", status.name, status.state.name())).into_owned()
}
