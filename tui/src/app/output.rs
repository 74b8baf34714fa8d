//! Orders to the terminal.

/// What the terminal is to do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Output {
    /// Leave.
    Quit,
    /// Put a text on the clipboard.
    Copy(String),
}
