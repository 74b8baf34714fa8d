//! A capture with its options, which can be read several times.

use std::ffi::OsString;
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use cobscope_decoder::Reading;
use cobscope_decoder::answers::objects::ObjectRecord;
use cobscope_decoder::reading::{Borrowed, ReadingPart};
use cobscope_decoder::rules::RuleSetup;
use cobscope_decoder::session::SessionOptions;
use serde_json::Value;

use super::answer::{CommandError, EmbeddedAnswer, answered, check_arguments};
use crate::cmd::check::CheckArgs;
use crate::cmd::{check, diff};
use crate::exit_code::ExitStatus;
use crate::run::arguments::InputArgs;
use crate::run::capture_answers::PassResults;
use crate::run::capture_job::{CaptureJob, ReadCapture};
use crate::run::input::{capture_series, read_options};
use crate::run::messages::Refusal;
use crate::source::{self, CaptureSeries};

/// A capture and the options to decode it.
pub struct CaptureSource {
    series: CaptureSeries,
    input: InputArgs,
    options: SessionOptions,
    setup: Arc<RuleSetup>,
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
    pub fn open(arguments: &[OsString]) -> Result<EmbeddedAnswer<Self>, CommandError> {
        answered(|| {
            let source = Self::of(check_arguments(arguments)?)?;
            source.probe().map_err(|error| (ExitStatus::Capture, error))?;
            Ok(source)
        })
    }

    /// Options of live buses: those of `check` without a capture.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn live<P: ReadingPart>(
        arguments: &[OsString],
        part: P,
    ) -> Result<EmbeddedAnswer<Reading<P>>, CommandError> {
        answered(|| {
            let (options, setup) = check::ready(&check_arguments(arguments)?)?;
            Ok(Reading::of_options(options, Some(setup), part))
        })
    }

    fn of(arguments: CheckArgs) -> Result<Self, Refusal> {
        let (options, setup) = check::ready(&arguments)?;
        let series = one_capture(&arguments).map_err(|error| (ExitStatus::Usage, error))?;
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
        if self.series.first_path().is_file() || !self.series.first_path().exists() {
            source::open_capture(self.series.first_path(), &read_options(&self.input))?;
        }
        Ok(())
    }

    /// Reads the capture from its start. With `has_rules`, findings are among the events.
    ///
    /// # Errors
    /// If the capture cannot be opened, or contains no frames.
    pub fn read(&self, has_rules: bool, part: &mut dyn ReadingPart) -> Result<CaptureEnd, CommandError> {
        let setup = has_rules.then_some(&self.setup);
        let job = CaptureJob::new(&self.series, &self.input, &self.options, setup).quiet(true);
        let read = job.read(Borrowed(part)).map_err(|error| failed(&error))?;
        let failure = read.failure_text();
        let ReadCapture { mut warnings, unreadable, .. } = read;
        warnings.extend(unreadable);
        Ok(CaptureEnd { failure, messages: warnings })
    }

    /// Reads the capture for all results of its end.
    ///
    /// # Errors
    /// As for [`Self::read`].
    pub fn results(&self) -> Result<CaptureResults, CommandError> {
        let results = PassResults::of(&self.series, &self.input, &self.options, &self.setup)
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
fn one_capture(arguments: &CheckArgs) -> anyhow::Result<CaptureSeries> {
    let input = &arguments.input;
    if let [path] = input.captures.as_slice() {
        return diff::one(path, input);
    }
    let mut all = capture_series(input);
    ensure!(
        all.len() == 1,
        "the {} files are {} captures, expected the parts of one (join=True)",
        input.captures.len(),
        all.len()
    );
    all.pop().context("no capture")
}

fn failed(error: &anyhow::Error) -> CommandError {
    CommandError { exit: ExitStatus::Capture, text: format!("{error:#}") }
}
