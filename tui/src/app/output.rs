//! Requests to the terminal.

/// A request to the terminal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TerminalRequest {
    /// End the program.
    Quit,
    /// Copy a text to the clipboard.
    Copy(String),
}
