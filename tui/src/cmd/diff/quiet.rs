//! A comparison for the terminal UI: without messages, with the differences by what they concern.

use cobscope_decoder::comparison::{self, DifferenceMarks};
use cobscope_decoder::session::SessionOptions;

use super::record;
use crate::cli::{DiffArgs, DiffFormat, InputArgs};
use crate::source::Series;

/// Two captures to compare.
#[derive(Clone)]
pub(in crate::cmd) struct ComparisonJob {
    /// The first capture.
    pub(in crate::cmd) good: Series,
    /// The second capture, which is shown.
    pub(in crate::cmd) bad: Series,
    /// Options for reading, and the bus file with the tolerances.
    pub(in crate::cmd) input: InputArgs,
    /// Options of the decoder.
    pub(in crate::cmd) options: SessionOptions,
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
        let read = |series: &Series| {
            let (recorded, failure) = record(series, &arguments, &options, true)?;
            failure.map_or(Ok(recorded.record), Err)
        };
        let (good, bad) = (read(&good)?, read(&bad)?);
        let compared = comparison::compare(&good, &bad, &options.bus_file.diff);
        Ok(DifferenceMarks::new(&compared, &good, &bad))
    }
}
