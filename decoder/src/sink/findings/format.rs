//! Description of a findings format.

use std::io::{self, Write};

use super::report::FindingsReport;

/// A format for findings.
#[derive(Debug)]
pub struct FindingFormat {
    /// Short name for options.
    pub name: &'static str,
    /// Help text, one line.
    pub help: &'static str,
    /// Text that each report contains within 64 KiB of its start or its end.
    pub mark: &'static str,
    /// Whether findings refer to lines of the capture ([`super::CaptureResult::lines`]).
    pub has_lines: bool,
    /// Writes the report on all captures.
    pub write: fn(&FindingsReport, FindingTextOptions, &mut dyn Write) -> io::Result<()>,
}

/// Options for the text format.
#[derive(Debug, Clone, Copy, Default)]
pub struct FindingTextOptions {
    /// Use ANSI colours.
    pub color: bool,
    /// Print all recorded occurrences, and suppressed and accepted findings.
    pub verbose: bool,
    /// Print verdict counts per rule and per case of the conformance test plan.
    pub coverage: bool,
}

/// Writes text that is first built in memory.
pub(super) fn write_at_once(out: &mut dyn Write, make: impl FnOnce(&mut String)) -> io::Result<()> {
    let mut text = String::new();
    make(&mut text);
    out.write_all(text.as_bytes())
}
