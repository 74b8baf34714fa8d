//! Checks captures, several in parallel.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::available_parallelism;

use cobscope_decoder::capture::{Batch, is_compressed};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::{Buses, SessionOptions};
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::findings::{CapturePart, CaptureResult};

use super::arguments::CheckArgs;
use crate::run::arguments::{InputArgs, node_choices};
use crate::run::capture_job::{CaptureJob, ReadCapture};
use crate::run::captures::{SourceSeries, is_no_capture, passed_over};
use crate::run::input::read_options;
use crate::run::selected_findings::SelectedFindings;
use crate::source::{self, CaptureSeries};
use crate::words::absent_choices;

/// Result for one file.
#[derive(Default)]
pub(super) struct JudgedFile {
    /// Findings and verdicts; `None` for a file in a folder without a known format.
    pub(super) judged: Option<CaptureResult>,
    /// Numbers of the selected findings; `None` without a selection.
    pub(super) selected: Option<BTreeSet<u64>>,
    /// Messages for stderr.
    pub(super) messages: Vec<String>,
    /// Whether the file was not read, or not to its end, or a node of `--only-node` sent no frame.
    pub(super) has_failed: bool,
}

impl JudgedFile {
    /// A file that cannot be read; in a folder, one without a known format is skipped.
    fn unread(source: &SourceSeries, capture: String, error: &anyhow::Error) -> Self {
        if source.folder.is_some() && is_no_capture(error) {
            let messages = passed_over(source.series.first_path(), error).into_iter().collect();
            return Self { messages, ..Self::default() };
        }
        let failure = format!("{error:#}");
        let messages = vec![escape(&failure).into_owned()];
        let judged = CaptureResult { capture, failure: Some(failure), ..CaptureResult::default() };
        Self { judged: Some(judged), selected: None, messages, has_failed: true }
    }
}

/// Shared input for all captures.
struct JudgeInputs<'a> {
    arguments: &'a CheckArgs,
    options: &'a SessionOptions,
    setup: &'a Arc<RuleSetup>,
    is_alone: bool,
}

/// Checks all captures; results are in the order of the captures.
pub(super) fn judge_all(
    captures: &[SourceSeries],
    arguments: &CheckArgs,
    options: &SessionOptions,
    setup: &Arc<RuleSetup>,
) -> Vec<JudgedFile> {
    let wanted = arguments.threads.or_else(|| available_parallelism().ok()).map_or(1, usize::from);
    let threads = wanted.min(captures.len()).max(1);
    let bench = JudgeInputs { arguments, options, setup, is_alone: threads == 1 };
    let next = AtomicUsize::new(0);
    let work = || {
        let mut done = Vec::new();
        loop {
            let place = next.fetch_add(1, Ordering::Relaxed);
            let Some(source) = captures.get(place) else { return done };
            done.push((place, bench.judge(source)));
        }
    };
    let mut all: Vec<(usize, JudgedFile)> = if threads == 1 {
        work()
    } else {
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
            let results = workers.into_iter().map(|worker| match worker.join() {
                Ok(done) => done,
                Err(panic) => std::panic::resume_unwind(panic),
            });
            results.flatten().collect()
        })
    };
    all.sort_by_key(|(place, _)| *place);
    all.into_iter().map(|(_, done)| done).collect()
}

impl JudgeInputs<'_> {
    fn judge(&self, source: &SourceSeries) -> JudgedFile {
        let series = &source.series;
        let capture = series.name();
        let job = CaptureJob {
            is_one_of_several: !self.is_alone,
            ..CaptureJob::new(series, &self.arguments.input, self.options, Some(self.setup))
        };
        let read = job.read_from(self.selected(), |selected, first, span| {
            selected.as_mut().map_or(Ok(()), |selected| selected.begin(first, span))
        });
        let read = match read {
            Ok(read) => read,
            Err(error) => return JudgedFile::unread(source, capture, &error),
        };
        let failure = read.failure_text();
        let ReadCapture { summary, warnings: mut messages, .. } = read;
        let (frames, first, last) = (summary.frames(), summary.first_time(), summary.last_time());
        let missed = summary.part.as_ref().and_then(|selected| selected.missed(frames, last));
        messages.extend(missed.map(|missed| format!("{capture}: {missed}")));
        let absent = self.absent_nodes(&capture, summary.buses());
        // A verdict on a node without a frame is not a verdict.
        let has_failed = failure.is_some() || !absent.is_empty();
        let absent: Vec<_> = absent.into_iter().filter(|note| !messages.contains(note)).collect();
        messages.extend(absent);
        let findings = summary.findings;
        let selected = summary.part.map(|selected| selected.numbers(&findings.groups));
        messages.extend(failure.iter().map(|failure| escape(failure).into_owned()));
        let parts = parts(series);
        let mut judged = CaptureResult {
            capture,
            frames,
            first,
            last,
            findings,
            failure,
            parts,
            ..CaptureResult::default()
        };
        if self.arguments.format.has_lines || series.is_joined() {
            judged.lines = line_numbers(series, &self.arguments.input, &judged.frames_of_findings());
        }
        JudgedFile { judged: Some(judged), selected, messages, has_failed }
    }
}

impl JudgeInputs<'_> {
    fn selected(&self) -> Option<SelectedFindings> {
        let select = &self.arguments.select;
        // Checked before.
        let selection = select.is_any().then(|| select.selection().ok()).flatten()?;
        Some(SelectedFindings::new(selection))
    }

    /// Notes on nodes of `--only-node` that sent no frame.
    fn absent_nodes(&self, capture: &str, buses: Buses<'_>) -> Vec<String> {
        // Checked before.
        let nodes = node_choices(&self.arguments.select.only_node).unwrap_or_default();
        absent_choices(&escape(capture), buses, &nodes)
    }
}

/// Parts of a series with the numbers of their first frames.
pub(in crate::cmd) fn parts(series: &CaptureSeries) -> Vec<CapturePart> {
    let all = series.parts.iter().zip(&series.first_frames);
    all.map(|(path, frame)| CapturePart { file: path.display().to_string(), first_frame: *frame }).collect()
}

/// Line numbers of frames in a text capture, each in the file of its part.
pub(in crate::cmd) fn line_numbers(
    series: &CaptureSeries,
    input: &InputArgs,
    frames: &BTreeSet<u64>,
) -> BTreeMap<u64, u64> {
    if !series.is_joined() {
        return lines_of_file(series.first_path(), input, frames);
    }
    let mut all = BTreeMap::new();
    for (index, (path, first)) in series.parts.iter().zip(&series.first_frames).enumerate() {
        let end = series.first_frames.get(index + 1).copied().unwrap_or(u64::MAX);
        let before = first.saturating_sub(1);
        let own: BTreeSet<u64> = frames.range(*first..end).map(|frame| frame - before).collect();
        let found = lines_of_file(path, input, &own);
        all.extend(found.into_iter().map(|(frame, line)| (frame.saturating_add(before), line)));
    }
    all
}

/// Line numbers of frames in a text file, by reading it again as far as necessary.
fn lines_of_file(path: &Path, input: &InputArgs, frames: &BTreeSet<u64>) -> BTreeMap<u64, u64> {
    let mut lines = BTreeMap::new();
    let (Some(last), false) = (frames.last(), path.as_os_str() == "-") else { return lines };
    let mut head = [0; 4];
    let is_plain =
        File::open(path).and_then(|mut file| file.read(&mut head)).is_ok() && !is_compressed(&head);
    let Some(mut capture) = source::open_capture(path, &read_options(input)).ok().filter(|_| is_plain) else {
        return lines;
    };
    let mut batch = Batch::of_one();
    while let Ok(true) = capture.reader.read(&mut batch) {
        let Some(line) = capture.reader.line_number() else { break };
        let Some(frame) = batch.frames().first() else { continue };
        if frames.contains(&frame.number) {
            lines.insert(frame.number, line);
        }
        if frame.number >= *last {
            break;
        }
    }
    lines
}
