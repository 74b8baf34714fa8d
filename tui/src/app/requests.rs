//! Requests to the program: report pages, comparisons with another capture, and the terminal.

use std::path::{Path, PathBuf};

use cobscope_decoder::session::SessionOptions;

use crate::state::UiState;

/// Suffixes of the page, which select its format.
const SUFFIXES: [&str; 2] = ["html", "md"];

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

/// A request to the terminal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TerminalRequest {
    /// End the program.
    Quit,
    /// Copy a text to the clipboard.
    Copy(String),
}

/// Writing of report pages.
pub(super) struct ReportOrders {
    /// Starts writing a page.
    pub(super) write: WriteReport,
    /// Finding that the open prompt reports on.
    pub(super) finding: Option<u64>,
}

impl ReportOrders {
    pub(super) fn new(write: WriteReport) -> Self {
        Self { write, finding: None }
    }

    /// Starts writing the page.
    pub(super) fn write_page(&mut self, core: &mut UiState, path: &str) {
        let Some(finding) = self.finding.take() else { return };
        let request = ReportRequest { finding, path: path.into() };
        match (self.write)(request, core.timeline.options()) {
            Ok(()) => core.begin_export(),
            Err(error) => core.show_refusal(&format!("{error:#}")),
        }
    }
}

/// Whether the suffix of a file selects the format of a page.
pub(super) fn has_format(path: &Path) -> bool {
    path.extension().is_some_and(|suffix| SUFFIXES.iter().any(|known| suffix.eq_ignore_ascii_case(known)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_suffix_selects_the_format_of_the_page() {
        for (name, expected) in
            [("case.html", true), ("a b/case.MD", true), ("case", false), ("case.pdf", false), ("", false)]
        {
            assert_eq!(has_format(name.as_ref()), expected, "{name}");
        }
    }
}
