//! Exit status of the program.

use std::process::ExitCode;

/// Exit statuses by severity; with several captures the most severe one is returned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ExitStatus {
    /// Success, also if the reader closed the output pipe.
    Clean = 0,
    /// Findings at or above `--fail-on`, or captures that differ.
    Findings = 1,
    /// Invalid command line, or an output cannot be created.
    Usage = 2,
    /// A capture is unreadable, incomplete or without frames, or an output is incomplete; or `check` has no frame of a
    /// node of `--only-node`.
    Capture = 3,
    /// A profile or bus file is invalid.
    Profile = 4,
}

impl From<ExitStatus> for ExitCode {
    fn from(exit: ExitStatus) -> Self {
        Self::from(exit as u8)
    }
}
