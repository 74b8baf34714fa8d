//! Messages on standard error.

use std::io::Write as _;

use cobscope_decoder::sink::escape;

use crate::exit_code::Exit;

/// An error with the exit status it brings.
pub(super) type Refusal = (Exit, anyhow::Error);

/// Tells the user what went wrong.
pub(super) fn complain(error: &anyhow::Error) {
    let _ = writeln!(std::io::stderr(), "cobscope: {error:#}");
}

/// Tells the user something that does not end the command.
pub(super) fn warn(text: &str) {
    let lines: Vec<_> = text.lines().map(escape).collect();
    let _ = writeln!(std::io::stderr(), "cobscope: {}", lines.join("\n"));
}

/// Tells the user something in one line.
pub(super) fn note(text: &str) {
    let _ = writeln!(std::io::stderr(), "cobscope: {}", escape(text));
}
