//! Adds one capture: hash, decoding with all rules, files.

use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::diagnosis::Diagnosis;
use cobscope_decoder::finding::Severity;
use cobscope_decoder::reading::Borrowed;
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::findings::{CaptureOutcome, CaptureResult};
use cobscope_decoder::sink::lake::{LakeCapture, LakeResults, LakeWriter};
use cobscope_decoder::statistics::{CaptureQuality, Statistics};

use super::arguments::LakeAddArgs;
use super::content::CaptureContent;
use super::folder::{CaptureStaging, LakeFolder};
use super::machine::machine_of;
use crate::cmd::check::{line_numbers, parts};
use crate::path_text::path_text;
use crate::record::format::is_of_captures;
use crate::run::arguments::InputArgs;
use crate::run::capture_job::{CaptureJob, ReadCapture};
use crate::run::captures::{SourceSeries, is_no_capture};
use crate::run::input::read_options;
use crate::run::lake_index::{EntrySummary, LakeEntry};
use crate::source::{CaptureSeries, open_capture};

/// Lowest severity that counts as a failure, the default of `check`.
const LEAST: Option<Severity> = Some(Severity::Error);

/// Input for all captures.
pub(super) struct AddInputs<'a> {
    pub(super) lake: &'a LakeFolder,
    pub(super) arguments: &'a LakeAddArgs,
    pub(super) options: &'a SessionOptions,
    pub(super) setup: &'a Arc<RuleSetup>,
    pub(super) is_alone: bool,
}

/// Result for one capture.
pub(super) enum LakeAddition {
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
    pub(super) outcome: CaptureOutcome,
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
    pub(super) fn add(&self, source: &SourceSeries) -> anyhow::Result<LakeAddition> {
        let series = &source.series;
        if source.folder.is_some() && self.is_other_file(series) {
            return Ok(LakeAddition::Skipped);
        }
        let of_bus_file = self.options.bus_file.machine.as_deref();
        let machine = match machine_of(series.first_path(), self.arguments, of_bus_file) {
            Ok(machine) => machine,
            Err(error) => return Ok(LakeAddition::Unnamed(error)),
        };
        let content = CaptureContent::of(&series.parts)?;
        let _lock = self.lake.lock(&content.hash)?;
        if let Some(entry) = self.lake.entry(&content.hash).filter(|_| !self.arguments.replace) {
            return Ok(LakeAddition::Present(entry));
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
        let read = self.read(series, capture, &mut staging).with_context(|| path_text(&self.arguments.lake));
        match read.and_then(|read| content.ensure_unchanged().map(|()| read)) {
            Ok(LakeAddition::Added(mut added)) => {
                added.files = staging.commit(&series.name(), std::mem::take(&mut added.summary))?;
                added.machine = machine;
                Ok(LakeAddition::Added(added))
            }
            other => {
                staging.discard();
                other
            }
        }
    }

    /// Whether a file in a folder is not a capture, and does not look like one.
    fn is_other_file(&self, series: &CaptureSeries) -> bool {
        let opened = open_capture(series.first_path(), &read_options(&self.arguments.input));
        opened.is_err_and(|error| is_no_capture(&error) && !is_of_captures(series.first_path()))
    }

    /// Decodes a capture into files.
    fn read(
        &self,
        series: &CaptureSeries,
        capture: LakeCapture,
        staging: &mut CaptureStaging<'_>,
    ) -> anyhow::Result<LakeAddition> {
        let name = series.name();
        let mut writer = LakeWriter::new(capture, staging);
        let job = CaptureJob {
            is_one_of_several: !self.is_alone,
            ..CaptureJob::new(series, &self.arguments.input, self.options, Some(self.setup))
        };
        let added = match job.read((Statistics::default(), Borrowed(&mut writer))) {
            Ok(read) => {
                // The borrow of the writer ends with its part of the pass.
                let read = read.map(|(statistics, _)| statistics);
                finish(writer, read, (series, &self.arguments.input))
            }
            Err(error) => {
                let failure = format!("{error:#}");
                let judged =
                    CaptureResult { capture: name, failure: Some(failure), ..CaptureResult::default() };
                finish_unread(writer, &judged)
            }
        };
        added.map(LakeAddition::Added)
    }
}

/// Writes the results of a capture that was read, perhaps not to its end.
fn finish(
    writer: LakeWriter<'_>,
    read: ReadCapture<Statistics>,
    (series, input): (&CaptureSeries, &InputArgs),
) -> anyhow::Result<AddedCapture> {
    let failure = read.failure_text();
    let ReadCapture { summary, format, mut warnings, unreadable, .. } = read;
    let diagnosis = summary.diagnosis();
    warnings.extend(unreadable);
    if writer.messages_skipped() > 0 {
        warnings.push(format!(
            "{}: {} or more messages without a wide table",
            series.name(),
            writer.messages_skipped()
        ));
    }
    let mut judged = CaptureResult {
        capture: series.name(),
        frames: summary.frames(),
        first: summary.first_time(),
        last: summary.last_time(),
        findings: summary.findings,
        failure,
        parts: parts(series),
        ..CaptureResult::default()
    };
    if series.is_joined() {
        judged.lines = line_numbers(series, input, &judged.frames_of_findings());
    }
    let results = LakeResults {
        judged: &judged,
        diagnosis: &diagnosis,
        quality: &summary.part.quality,
        buses: summary.decoder.buses(),
        format: Some(format),
        least: LEAST,
    };
    writer.finish_capture(&results)?;
    Ok(added(&results, warnings))
}

/// Writes the row of a capture that cannot be read at all.
fn finish_unread(writer: LakeWriter<'_>, judged: &CaptureResult) -> anyhow::Result<AddedCapture> {
    let decoder = cobscope_decoder::decoder::Decoder::new(SessionOptions::default());
    let (diagnosis, quality) = (Diagnosis::default(), CaptureQuality::default());
    let results = LakeResults {
        judged,
        diagnosis: &diagnosis,
        quality: &quality,
        buses: decoder.buses(),
        format: None,
        least: LEAST,
    };
    writer.finish_capture(&results)?;
    Ok(added(&results, Vec::new()))
}

fn added(results: &LakeResults<'_>, warnings: Vec<String>) -> AddedCapture {
    let LakeResults { judged, diagnosis, buses, .. } = results;
    AddedCapture {
        machine: String::new(),
        frames: judged.frames,
        files: 0,
        outcome: judged.overall_outcome(LEAST),
        failure: judged.failure.clone(),
        warnings,
        summary: EntrySummary::summary_of(judged, diagnosis, *buses, LEAST),
    }
}
