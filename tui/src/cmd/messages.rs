//! Messages on standard error.

use std::io::Write as _;

use cobscope_decoder::sink::escape;

/// Tells the user what went wrong.
pub(super) fn complain(error: &anyhow::Error) {
    let _ = writeln!(std::io::stderr(), "cobscope: {error:#}");
}

/// Tells the user something that does not end the command.
pub(super) fn warn(text: &str) {
    let lines: Vec<_> = text.lines().map(escape).collect();
    let _ = writeln!(std::io::stderr(), "cobscope: {}", lines.join("\n"));
}
