//! News from the background to the application.

use super::order::Window;

/// Something changed.
pub enum News {
    /// More of a capture that grows is known.
    Grew,
    /// The capture is read to its end.
    Indexed,
    /// The survey is complete.
    Surveyed,
    /// The search for the rows that are shown is complete.
    Filtered,
    /// More is known of signals over time.
    Traced,
    /// The answer to an order.
    Window(Box<Window>),
    /// An export ended: what was written, or why it was not.
    Exported(Result<String, String>),
    /// An order that cannot be answered, and why.
    Failed(String),
}
