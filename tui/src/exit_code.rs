//! What the program's exit status says.

use std::process::ExitCode;

/// Exit statuses, worst last: the worst of several captures counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Exit {
    /// All went well; a closed pipe counts as well.
    Clean = 0,
    /// There are findings at or above `--fail-on`.
    Findings = 1,
    /// The command line cannot be understood, or an output cannot be created.
    Usage = 2,
    /// A capture cannot be opened, recognised or read to its end, or holds no frame; an output cannot be written to its end.
    Capture = 3,
    /// A profile or bus file that is named or used is broken.
    Profile = 4,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}
