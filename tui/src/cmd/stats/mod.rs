//! `cobscope stats`: statistics of captures.

mod arguments;

use cobscope_decoder::answers::format_line;
use cobscope_decoder::answers::statistics::CaptureStatistics;
use cobscope_decoder::answers::statistics::text::{self, StatisticsReport};
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::reading::{FrameDemand, ReadingPart};
use cobscope_decoder::session::{Bus, Buses, MessagePreview, SessionOptions};
use cobscope_decoder::statistics::Statistics;

use crate::exit_code::ExitStatus;
use crate::run::arguments::ReportFormat;
use crate::run::capture_job::{CaptureJob, ReadCapture, report_with};
use crate::run::input::{build_setup, check_rules_of, session_options};
use crate::run::messages::{Refusal, print_error, print_warning};
use crate::select::Selection;
use crate::words::unknown_bus;
pub use arguments::StatsArgs;

/// Runs the command.
pub fn run(arguments: &StatsArgs) -> ExitStatus {
    let options = match prepare_options(arguments) {
        Ok(options) => options,
        Err((exit, error)) => {
            print_error(&error);
            return exit;
        }
    };
    report_with(&arguments.input, &options, |series, options, output| {
        let selection = arguments.select.selection()?;
        let part = SelectedStatistics { statistics: Statistics::default(), selection };
        let job = CaptureJob::new(series, &arguments.input, options, None);
        let read = job.read_from(part, |part, first, span| part.selection.begin_capture(first, span))?;
        read.warnings.iter().for_each(|text| print_warning(text));
        let ReadCapture { summary, format, failure, .. } = read;
        let has: Vec<_> = summary.buses().iter().map(Bus::name).collect();
        let named = arguments.bitrate.iter().filter_map(|rate| rate.bus.as_deref());
        let capture = series.name();
        named
            .filter_map(|bus| unknown_bus(&capture, bus, "--bitrate", &has))
            .for_each(|text| print_warning(&text));
        let missed = summary.part.selection.missed_text(summary.frames(), summary.last_time());
        if let Some(missed) = missed {
            print_warning(&format!("{capture}: {missed}"));
        }
        let (statistics, buses) = (&summary.part.statistics, summary.buses());
        let (capture, bit_rate) = (capture.as_str(), |bus: &Bus| arguments.bit_rate(bus));
        match arguments.format {
            ReportFormat::Text => {
                let bit_rate = &bit_rate;
                let report = StatisticsReport { capture, format, statistics, buses, bit_rate };
                text::write_report(&report, output);
            }
            ReportFormat::Json => {
                let answer = CaptureStatistics::new((capture, format), statistics, buses, bit_rate);
                output.push_str(&format_line(&answer));
            }
        }
        Ok(failure)
    })
}

/// Options for decoding.
///
/// # Errors
/// If an option, the bus file or a profile is not valid.
fn prepare_options(arguments: &StatsArgs) -> Result<SessionOptions, Refusal> {
    let (usage, profile) = (|error| (ExitStatus::Usage, error), |error| (ExitStatus::Profile, error));
    arguments.select.selection().map_err(usage)?;
    let options = session_options(&arguments.input).map_err(profile)?;
    // The command has no findings, but a misspelt rule is an error in the filters of all commands.
    if let Some(filter) = arguments.select.filter.as_ref().filter(|it| !it.compared_with("rule").is_empty()) {
        let setup = build_setup(&arguments.input, &options.catalogue, None).map_err(profile)?;
        check_rules_of(Some(filter), &setup).map_err(usage)?;
    }
    Ok(options)
}

/// Counts the frames and events of a selection.
struct SelectedStatistics {
    statistics: Statistics,
    selection: Selection,
}

impl ReadingPart for SelectedStatistics {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.selection.on_event(event, bus);
        if self.selection.admits_event(event, bus) {
            self.statistics.count_event(event);
        }
    }

    fn need(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        self.selection.is_limited()
    }

    fn skip(&mut self, preview: &MessagePreview, bus: &Bus) {
        self.statistics.skip_event(preview, bus);
    }

    fn demand(&self) -> FrameDemand {
        match (self.selection.has_filter(), self.selection.is_limited()) {
            (true, _) => FrameDemand::Decoded,
            (false, true) => FrameDemand::Each,
            (false, false) => FrameDemand::Batches,
        }
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) {
        if self.selection.has_filter() {
            self.selection.begin_frame(frame);
        } else if self.selection.admits_frame(frame) {
            self.statistics.count_frame(frame);
        }
    }

    fn frames(&mut self, frames: &[Frame], _names: &BusNames) {
        if frames.first().is_some_and(|first| self.selection.admits_frame(first)) {
            self.statistics.count_frames(frames);
        }
    }

    fn frame_decoded(&mut self, frame: &Frame, bus: &Bus) {
        if self.selection.admits_frame(frame) && self.selection.admits_decoded(bus) {
            self.statistics.count_frame(frame);
        }
    }

    fn finish(&mut self, buses: Buses<'_>) {
        ReadingPart::finish(&mut self.statistics, buses);
    }
}
