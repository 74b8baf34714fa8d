//! Work on an open capture that takes more than one step.

use cobscope_decoder::answers::signals::SignalCurve;
use cobscope_decoder::frame::Timestamp;

use crate::cut::CutJob;
use crate::export::ExportJob;
use crate::filter::{FilterJob, FilteredEvents};
use crate::plot::PlotJob;
use crate::report::{ReportJob, WrittenReport};
use crate::rows::FindingMarks;
use crate::search::{SearchJob, SearchResult};

/// Work in steps.
pub enum Job {
    /// Search for the events of a filter.
    Filter(Box<FilterJob>),
    /// Sampling of signals.
    Plot(Box<PlotJob>),
    /// Second reading for a report.
    Report(Box<ReportJob>),
    /// Writing of events.
    Export(Box<ExportJob>),
    /// Writing of frames.
    Cut(Box<CutJob>),
    /// Search for a row.
    Search(Box<SearchJob>),
}

/// Result of a job.
pub enum JobResult {
    /// Events of the filter.
    Filter(FilteredEvents),
    /// Samples of the signals.
    Plot(Vec<SignalCurve>),
    /// The report.
    Report(WrittenReport),
    /// All bytes are written.
    Export,
    /// The row, or what remains to be searched.
    Search(SearchResult),
}

impl Job {
    /// Name for the progress.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Filter(_) => "filter",
            Self::Plot(_) => "plot",
            Self::Report(_) => "report",
            Self::Export(_) | Self::Cut(_) => "export",
            Self::Search(_) => "search",
        }
    }

    /// Frames read so far.
    pub fn frames(&self) -> u64 {
        match self {
            Self::Filter(job) => job.frames(),
            Self::Plot(job) => job.frames(),
            Self::Report(job) => job.frames(),
            Self::Export(job) => job.frames(),
            Self::Cut(job) => job.frames(),
            Self::Search(job) => job.frames(),
        }
    }

    /// Reads up to about `frames` more frames; `false` at the end.
    ///
    /// # Errors
    /// If the capture can no longer be read.
    pub fn step(
        &mut self,
        frames: u64,
        marks: &FindingMarks,
        zero: Option<Timestamp>,
    ) -> Result<bool, String> {
        let step = match self {
            Self::Filter(job) => job.step(frames, marks, zero),
            Self::Plot(job) => job.step(frames),
            Self::Report(job) => return Ok(job.step(frames)),
            Self::Export(job) => return job.step(frames),
            Self::Cut(job) => return job.step(frames),
            Self::Search(job) => job.step(frames),
        };
        step.map_err(|error| error.to_string())
    }

    /// Bytes written since the last call.
    pub fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Export(job) => job.bytes(),
            Self::Cut(job) => job.bytes(),
            _ => Vec::new(),
        }
    }

    /// The samples so far; `None` for other jobs.
    pub fn curves(&self) -> Option<Vec<SignalCurve>> {
        match self {
            Self::Plot(job) => Some(job.curves()),
            _ => None,
        }
    }

    /// The result.
    ///
    /// # Errors
    /// If a report cannot be written.
    pub fn finish(self) -> Result<JobResult, String> {
        Ok(match self {
            Self::Filter(job) => JobResult::Filter(job.finish()),
            Self::Plot(job) => JobResult::Plot(job.curves()),
            Self::Report(job) => JobResult::Report(job.finish()?),
            Self::Export(_) | Self::Cut(_) => JobResult::Export,
            Self::Search(job) => JobResult::Search(job.finish()),
        })
    }
}
