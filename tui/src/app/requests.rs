//! Requests to the program: report pages, and comparisons with another capture.

use std::path::PathBuf;

use cobscope_decoder::session::SessionOptions;

/// A report page that the user requested.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReportRequest {
    /// Id of a finding of the story.
    pub finding: u64,
    /// File of the page; its suffix selects HTML or Markdown.
    pub path: PathBuf,
}

/// Starts writing a report page with the present options of the decoder. The result arrives as
/// [`TimelineNews::Exported`](crate::timeline::TimelineNews::Exported).
pub type WriteReport = Box<dyn FnMut(ReportRequest, &SessionOptions) -> anyhow::Result<()>>;

/// Starts the comparison with another capture, with these options of the decoder; an earlier one is abandoned. The
/// result arrives as [`TimelineNews::Compared`](crate::timeline::TimelineNews::Compared).
pub type Compare = Box<dyn FnMut(&SessionOptions) -> anyhow::Result<()>>;
