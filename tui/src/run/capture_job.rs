//! Reading of one capture from its files, shared by most commands.

use std::sync::Arc;

use anyhow::Context as _;
use cobscope_decoder::capture::{Batch, BusNames, Notice};
use cobscope_decoder::frame::Frame;
use cobscope_decoder::reading::{Reading, ReadingPart, Summary};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use cobscope_decoder::sink::escape;

use super::input::{capture_series, read_options, session_options, unknown_buses};
use super::messages::{exit_of, print_error, print_warning};
use super::output;
use super::remarks;
use crate::exit_code::ExitStatus;
use crate::run::arguments::InputArgs;
use crate::select::Span;
use crate::source::{CaptureSeries, SeriesFrames, time_span};
use crate::words::unheard_until;

/// A capture, and how it is read.
#[derive(Clone, Copy)]
pub struct CaptureJob<'a> {
    pub series: &'a CaptureSeries,
    pub input: &'a InputArgs,
    pub options: &'a SessionOptions,
    /// Rules; `None` if the capture is only decoded.
    pub setup: Option<&'a Arc<RuleSetup>>,
    /// No progress is shown: stderr belongs to something else, or events are printed to the terminal.
    pub is_quiet: bool,
    /// The cores are used for other captures.
    pub is_one_of_several: bool,
}

/// A capture that was read, perhaps not to its end.
pub struct ReadCapture<P> {
    /// Findings, state after the last frame, and the part.
    pub summary: Summary<P>,
    /// Title of the capture format.
    pub format: &'static str,
    /// Error that ended reading early.
    pub failure: Option<anyhow::Error>,
    /// Warnings for the user.
    pub warnings: Vec<String>,
    /// Number of unreadable lines and records, with the first one; `None` without any.
    pub unreadable: Option<String>,
}

impl<P> ReadCapture<P> {
    /// Prints warnings, and the number of unreadable lines and records.
    pub fn report(&self) {
        self.warnings.iter().chain(&self.unreadable).for_each(|text| print_warning(text));
    }

    /// The capture with another part.
    #[cfg(feature = "parquet")]
    pub fn map<Q>(self, change: impl FnOnce(P) -> Q) -> ReadCapture<Q> {
        let Self { summary, format, failure, warnings, unreadable } = self;
        ReadCapture { summary: summary.map(change), format, failure, warnings, unreadable }
    }

    /// Error that ended reading early, as text.
    pub fn failure_text(&self) -> Option<String> {
        self.failure.as_ref().map(|failure| format!("{failure:#}"))
    }
}

/// State of a capture after its last read frame.
struct CaptureEnd {
    has_frames: bool,
    failure: Option<anyhow::Error>,
    /// The first unreadable line.
    unreadable: Option<String>,
    /// Number of incomplete ends.
    cut_off: u64,
}

/// Position and reason of the first unreadable line or record of a batch.
fn first_unreadable(notices: &[(usize, Notice)], frames: &SeriesFrames) -> Option<String> {
    let is_unreadable = |(_, notice): &&(usize, Notice)| matches!(notice, Notice::Unreadable { .. });
    let (_, notice) = notices.iter().find(is_unreadable)?;
    Some(if frames.is_joined() { format!("{} {notice}", frames.file_name()) } else { notice.to_string() })
}

/// Number of unreadable lines and records with the first one; `None` without any.
fn unreadable_text(name: &str, count: u64, first: Option<&str>) -> Option<String> {
    let first = first?;
    match count {
        0 => None,
        1 => Some(format!("{name}: 1 line or record unreadable ({first}); all others decoded")),
        count => {
            Some(format!("{name}: {count} lines or records unreadable (first: {first}); all others decoded"))
        }
    }
}

impl<'a> CaptureJob<'a> {
    /// Decodes a capture with rules, if there are any.
    pub fn new(
        series: &'a CaptureSeries,
        input: &'a InputArgs,
        options: &'a SessionOptions,
        setup: Option<&'a Arc<RuleSetup>>,
    ) -> Self {
        Self { series, input, options, setup, is_quiet: false, is_one_of_several: false }
    }

    /// As [`Self::new`], without progress.
    pub fn quiet(self, is_quiet: bool) -> Self {
        Self { is_quiet, ..self }
    }

    /// Reads the capture to its end, or until the part ends it.
    ///
    /// # Errors
    /// If the capture cannot be opened or recognised, or contains no frames.
    pub fn read<P: ReadingPart>(&self, part: P) -> anyhow::Result<ReadCapture<P>> {
        self.read_from(part, |_, _, _| Ok(()))
    }

    /// As [`Self::read`]; `begin` takes the first frame before any event, and a function that reads the capture for its
    /// span of time.
    ///
    /// # Errors
    /// Also those of `begin`: the request is not possible for this capture.
    pub fn read_from<P: ReadingPart>(
        &self,
        part: P,
        mut begin: impl FnMut(&mut P, &Frame, Span<'_>) -> anyhow::Result<()>,
    ) -> anyhow::Result<ReadCapture<P>> {
        let Self { series, input, .. } = *self;
        let name = series.name();
        let mut frames = SeriesFrames::open(series, read_options(input), !self.is_one_of_several)?;
        if self.is_quiet || self.is_one_of_several {
            frames.hide_progress();
        }
        let mut reading = Reading::of_options(self.options.clone(), self.setup.cloned(), part);
        let mut batch = Batch::new();
        let mut has_frames = false;
        let mut failure = None;
        let (mut unreadable, mut cut_off) = (None, 0);
        let mut file = None;
        while !reading.is_done() {
            match frames.read(&mut batch) {
                Ok(true) => {}
                Ok(false) => break,
                Err(error) => {
                    failure = failure.or(Some(error));
                    if frames.has_more_parts() {
                        continue;
                    }
                    break;
                }
            }
            if frames.is_joined() && file != Some(frames.part_index()) {
                file = Some(frames.part_index());
                reading.begin_file(&frames.file_name());
            }
            if let Some(first) = batch.frames().first().filter(|_| !has_frames) {
                let mut span = || time_span(&series.parts, &read_options(input));
                begin(reading.part_mut(), first, &mut span).with_context(|| name.clone())?;
                has_frames = true;
            }
            unreadable = unreadable.or_else(|| first_unreadable(batch.notices(), &frames));
            cut_off += u64::from(batch.cut_off().is_some());
            if !reading.take(&batch, frames.buses()) {
                break;
            }
            // A part that ended early ignores a truncated end.
            if failure.is_none() && !reading.is_done() {
                failure =
                    batch.cut_off().map(|reason| anyhow::Error::msg(reason).context(frames.file_name()));
            }
            frames.update_progress();
        }
        frames.finish_progress();
        let end = CaptureEnd { has_frames, failure, unreadable, cut_off };
        self.finish_reading(reading, &frames, end)
    }

    /// Ends a reading, and returns what it says.
    fn finish_reading<P: ReadingPart>(
        &self,
        mut reading: Reading<P>,
        frames: &SeriesFrames,
        end: CaptureEnd,
    ) -> anyhow::Result<ReadCapture<P>> {
        let CaptureEnd { has_frames, failure, unreadable, cut_off } = end;
        let name = self.series.name();
        reading.close(frames.buses());
        // After an incomplete read not all buses are known.
        let is_done = reading.is_done();
        let warnings = if is_done { Vec::new() } else { self.warnings(&name, frames.buses(), &reading) };
        match failure {
            Some(failure) if !has_frames => Err(failure),
            None if !has_frames => anyhow::bail!("{name}: contains no frames"),
            failure => {
                // The end of an incomplete capture is a failure.
                let count = reading.decoder().unreadable_count().saturating_sub(cut_off);
                Ok(ReadCapture {
                    summary: reading.finish(),
                    format: frames.format().title,
                    failure,
                    warnings,
                    unreadable: unreadable_text(&name, count, unreadable.as_deref()),
                })
            }
        }
    }

    /// Notes on buses and nodes that are absent, and on frames that are not decoded.
    fn warnings<P: ReadingPart>(&self, name: &str, names: &BusNames, reading: &Reading<P>) -> Vec<String> {
        let mut warnings = unknown_buses(name, self.input, self.options, names);
        let (capture, buses) = (escape(name).into_owned(), reading.decoder().buses());
        warnings.extend(remarks::decoding_limits(&capture, buses));
        warnings.extend(unheard_until(&capture, buses, self.options, reading.end_moment().as_deref()));
        warnings
    }
}

/// Creates a report for each capture and prints all of them, including those for truncated captures.
pub fn report(
    input: &InputArgs,
    one: impl FnMut(&CaptureSeries, &SessionOptions, &mut String) -> anyhow::Result<Option<anyhow::Error>>,
) -> ExitStatus {
    match session_options(input) {
        Ok(options) => report_with(input, &options, one),
        Err(error) => {
            print_error(&error);
            ExitStatus::Profile
        }
    }
}

/// As [`report`], with options that were read before.
pub fn report_with(
    input: &InputArgs,
    options: &SessionOptions,
    mut one: impl FnMut(&CaptureSeries, &SessionOptions, &mut String) -> anyhow::Result<Option<anyhow::Error>>,
) -> ExitStatus {
    let mut exit = ExitStatus::Clean;
    let mut text = String::new();
    for series in capture_series(input) {
        if let Some(error) = one(&series, options, &mut text).unwrap_or_else(Some) {
            print_error(&error);
            exit = exit.max(exit_of(&error));
        }
    }
    exit.max(output::print_text(text.as_bytes()))
}
