//! Judges captures, several at the same time.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::available_parallelism;

use cobscope_decoder::capture::{Batch, BusNames, CaptureError, is_compressed};
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::rules::{Engine, Setup};
use cobscope_decoder::session::{Bus, Observer, SessionOptions};
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::findings::Judged;

use super::captures::Source;
use crate::cli::{CheckArgs, InputArgs};
use crate::cmd::decoding::{Watcher, decode_quietly};
use crate::cmd::input::read_options;
use crate::record::format;
use crate::source;

/// What became of a file.
#[derive(Default)]
pub(super) struct Done {
    /// What was judged; nothing of a file in a folder that is no capture.
    pub(super) judged: Option<Judged>,
    /// What is to be said on standard error.
    pub(super) said: Vec<String>,
    /// It could not be read, or not to its end.
    pub(super) has_failed: bool,
}

/// What all captures are judged with.
struct Bench<'a> {
    arguments: &'a CheckArgs,
    options: &'a SessionOptions,
    setup: &'a Arc<Setup>,
    is_alone: bool,
}

/// Judges all captures; the results stand in their order, however many threads there are.
pub(super) fn judge_all(
    captures: &[Source],
    arguments: &CheckArgs,
    options: &SessionOptions,
    setup: &Arc<Setup>,
) -> Vec<Done> {
    let wanted = arguments.threads.or_else(|| available_parallelism().ok()).map_or(1, usize::from);
    let threads = wanted.min(captures.len()).max(1);
    let bench = Bench { arguments, options, setup, is_alone: threads == 1 };
    let next = AtomicUsize::new(0);
    let work = || {
        let mut done = Vec::new();
        loop {
            let place = next.fetch_add(1, Ordering::Relaxed);
            let Some(source) = captures.get(place) else { return done };
            done.push((place, bench.judge(source)));
        }
    };
    let mut all: Vec<(usize, Done)> = if threads == 1 {
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

impl Bench<'_> {
    fn judge(&self, source: &Source) -> Done {
        let path = &source.path;
        let capture = path.display().to_string();
        let mut watch = Watch {
            engine: Engine::new(Arc::clone(self.setup)),
            first: None,
            last: None,
            is_alone: self.is_alone,
        };
        let decoded = match decode_quietly(path, &self.arguments.input, self.options, &mut watch) {
            Ok(decoded) => decoded,
            Err(error) if source.folder.is_some() && is_no_capture(&error) => {
                return Done { said: passed_over(path, &error).into_iter().collect(), ..Done::default() };
            }
            Err(error) => {
                let failure = format!("{error:#}");
                let said = vec![escape(&failure).into_owned()];
                let judged = Judged { capture, failure: Some(failure), ..Judged::default() };
                return Done { judged: Some(judged), said, has_failed: true };
            }
        };
        let Watch { engine, first, last, .. } = watch;
        let findings = engine.finish(decoded.decoder.buses(), &mut |_: &Event, _: &Bus| {});
        let failure = decoded.failure.map(|failure| format!("{failure:#}"));
        let mut said = decoded.warnings;
        said.extend(failure.iter().map(|failure| escape(failure).into_owned()));
        let has_failed = failure.is_some();
        let frames = decoded.decoder.frames();
        let mut judged = Judged { capture, frames, first, last, findings, failure, ..Judged::default() };
        if self.arguments.format.has_lines {
            judged.lines = lines(path, &self.arguments.input, &judged.frames_of_findings());
        }
        Done { judged: Some(judged), said, has_failed }
    }
}

/// What is said of a file in a folder that is no capture: nothing of one that nobody takes for one.
fn passed_over(path: &Path, error: &anyhow::Error) -> Option<String> {
    let shown = path.display().to_string();
    match error.downcast_ref::<CaptureError>()? {
        CaptureError::Empty => Some(format!("{}: is empty, and was passed over", escape(&shown))),
        _ if format::is_of_captures(path) => {
            Some(format!("{}: was passed over", escape(&format!("{error:#}"))))
        }
        _ => None,
    }
}

/// Whether this file is judged: those in a folder are where they are captures.
pub(super) fn is_capture(source: &Source, input: &InputArgs) -> bool {
    let opened = source::open(&source.path, &read_options(input));
    source.folder.is_none() || !opened.err().is_some_and(|error| is_no_capture(&error))
}

/// Whether a file is in no format of captures, so that nobody meant it.
fn is_no_capture(error: &anyhow::Error) -> bool {
    let cause = error.downcast_ref::<CaptureError>();
    matches!(cause, Some(CaptureError::Unrecognised { .. } | CaptureError::Empty))
}

/// Lines of frames, where the capture is a text file: it is read again, as far as needed.
fn lines(path: &Path, input: &InputArgs, frames: &BTreeSet<u64>) -> BTreeMap<u64, u64> {
    let mut lines = BTreeMap::new();
    let (Some(last), false) = (frames.last(), path.as_os_str() == "-") else { return lines };
    let mut head = [0; 4];
    let is_plain =
        File::open(path).and_then(|mut file| file.read(&mut head)).is_ok() && !is_compressed(&head);
    let Some(mut capture) = source::open(path, &read_options(input)).ok().filter(|_| is_plain) else {
        return lines;
    };
    let mut batch = Batch::of_one();
    while let Ok(true) = capture.reader.read(&mut batch) {
        let Some(line) = capture.reader.line() else { break };
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

/// Feeds the engine.
struct Watch {
    engine: Engine,
    first: Option<Timestamp>,
    last: Option<Timestamp>,
    is_alone: bool,
}

impl Observer for Watch {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.engine.event(event, bus, &mut |_: &Event, _: &Bus| {});
    }
}

impl Watcher for Watch {
    /// Several lines of progress would overwrite each other.
    fn is_on_terminal(&self) -> bool {
        !self.is_alone
    }

    fn has_another_core(&self) -> bool {
        self.is_alone
    }

    fn begin(&mut self, first: &Frame) -> anyhow::Result<()> {
        self.first = first.time;
        Ok(())
    }

    fn wants_frames(&self) -> bool {
        true
    }

    fn frame(&mut self, frame: &Frame, _names: &BusNames) -> bool {
        self.last = frame.time;
        self.engine.frame(frame);
        true
    }
}
