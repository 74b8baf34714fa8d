//! Adds one capture: hash, decoding with all rules, files.

use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::diagnosis::{Diagnosis, Setting};
use cobscope_decoder::event::Event;
use cobscope_decoder::finding::Severity;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::rules::{Engine, Judge, Setup};
use cobscope_decoder::session::{Bus, Observer, SessionOptions};
use cobscope_decoder::sink::findings::{CaptureResult, Outcome};
use cobscope_decoder::sink::lake::{LakeCapture, LakeResults, LakeWriter};
use cobscope_decoder::statistics::{Quality, Statistics};

use super::content::CaptureContent;
use super::folder::{LakeFolder, Staging};
use super::machine::machine_of;
use crate::cli::{InputArgs, LakeAddArgs};
use crate::cmd::captures::{SourceSeries, is_no_capture};
use crate::cmd::check::{line_numbers, parts};
use crate::cmd::decoding::{CaptureObserver, DecodedCapture, decode_quietly};
use crate::cmd::input::read_options;
use crate::cmd::lake_index::{EntrySummary, LakeEntry};
use crate::path_text::shown;
use crate::record::format::is_of_captures;
use crate::select::Span;
use crate::source::{Series, open};

/// Lowest severity that counts as a failure, the default of `check`.
const LEAST: Option<Severity> = Some(Severity::Error);

/// Input for all captures.
pub(super) struct AddInputs<'a> {
    pub(super) lake: &'a LakeFolder,
    pub(super) arguments: &'a LakeAddArgs,
    pub(super) options: &'a SessionOptions,
    pub(super) setup: &'a Arc<Setup>,
    pub(super) is_alone: bool,
}

/// Result for one capture.
pub(super) enum Addition {
    /// It is new in the lake.
    Added(AddedCapture),
    /// Its content was in the lake.
    Present(LakeEntry),
    /// A file in a folder that is not a capture.
    Skipped,
    /// The option names no machine for it, for this reason.
    Unnamed(anyhow::Error),
}

/// A capture that was added.
pub(super) struct AddedCapture {
    pub(super) machine: String,
    pub(super) frames: u64,
    pub(super) files: usize,
    pub(super) outcome: Outcome,
    /// Reason why the capture was not read, or not to its end.
    pub(super) failure: Option<String>,
    /// Messages for stderr.
    pub(super) warnings: Vec<String>,
    /// Verdict and stories, for the index.
    summary: EntrySummary,
}

impl AddInputs<'_> {
    /// Adds a capture unless its content is in the lake.
    ///
    /// # Errors
    /// The files cannot be read at all, or the lake cannot be written.
    pub(super) fn add(&self, source: &SourceSeries) -> anyhow::Result<Addition> {
        let series = &source.series;
        if source.folder.is_some() && self.is_other_file(series) {
            return Ok(Addition::Skipped);
        }
        let of_bus_file = self.options.bus_file.machine.as_deref();
        let machine = match machine_of(series.first(), self.arguments, of_bus_file) {
            Ok(machine) => machine,
            Err(error) => return Ok(Addition::Unnamed(error)),
        };
        let content = CaptureContent::of(&series.parts)?;
        let _lock = self.lake.lock(&content.hash)?;
        if let Some(entry) = self.lake.entry(&content.hash).filter(|_| !self.arguments.replace) {
            return Ok(Addition::Present(entry));
        }
        let capture = LakeCapture {
            name: series.name(),
            hash: content.hash.clone(),
            size: content.size,
            parts: series.parts.len(),
            day: self.arguments.day,
            has_frames: self.arguments.frames,
            has_all_events: self.arguments.all_events,
            has_wide: self.arguments.wide,
        };
        let mut staging = self.lake.stage(&content.hash, &machine)?;
        // Reasons why the capture cannot be read are part of its row: what remains concerns the lake.
        let read = self.read(series, capture, &mut staging).with_context(|| shown(&self.arguments.lake));
        match read.and_then(|read| content.ensure_unchanged().map(|()| read)) {
            Ok(Addition::Added(mut added)) => {
                added.files = staging.commit(&series.name(), std::mem::take(&mut added.summary))?;
                added.machine = machine;
                Ok(Addition::Added(added))
            }
            other => {
                staging.discard();
                other
            }
        }
    }

    /// Whether a file in a folder is not a capture, and does not look like one.
    fn is_other_file(&self, series: &Series) -> bool {
        let opened = open(series.first(), &read_options(&self.arguments.input));
        opened.is_err_and(|error| is_no_capture(&error) && !is_of_captures(series.first()))
    }

    /// Decodes a capture into files.
    fn read(
        &self,
        series: &Series,
        capture: LakeCapture,
        staging: &mut Staging<'_>,
    ) -> anyhow::Result<Addition> {
        let name = series.name();
        let mut watch = AddObserver {
            engine: Engine::new(Arc::clone(self.setup)),
            statistics: Statistics::default(),
            writer: LakeWriter::new(capture, staging),
            first: None,
            last: None,
            is_alone: self.is_alone,
        };
        let decoded = match decode_quietly(series, &self.arguments.input, self.options, &mut watch) {
            Ok(decoded) => decoded,
            Err(error) => {
                let failure = format!("{error:#}");
                let judged =
                    CaptureResult { capture: name, failure: Some(failure), ..CaptureResult::default() };
                return finish_unread(watch.writer, &judged).map(Addition::Added);
            }
        };
        finish(watch, &decoded, (series, &self.arguments.input)).map(Addition::Added)
    }
}

/// Writes the results of a capture that was read, perhaps not to its end.
fn finish(
    watch: AddObserver<'_>,
    decoded: &DecodedCapture,
    (series, input): (&Series, &InputArgs),
) -> anyhow::Result<AddedCapture> {
    let AddObserver { engine, mut statistics, mut writer, first, last, .. } = watch;
    let buses = decoded.decoder.buses();
    statistics.withdraw(buses);
    let findings = engine.finish(buses, &mut writer);
    let mut warnings = decoded.warnings.clone();
    warnings.extend(decoded.unreadable_text(&series.name()));
    if writer.messages_skipped() > 0 {
        warnings.push(format!(
            "{}: {} or more messages without a wide table",
            series.name(),
            writer.messages_skipped()
        ));
    }
    let mut judged = CaptureResult {
        capture: series.name(),
        frames: decoded.decoder.frames(),
        first,
        last,
        findings,
        failure: decoded.failure.as_ref().map(|failure| format!("{failure:#}")),
        parts: parts(series),
        ..CaptureResult::default()
    };
    if series.is_joined() {
        judged.lines = line_numbers(series, input, &judged.frames_of_findings());
    }
    let setting = Setting { zero: first, ..Setting::default() };
    let diagnosis = Diagnosis::of(&judged.findings, judged.findings.counting(), setting);
    let results = LakeResults {
        judged: &judged,
        diagnosis: &diagnosis,
        quality: &statistics.quality,
        buses,
        format: Some(decoded.format),
        least: LEAST,
    };
    writer.finish(&results)?;
    Ok(added(&results, warnings))
}

/// Writes the row of a capture that cannot be read at all.
fn finish_unread(writer: LakeWriter<'_>, judged: &CaptureResult) -> anyhow::Result<AddedCapture> {
    let decoder = cobscope_decoder::decoder::Decoder::new(SessionOptions::default());
    let (diagnosis, quality) = (Diagnosis::default(), Quality::default());
    let results = LakeResults {
        judged,
        diagnosis: &diagnosis,
        quality: &quality,
        buses: decoder.buses(),
        format: None,
        least: LEAST,
    };
    writer.finish(&results)?;
    Ok(added(&results, Vec::new()))
}

fn added(results: &LakeResults<'_>, warnings: Vec<String>) -> AddedCapture {
    let LakeResults { judged, diagnosis, buses, .. } = results;
    AddedCapture {
        machine: String::new(),
        frames: judged.frames,
        files: 0,
        outcome: judged.outcome(LEAST),
        failure: judged.failure.clone(),
        warnings,
        summary: EntrySummary::of(judged, diagnosis, *buses, LEAST),
    }
}

/// Observer that runs the rules, counts and writes.
struct AddObserver<'a> {
    engine: Engine,
    statistics: Statistics,
    writer: LakeWriter<'a>,
    first: Option<Timestamp>,
    last: Option<Timestamp>,
    is_alone: bool,
}

impl Observer for AddObserver<'_> {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.statistics.event(event);
        Judge { engine: &mut self.engine, out: &mut self.writer }.event(event, bus);
    }
}

impl CaptureObserver for AddObserver<'_> {
    fn is_done(&self) -> bool {
        self.writer.has_failed()
    }

    /// Hides the progress line if several captures are read in parallel.
    fn is_on_terminal(&self) -> bool {
        !self.is_alone
    }

    fn has_another_core(&self) -> bool {
        self.is_alone
    }

    fn begin(&mut self, first: &Frame, _span: Span<'_>) -> anyhow::Result<()> {
        self.first = first.time;
        Ok(())
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) -> bool {
        self.last = frame.time;
        self.statistics.frame(frame);
        self.engine.frame(frame);
        if self.writer.wants_frames() {
            let name = names.names().get(usize::from(frame.bus.0)).map_or("", String::as_str);
            self.writer.frame(frame, name);
        }
        true
    }

    fn frames(&mut self, frames: &[Frame], names: &BusNames) -> usize {
        let Some(first) = frames.first() else { return 0 };
        if self.writer.wants_frames() {
            return usize::from(self.frame(first, names));
        }
        let counted = frames.get(..self.engine.frames(frames)).unwrap_or(frames);
        self.statistics.frames(counted);
        self.last = counted.last().map_or(self.last, |frame| frame.time);
        counted.len()
    }
}
