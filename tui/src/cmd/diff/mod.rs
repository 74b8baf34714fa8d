//! `cobscope diff`: differences between two captures.

mod json;
mod pair;

use std::sync::Arc;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::comparison::{self, CaptureRecord, Ending, Recorder};
use cobscope_decoder::diagnosis::{self, Diagnosis};
use cobscope_decoder::event::{Event, EventKind};
use cobscope_decoder::finding::{Findings, Group};
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::rules::{Engine, Judge};
use cobscope_decoder::session::{Bus, Observer, Preview, SessionOptions};

use super::decoding::{CaptureObserver, decode_capture};
use super::input::{session_options, setup};
use super::messages::{complain, warn};
use super::output;
use super::selected_findings::SelectedFindings;
use crate::cli::{DiffArgs, ReportFormat};
use crate::exit_code::Exit;
use crate::select::{Selection, Span};
use crate::source::Series;

/// Runs the command.
pub fn run(arguments: &DiffArgs) -> Exit {
    let pair = pair::pair(&arguments.input).and_then(|pair| {
        selection(arguments)?;
        Ok(pair)
    });
    let [good, bad] = match pair {
        Ok(pair) => pair,
        Err(error) => {
            complain(&error);
            return Exit::Usage;
        }
    };
    let options = match session_options(&arguments.input) {
        Ok(options) => options,
        Err(error) => {
            complain(&error);
            return Exit::Profile;
        }
    };
    let mut exit = Exit::Clean;
    let mut records = Vec::new();
    for series in [good, bad] {
        match record(&series, arguments, &options) {
            Ok((record, failure)) => {
                if let Some(error) = failure {
                    complain(&error);
                    exit = Exit::Capture;
                }
                records.push(record);
            }
            Err(error) => {
                complain(&error);
                return Exit::Capture;
            }
        }
    }
    let [good, bad] = records.as_slice() else { return Exit::Capture };
    let mut compared = comparison::compare(good, bad, &options.bus_file.diff);
    if !arguments.only.is_empty() {
        compared.keep(&arguments.only);
    }
    let mut text = String::new();
    match arguments.format {
        ReportFormat::Text => comparison::text::write(&compared, (good, bad), arguments.verbose, &mut text),
        ReportFormat::Json => json::write(&compared, (good, bad), &options.bus_file.diff, &mut text),
    }
    if !compared.is_equal() {
        exit = exit.max(Exit::Findings);
    }
    exit.max(output::print(text.as_bytes()))
}

fn selection(arguments: &DiffArgs) -> anyhow::Result<Selection> {
    Selection::new(None, (arguments.from, arguments.to), Vec::new())
}

/// Record of one capture, and the error that ended reading early.
fn record(
    series: &Series,
    arguments: &DiffArgs,
    options: &SessionOptions,
) -> anyhow::Result<(CaptureRecord, Option<anyhow::Error>)> {
    let setup = Arc::new(setup(&arguments.input, &options.catalogue, None)?);
    let mut watch = Watch {
        engine: Engine::new(setup),
        facts: Facts {
            recorder: Recorder::new(arguments.at_event.clone()),
            selection: selection(arguments)?,
            is_limited: true,
            findings: SelectedFindings::new(selection(arguments)?),
        },
        first: None,
    };
    let decoded = decode_capture(series, &arguments.input, options, &mut watch)?;
    let name = series.name();
    decoded.report_unreadable(&name);
    let buses = decoded.decoder.buses();
    let Watch { engine, mut facts, first } = watch;
    let mut findings = engine.finish(buses, &mut facts);
    let Facts { recorder, selection, findings: selected, .. } = facts;
    if let Some(missed) = selection.missed(decoded.decoder.frames(), decoded.decoder.last_time()) {
        warn(&format!("{name}: {missed}"));
    }
    let numbers = selected.numbers(&findings.groups);
    findings.groups.retain(|group| numbers.contains(&group.id));
    let diagnosis = diagnosis_of(&findings, first);
    let ending = Ending { name: &name, buses, findings: &findings, diagnosis: &diagnosis };
    Ok((recorder.finish(&ending), decoded.failure))
}

fn diagnosis_of(findings: &Findings, zero: Option<Timestamp>) -> Diagnosis {
    let setting = diagnosis::Setting { zero, end: None, is_growing: false };
    Diagnosis::of(findings, findings.groups.iter().filter(|group| Group::counts(group)), setting)
}

/// Facts of the capture, and findings within the selection.
struct Facts {
    recorder: Recorder,
    selection: Selection,
    /// The selection has a limit.
    is_limited: bool,
    findings: SelectedFindings,
}

impl Observer for Facts {
    fn event(&mut self, event: &Event, bus: &Bus) {
        if matches!(event.kind, EventKind::FindingOpened(_) | EventKind::FindingClosed(_)) {
            self.findings.see(event, bus);
        } else if !self.is_limited || self.selection.admits(event, bus) {
            self.recorder.event(event, bus);
        }
    }

    fn needs(&self, preview: &Preview, bus: &Bus) -> bool {
        self.is_limited || self.recorder.needs(preview, bus)
    }

    fn skip(&mut self, preview: &Preview, bus: &Bus) -> bool {
        !self.is_limited && self.recorder.skip(preview, bus)
    }
}

/// Observer of one capture with its rules.
struct Watch {
    engine: Engine,
    facts: Facts,
    first: Option<Timestamp>,
}

impl Observer for Watch {
    fn event(&mut self, event: &Event, bus: &Bus) {
        Judge { engine: &mut self.engine, out: &mut self.facts }.event(event, bus);
    }

    fn needs(&self, preview: &Preview, bus: &Bus) -> bool {
        self.facts.needs(preview, bus) || self.engine.needs(preview, bus)
    }

    fn skip(&mut self, preview: &Preview, bus: &Bus) -> bool {
        Judge { engine: &mut self.engine, out: &mut self.facts }.skip(preview, bus)
    }
}

impl CaptureObserver for Watch {
    fn begin(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.first = first.time;
        self.facts.recorder.set_zero(first.time);
        self.facts.selection.begin(first, span)?;
        self.facts.is_limited = self.facts.selection.is_limited();
        self.facts.findings.begin(first, span)
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) -> bool {
        self.engine.frame(frame);
        if !self.facts.is_limited || self.facts.selection.admits_frame(frame) {
            self.facts.recorder.frame(frame);
        }
        true
    }
}
