//! Messages on stderr.

use std::io::Write as _;

use cobscope_decoder::sink::escape;

use crate::exit_code::Exit;

/// An error with its exit status.
pub(super) type Refusal = (Exit, anyhow::Error);

/// Reports an error, with its context.
pub(super) fn complain(error: &anyhow::Error) {
    warn(&format!("{error:#}"));
}

/// Reports a problem that does not end the command, in several lines.
pub(super) fn warn(text: &str) {
    let lines: Vec<_> = text.lines().map(escape).collect();
    let _ = writeln!(std::io::stderr(), "cobscope: {}", lines.join("\n"));
}

/// Reports information in one line.
pub(super) fn note(text: &str) {
    let _ = writeln!(std::io::stderr(), "cobscope: {}", escape(text));
}
