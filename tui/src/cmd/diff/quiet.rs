//! A comparison without messages: for the terminal UI, with the differences by what they concern, and for other programs.

use std::sync::Arc;

use cobscope_decoder::answers::comparison::ComparisonAnswer;
use cobscope_decoder::comparison::{self, CaptureRecord, DifferenceMarks};
use cobscope_decoder::session::SessionOptions;

use super::arguments::{DiffArgs, DiffFormat};
use super::{ensure_start, record};
use crate::run::arguments::InputArgs;
use crate::run::input::build_setup;
use crate::source::CaptureSeries;

/// Two captures to compare.
#[derive(Clone)]
pub(in crate::cmd) struct ComparisonJob {
    /// The first capture.
    pub(in crate::cmd) good: CaptureSeries,
    /// The second capture, which is shown.
    pub(in crate::cmd) bad: CaptureSeries,
    /// Options for reading, and the bus file with the tolerances.
    pub(in crate::cmd) input: InputArgs,
    /// Options of the decoder.
    pub(in crate::cmd) options: SessionOptions,
}

/// The comparison.
///
/// # Errors
/// If a capture cannot be read to its end, or a sequence has no event to start from.
pub(in crate::cmd) fn compared(
    [good, bad]: [&CaptureSeries; 2],
    arguments: &DiffArgs,
    options: &SessionOptions,
) -> anyhow::Result<ComparisonAnswer> {
    ensure_start(arguments)?;
    let [good, bad] = records([good, bad], arguments, options)?;
    let mut compared = comparison::compare_captures(&good, &bad, &options.bus_file.diff);
    if !arguments.only.is_empty() {
        compared.keep_sections(&arguments.only);
    }
    Ok(ComparisonAnswer::new(&compared, (&good, &bad), &options.bus_file.diff))
}

/// # Errors
/// If a capture cannot be read to its end, or the rules of the bus file are not valid.
fn records(
    [good, bad]: [&CaptureSeries; 2],
    arguments: &DiffArgs,
    options: &SessionOptions,
) -> anyhow::Result<[CaptureRecord; 2]> {
    let setup = Arc::new(build_setup(&arguments.input, &options.catalogue, None)?);
    let read = |series: &CaptureSeries| {
        let (recorded, failure) = record(series, arguments, (options, &setup), true)?;
        failure.map_or(Ok(recorded.record), Err)
    };
    Ok([read(good)?, read(bad)?])
}

impl ComparisonJob {
    /// Reads both captures and compares them.
    ///
    /// # Errors
    /// If a capture cannot be read to its end.
    pub(in crate::cmd) fn run(self) -> anyhow::Result<DifferenceMarks> {
        let Self { good, bad, input, options } = self;
        let arguments = DiffArgs {
            input,
            only: Vec::new(),
            at_event: None,
            from: None,
            to: None,
            verbose: false,
            format: DiffFormat::Text,
            output: None,
        };
        let [good, bad] = records([&good, &bad], &arguments, &options)?;
        let compared = comparison::compare_captures(&good, &bad, &options.bus_file.diff);
        Ok(DifferenceMarks::new(&compared, &good, &bad))
    }
}
