//! A capture with its options, which can be read several times.

use std::ffi::OsString;
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use cobscope_decoder::answers::objects::ObjectRecord;
use cobscope_decoder::capture::BusNames;
use cobscope_decoder::event::Event;
use cobscope_decoder::frame::Frame;
use cobscope_decoder::pipeline::Pipeline;
use cobscope_decoder::rules::{Engine, Judge, Setup};
use cobscope_decoder::session::{Bus, Observer, Preview, SessionOptions};
use serde_json::Value;

use super::answer::{Answer, CommandError, answered, check_arguments};
use crate::cli::{CheckArgs, InputArgs};
use crate::cmd::decoding::{CaptureObserver, decode_quietly};
use crate::cmd::input::{read_options, series};
use crate::cmd::messages::Refusal;
use crate::cmd::results::Results;
use crate::cmd::{check, diff};
use crate::exit_code::Exit;
use crate::source::{self, Series};

/// A capture and the options to decode it.
pub struct CaptureSource {
    series: Series,
    input: InputArgs,
    options: SessionOptions,
    setup: Arc<Setup>,
}

/// Receiver of events and frames.
pub trait CaptureReader: Observer {
    /// Whether no more events are needed.
    fn is_done(&self) -> bool;

    /// Whether to call [`Self::frame`].
    fn wants_frames(&self) -> bool;

    /// Called for each frame, before its events; `bus` is its name.
    fn frame(&mut self, frame: &Frame, bus: &str);
}

/// End of a pass.
#[derive(Debug)]
pub struct CaptureEnd {
    /// Error that ended reading early; all frames before it were decoded.
    pub failure: Option<String>,
    /// Messages of the command.
    pub messages: Vec<String>,
}

/// Results of a whole capture, each as its command writes it.
pub struct CaptureResults {
    /// Objects of `check -f jsonl`: findings, then the summary.
    pub findings: Vec<Value>,
    /// Object of `why -f json`.
    pub why: Value,
    /// Objects of `objects -f json`, of all nodes.
    pub objects: Vec<Value>,
    /// Object of `stats -f json`.
    pub statistics: Value,
    /// End of the pass.
    pub end: CaptureEnd,
}

impl CaptureSource {
    /// Opens a capture with the options of `check`: a file, or the parts of one capture.
    ///
    /// # Errors
    /// An option, bus file, profile, device file or database is invalid, or the capture cannot be opened.
    pub fn open(arguments: &[OsString]) -> Result<Answer<Self>, CommandError> {
        answered(|| {
            let source = Self::of(check_arguments(arguments)?)?;
            source.probe().map_err(|error| (Exit::Capture, error))?;
            Ok(source)
        })
    }

    /// Options of live buses: those of `check` without a capture.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn pipeline(arguments: &[OsString]) -> Result<Answer<Pipeline>, CommandError> {
        answered(|| {
            let (options, setup) = check::ready(&check_arguments(arguments)?)?;
            Ok(Pipeline::of_options(options, Some(setup)))
        })
    }

    fn of(arguments: CheckArgs) -> Result<Self, Refusal> {
        let (options, setup) = check::ready(&arguments)?;
        let series = one_capture(&arguments).map_err(|error| (Exit::Usage, error))?;
        Ok(Self { series, input: arguments.input, options, setup })
    }

    /// Name of the capture, as commands print it.
    pub fn name(&self) -> String {
        self.series.name()
    }

    /// Files of the capture, in order.
    pub fn parts(&self) -> Vec<String> {
        self.series.parts.iter().map(|path| path.display().to_string()).collect()
    }

    /// Opens the first part, so that a wrong path is an error before the first pass.
    fn probe(&self) -> anyhow::Result<()> {
        // A pipe can be read only once.
        if self.series.first().is_file() || !self.series.first().exists() {
            source::open(self.series.first(), &read_options(&self.input))?;
        }
        Ok(())
    }

    /// Reads the capture from its start. With `has_rules`, findings are among the events.
    ///
    /// # Errors
    /// If the capture cannot be opened, or contains no frames.
    pub fn read(&self, has_rules: bool, reader: &mut dyn CaptureReader) -> Result<CaptureEnd, CommandError> {
        let engine = has_rules.then(|| Engine::new(Arc::clone(&self.setup)));
        let mut watch = Watch { engine, reader };
        let decoded = decode_quietly(&self.series, &self.input, &self.options, &mut watch)
            .map_err(|error| failed(&error))?;
        let Watch { engine, reader } = watch;
        if let Some(engine) = engine.filter(|_| !reader.is_done()) {
            engine.finish(decoded.decoder.buses(), reader);
        }
        let mut messages = decoded.warnings.clone();
        messages.extend(decoded.unreadable_text(&self.name()));
        Ok(CaptureEnd { failure: decoded.failure.map(|failure| format!("{failure:#}")), messages })
    }

    /// Reads the capture for all results of its end.
    ///
    /// # Errors
    /// As for [`Self::read`].
    pub fn results(&self) -> Result<CaptureResults, CommandError> {
        let results = Results::of(&self.series, &self.input, &self.options, &self.setup)
            .map_err(|error| failed(&error))?;
        let name = self.name();
        let mut objects = Vec::new();
        for bus in results.decoder.buses() {
            for node in bus.nodes() {
                let all = node.store().sorted().into_iter();
                let all = all.map(|object| ObjectRecord::new((bus, node), object, &name));
                objects.extend(all.filter_map(|record| serde_json::to_value(record).ok()));
            }
        }
        Ok(CaptureResults {
            findings: results.findings,
            why: results.why,
            objects,
            statistics: results.statistics,
            end: CaptureEnd { failure: results.failure, messages: results.warnings },
        })
    }
}

/// The capture of the arguments: a file, several parts, or a folder with the parts of one capture.
fn one_capture(arguments: &CheckArgs) -> anyhow::Result<Series> {
    let input = &arguments.input;
    if let [path] = input.captures.as_slice() {
        return diff::one(path, input);
    }
    let mut all = series(input);
    ensure!(
        all.len() == 1,
        "the {} files are {} captures, expected the parts of one (join=True)",
        input.captures.len(),
        all.len()
    );
    all.pop().context("no capture")
}

fn failed(error: &anyhow::Error) -> CommandError {
    CommandError { exit: Exit::Capture, text: format!("{error:#}") }
}

/// Observer of a pass, with the rules.
struct Watch<'a> {
    engine: Option<Engine>,
    reader: &'a mut dyn CaptureReader,
}

impl Observer for Watch<'_> {
    fn event(&mut self, event: &Event, bus: &Bus) {
        match &mut self.engine {
            Some(engine) => Judge { engine, out: self.reader }.event(event, bus),
            None => self.reader.event(event, bus),
        }
    }

    fn needs(&self, preview: &Preview, bus: &Bus) -> bool {
        self.reader.needs(preview, bus)
            || self.engine.as_ref().is_some_and(|engine| engine.needs(preview, bus))
    }

    fn skip(&mut self, preview: &Preview, bus: &Bus) -> bool {
        !self.reader.needs(preview, bus)
            && self.engine.as_mut().is_none_or(|engine| engine.skip(preview, bus))
    }
}

impl CaptureObserver for Watch<'_> {
    fn is_done(&self) -> bool {
        self.reader.is_done()
    }

    /// Hides the progress line.
    fn is_on_terminal(&self) -> bool {
        true
    }

    fn wants_frames(&self) -> bool {
        self.engine.is_some() || self.reader.wants_frames()
    }

    fn frame(&mut self, frame: &Frame, names: &BusNames) -> bool {
        if self.reader.wants_frames() {
            self.reader.frame(frame, names.names().get(usize::from(frame.bus.0)).map_or("", String::as_str));
        }
        if let Some(engine) = &mut self.engine {
            engine.frame(frame);
        }
        true
    }

    fn frames(&mut self, frames: &[Frame], names: &BusNames) -> usize {
        match (&mut self.engine, frames.first()) {
            (Some(engine), Some(_)) if !self.reader.wants_frames() => engine.frames(frames),
            (None, _) => {
                for frame in frames {
                    self.frame(frame, names);
                }
                frames.len()
            }
            (_, first) => usize::from(first.is_some_and(|frame| self.frame(frame, names))),
        }
    }
}
