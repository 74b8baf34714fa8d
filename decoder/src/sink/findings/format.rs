//! A format of findings, as the registry lists it.

use std::io::{self, Write};

use super::report::Report;

/// One format of findings.
#[derive(Debug)]
pub struct FindingFormat {
    /// Short name, as options take it.
    pub name: &'static str,
    /// One line of help.
    pub help: &'static str,
    /// Findings are located by lines of the capture ([`super::Judged::lines`]).
    pub has_lines: bool,
    /// Writes all captures.
    pub write: fn(&Report, TextOptions, &mut dyn Write) -> io::Result<()>,
}

/// How much is told.
#[derive(Debug, Clone, Copy, Default)]
pub struct TextOptions {
    /// ANSI colours.
    pub color: bool,
    /// Every occurrence that was kept, what is suppressed and what is accepted.
    pub verbose: bool,
    /// How often each rule and each case of the test plan was judged.
    pub coverage: bool,
}

/// Writes a text that is complete in memory first.
pub(super) fn write_at_once(out: &mut dyn Write, make: impl FnOnce(&mut String)) -> io::Result<()> {
    let mut text = String::new();
    make(&mut text);
    out.write_all(text.as_bytes())
}
