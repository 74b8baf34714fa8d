//! `cobscope stats`: who is on the bus, how often, how late.

mod j1939;
mod json;
mod report;
mod text;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Bus, Observer};
use cobscope_decoder::statistics::Statistics;

use super::decoding::{Watcher, decode_capture, report};
use super::messages::{complain, warn};
use crate::cli::{ReportFormat, StatsArgs};
use crate::exit_code::Exit;
use crate::select::{Selection, ensure_order};
use crate::words::unknown_bus;
use report::Report;

/// Runs the command.
pub fn run(arguments: &StatsArgs) -> Exit {
    if let Err(error) = ensure_order(arguments.from, arguments.to) {
        complain(&error);
        return Exit::Usage;
    }
    report(&arguments.input, |path, options, output| {
        let selection = Selection::new(None, arguments.from, arguments.to)?;
        let mut counting = Counting { statistics: Statistics::default(), selection };
        let decoded = decode_capture(path, &arguments.input, options, &mut counting)?;
        let has: Vec<_> = decoded.decoder.buses().iter().map(Bus::name).collect();
        let named = arguments.bitrate.iter().filter_map(|rate| rate.bus.as_deref());
        let capture = path.display().to_string();
        named.filter_map(|bus| unknown_bus(&capture, bus, "--bitrate", &has)).for_each(|said| warn(&said));
        let Counting { statistics, selection } = counting;
        if let Some(missed) = selection.missed(decoded.decoder.frames(), decoded.decoder.last_time()) {
            warn(&format!("{capture}: {missed}"));
        }
        let report =
            Report { capture, format: decoded.format, statistics, decoder: decoded.decoder, arguments };
        match arguments.format {
            ReportFormat::Text => text::write(&report, output),
            ReportFormat::Json => json::write(&report, output),
        }
        Ok(decoded.failure)
    })
}

/// Counts frames and events.
struct Counting {
    statistics: Statistics,
    selection: Selection,
}

impl Observer for Counting {
    fn event(&mut self, event: &Event, bus: &Bus) {
        if self.selection.admits(event, bus) {
            self.statistics.event(event);
        }
    }
}

impl Watcher for Counting {
    fn begin(&mut self, first: &Frame) -> anyhow::Result<()> {
        self.selection.begin(first)
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) -> bool {
        if self.selection.admits_frame(frame) {
            self.statistics.frame(frame);
        }
        true
    }
}
