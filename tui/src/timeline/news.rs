//! Messages of the background threads to the application.

use cobscope_decoder::comparison::DifferenceMarks;

use super::order::RowWindow;

/// A message about a change.
pub enum TimelineNews {
    /// A growing capture has more frames.
    Grew,
    /// The capture is read to its end.
    Indexed,
    /// The survey is complete.
    Surveyed,
    /// The search for the shown events is complete.
    Filtered,
    /// Signals have more samples.
    Traced,
    /// A requested window.
    Window(Box<RowWindow>),
    /// The file of a capture changed while open; the text states what was found.
    Changed(String),
    /// Result of an export: summary or error.
    Exported(Result<String, String>),
    /// Result of the comparison with another capture.
    Compared(Result<Box<DifferenceMarks>, String>),
    /// A request failed; the text is the reason.
    Failed(String),
}
