//! `cobscope stats`: statistics of captures.

mod j1939;
mod report;
mod text;

use cobscope_decoder::answers::format_line;
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::session::{Bus, Observer, Preview, SessionOptions};
use cobscope_decoder::statistics::Statistics;

use super::decoding::{CaptureObserver, decode_capture, report_with};
use super::input::{check_rules_of, session_options, setup};
use super::messages::{Refusal, complain, warn};
use crate::cli::{ReportFormat, StatsArgs};
use crate::exit_code::Exit;
use crate::select::{Selection, Span};
use crate::words::unknown_bus;
use report::Report;

/// Runs the command.
pub fn run(arguments: &StatsArgs) -> Exit {
    let options = match ready(arguments) {
        Ok(options) => options,
        Err((exit, error)) => {
            complain(&error);
            return exit;
        }
    };
    report_with(&arguments.input, &options, |series, options, output| {
        let selection = arguments.select.selection()?;
        let mut counting = Counting { statistics: Statistics::default(), selection };
        let decoded = decode_capture(series, &arguments.input, options, &mut counting)?;
        let has: Vec<_> = decoded.decoder.buses().iter().map(Bus::name).collect();
        let named = arguments.bitrate.iter().filter_map(|rate| rate.bus.as_deref());
        let capture = series.name();
        named.filter_map(|bus| unknown_bus(&capture, bus, "--bitrate", &has)).for_each(|text| warn(&text));
        let Counting { mut statistics, selection } = counting;
        statistics.withdraw(decoded.decoder.buses());
        if let Some(missed) = selection.missed(decoded.decoder.frames(), decoded.decoder.last_time()) {
            warn(&format!("{capture}: {missed}"));
        }
        let report =
            Report { capture, format: decoded.format, statistics, decoder: decoded.decoder, arguments };
        match arguments.format {
            ReportFormat::Text => text::write(&report, output),
            ReportFormat::Json => output.push_str(&format_line(&report.figures())),
        }
        Ok(decoded.failure)
    })
}

/// Options for decoding.
///
/// # Errors
/// If an option, the bus file or a profile is not valid.
fn ready(arguments: &StatsArgs) -> Result<SessionOptions, Refusal> {
    let (usage, profile) = (|error| (Exit::Usage, error), |error| (Exit::Profile, error));
    arguments.select.selection().map_err(usage)?;
    let options = session_options(&arguments.input).map_err(profile)?;
    // The command has no findings, but a misspelt rule is an error in the filters of all commands.
    if let Some(filter) = arguments.select.filter.as_ref().filter(|it| !it.compared("rule").is_empty()) {
        let setup = setup(&arguments.input, &options.catalogue, None).map_err(profile)?;
        check_rules_of(Some(filter), &setup).map_err(usage)?;
    }
    Ok(options)
}

/// Observer that counts frames and events.
struct Counting {
    statistics: Statistics,
    selection: Selection,
}

impl Observer for Counting {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.selection.see(event, bus);
        if self.selection.admits(event, bus) {
            self.statistics.event(event);
        }
    }

    fn needs(&self, _preview: &Preview, _bus: &Bus) -> bool {
        self.selection.is_limited()
    }

    fn skip(&mut self, preview: &Preview, bus: &Bus) -> bool {
        let is_skipped = !self.needs(preview, bus);
        if is_skipped {
            self.statistics.skip(preview, bus);
        }
        is_skipped
    }
}

impl CaptureObserver for Counting {
    fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.selection.begin(first, span)
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) -> bool {
        if self.selection.has_filter() {
            self.selection.begin_frame(frame);
        } else if self.selection.admits_frame(frame) {
            self.statistics.frame(frame);
        }
        true
    }

    fn frames(&mut self, frames: &[Frame], names: &BusNames) -> usize {
        let Some(first) = frames.first() else { return 0 };
        if self.selection.is_limited() || !self.selection.admits_frame(first) {
            return usize::from(self.frame(first, names));
        }
        self.statistics.frames(frames);
        frames.len()
    }

    fn wants_decoded_frames(&self) -> bool {
        self.selection.has_filter()
    }

    fn frame_decoded(&mut self, frame: &Frame, bus: &Bus) {
        if self.selection.admits_frame(frame) && self.selection.admits_decoded(bus) {
            self.statistics.frame(frame);
        }
    }
}
