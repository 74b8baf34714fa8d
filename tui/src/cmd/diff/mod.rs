//! `cobscope diff`: differences between two captures.

mod arguments;
mod pair;
pub(super) mod quiet;

pub(super) use pair::{ensure_start, one, pair};
pub(super) use quiet::ComparisonJob;

use std::io::Write as _;
use std::sync::Arc;

use cobscope_decoder::Summary;
use cobscope_decoder::answers::comparison::ComparisonAnswer;
use cobscope_decoder::answers::format_line;
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::comparison::{
    self, BehaviourRecorder, CaptureComparison, CaptureEnding, CaptureRecord,
};
use cobscope_decoder::event::Event;
use cobscope_decoder::finding::FindingGroup;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::reading::{self, FrameDemand, ReadingPart};
use cobscope_decoder::report::html::{self, ComparisonPage};
use cobscope_decoder::report::{HashedFile, Provenance};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::{Bus, Buses, MessagePreview, SessionOptions};

use super::report::provenance;
use crate::exit_code::ExitStatus;
use crate::run::capture_job::CaptureJob;
use crate::run::input::{build_setup, session_options};
use crate::run::messages::{Refusal, print_error, print_warning};
use crate::run::output;
use crate::run::replaced::{OwnFile, ensure_replaceable, open_replacing};
use crate::run::selected_findings::SelectedFindings;
use crate::select::{Selection, Span};
use crate::source::CaptureSeries;
pub use arguments::DiffArgs;
use arguments::DiffFormat;

/// Runs the command.
pub fn run(arguments: &DiffArgs) -> ExitStatus {
    let ([good, bad], options, setup) = match ready(arguments) {
        Ok(ready) => ready,
        Err((exit, error)) => {
            print_error(&error);
            return exit;
        }
    };
    let read = output::files_read(&arguments.input);
    let mut exit = ExitStatus::Clean;
    let mut records = Vec::new();
    for series in [good, bad] {
        match record(&series, arguments, (&options, &setup), false) {
            Ok((recorded, failure)) => {
                if let Some(error) = failure {
                    print_error(&error);
                    exit = ExitStatus::Capture;
                }
                records.push(recorded);
            }
            Err(error) => {
                print_error(&error);
                return ExitStatus::Capture;
            }
        }
    }
    let [good, bad] = records.as_slice() else { return ExitStatus::Capture };
    let mut compared = comparison::compare_captures(&good.record, &bad.record, &options.bus_file.diff);
    if !arguments.only.is_empty() {
        compared.keep_sections(&arguments.only);
    }
    let text = text_of(&compared, (good, bad), arguments, &options);
    if compared.is_void() {
        exit = ExitStatus::Capture;
    } else if !compared.is_equal() {
        exit = exit.max(ExitStatus::Findings);
    }
    match open_replacing(arguments.output.as_deref(), OwnFile::Comparison, &read) {
        Ok(mut output) => {
            exit.max(output::write_result(output.write_all(text.as_bytes()).and_then(|()| output.finish())))
        }
        Err(error) => {
            print_error(&error);
            ExitStatus::Usage
        }
    }
}

/// The two captures, options for decoding, and rules.
///
/// # Errors
/// If an option, the bus file or a profile is not valid, or the output is refused.
fn ready(arguments: &DiffArgs) -> Result<([CaptureSeries; 2], SessionOptions, Arc<RuleSetup>), Refusal> {
    let (usage, profile) = (|error| (ExitStatus::Usage, error), |error| (ExitStatus::Profile, error));
    let pair = pair(&arguments.input).map_err(usage)?;
    ensure_start(arguments).map_err(usage)?;
    selection(arguments).map_err(usage)?;
    let options = session_options(&arguments.input).map_err(profile)?;
    let setup = build_setup(&arguments.input, &options.catalogue, None).map_err(profile)?;
    let read = output::files_read(&arguments.input);
    ensure_replaceable(arguments.output.as_deref(), OwnFile::Comparison, &read).map_err(usage)?;
    Ok((pair, options, Arc::new(setup)))
}

/// The comparison in its format.
fn text_of(
    compared: &CaptureComparison,
    (good, bad): (&RecordedCapture, &RecordedCapture),
    arguments: &DiffArgs,
    options: &SessionOptions,
) -> String {
    let (records, tolerances) = ((&good.record, &bad.record), &options.bus_file.diff);
    let mut text = String::new();
    match arguments.format {
        DiffFormat::Text => {
            comparison::text::write_comparison(compared, records, arguments.verbose, &mut text);
        }
        DiffFormat::Json => text = format_line(&ComparisonAnswer::new(compared, records, tolerances)),
        DiffFormat::Html => {
            let provenance = joined(&good.provenance, &bad.provenance);
            let (good, bad) = records;
            let page =
                ComparisonPage { comparison: compared, good, bad, tolerances, provenance: &provenance };
            text = html::write_comparison(&page);
        }
    }
    text
}

/// Files of both captures, each once.
fn joined(good: &Provenance, bad: &Provenance) -> Provenance {
    let mut all = good.clone();
    let is_new = |file: &&HashedFile| {
        !good.files.iter().any(|known| (known.role, &known.name) == (file.role, &file.name))
    };
    all.files.extend(bad.files.iter().filter(is_new).cloned());
    all
}

/// What a comparison needs of a capture.
struct RecordedCapture {
    record: CaptureRecord,
    provenance: Provenance,
}

fn selection(arguments: &DiffArgs) -> anyhow::Result<Selection> {
    Selection::new(None, (arguments.from, arguments.to), Vec::new())
}

/// Record of one capture, and the error that ended reading early.
fn record(
    series: &CaptureSeries,
    arguments: &DiffArgs,
    (options, setup): (&SessionOptions, &Arc<RuleSetup>),
    is_quiet: bool,
) -> anyhow::Result<(RecordedCapture, Option<anyhow::Error>)> {
    let part = SelectedRecord {
        recorder: BehaviourRecorder::new(arguments.at_event.clone()),
        selection: selection(arguments)?,
        is_limited: true,
        findings: SelectedFindings::new(selection(arguments)?),
    };
    let name = series.name();
    let job = CaptureJob::new(series, &arguments.input, options, Some(setup)).quiet(is_quiet);
    let read = job.read_from(part, SelectedRecord::begin)?;
    let missed = read.summary.part.selection.missed_text(read.summary.frames(), read.summary.last_time());
    if !is_quiet {
        read.report();
        if let Some(missed) = missed {
            print_warning(&format!("{name}: {missed}"));
        }
    }
    let first = read.summary.first_time();
    let Summary { mut findings, part, decoder, .. } = read.summary;
    let SelectedRecord { recorder, findings: selected, .. } = part;
    let buses = decoder.buses();
    let numbers = selected.numbers(&findings.groups);
    findings.groups.retain(|group| numbers.contains(&group.id));
    let counting = findings.groups.iter().filter(|group| FindingGroup::is_reported(group));
    let diagnosis = reading::diagnosis_of(&findings, counting, first);
    let ending = CaptureEnding { name: &name, buses, findings: &findings, diagnosis: &diagnosis };
    // Hashes read the files again; only the page contains them.
    let provenance = match arguments.format {
        DiffFormat::Html => provenance(series, &arguments.input, (&options.catalogue, buses)),
        DiffFormat::Text | DiffFormat::Json => Provenance::default(),
    };
    Ok((RecordedCapture { record: recorder.finish_record(&ending), provenance }, read.failure))
}

/// Record of the events, and findings, within the selection.
struct SelectedRecord {
    recorder: BehaviourRecorder,
    selection: Selection,
    /// The selection has a limit.
    is_limited: bool,
    findings: SelectedFindings,
}

impl SelectedRecord {
    fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.recorder.set_zero(first.time);
        self.selection.begin_capture(first, span)?;
        self.is_limited = self.selection.is_limited();
        self.findings.begin(first, span)
    }
}

impl ReadingPart for SelectedRecord {
    fn event(&mut self, event: &Event, bus: &Bus) {
        if !self.is_limited || self.selection.admits_event(event, bus) {
            self.recorder.event(event, bus);
        }
    }

    fn finding(&mut self, event: &Event, bus: &Bus) {
        self.findings.finding(event, bus);
    }

    fn need(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.is_limited || self.recorder.needs(preview, bus)
    }

    fn skip(&mut self, preview: &MessagePreview, bus: &Bus) {
        self.recorder.skip(preview, bus);
    }

    fn demand(&self) -> FrameDemand {
        FrameDemand::Each
    }

    /// The parameters are those at the end of the range.
    fn ends_before(&mut self, frame: &Frame) -> bool {
        self.selection.is_over(frame)
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) {
        if !self.is_limited || self.selection.admits_frame(frame) {
            self.recorder.count_frame(frame);
        }
    }

    fn finish(&mut self, buses: Buses<'_>) {
        ReadingPart::finish(&mut self.recorder, buses);
    }
}
