//! A capture to add, its results, and the files that the program creates.

use std::io;

use jiff::civil::Date;

use crate::diagnosis::Diagnosis;
use crate::finding::Severity;
use crate::session::Buses;
use crate::sink::Output;
use crate::sink::findings::CaptureResult;
use crate::statistics::CaptureQuality;

/// Creates the files of one capture; implemented by the program.
pub trait LakeFiles {
    /// File `number`, from 1, of a table and day (`2024-01-31` or `unknown`).
    ///
    /// # Errors
    /// If the file cannot be created.
    fn create_file(&mut self, table: &'static str, day: &str, number: usize) -> io::Result<Output>;

    /// File `number`, from 1, of a message and day in the wide layout.
    ///
    /// # Errors
    /// If the file cannot be created.
    fn create_wide(&mut self, message: &str, day: &str, number: usize) -> io::Result<Output>;
}

/// A capture to add.
#[derive(Debug, Clone, Default)]
pub struct LakeCapture {
    /// Name, as in all output.
    pub name: String,
    /// SHA-256 over the content of all its files, in hexadecimal.
    pub hash: String,
    /// Size of all its files, in bytes.
    pub size: u64,
    /// Number of its files.
    pub parts: usize,
    /// Day of the rows if the capture contains no date.
    pub day: Option<Date>,
    /// Whether its frames are added, too.
    pub has_frames: bool,
    /// Whether the events include repetitions and those whose values are in `signals`.
    pub has_all_events: bool,
    /// Whether values are also written side by side, one table per message.
    pub has_wide: bool,
}

/// Results of a capture after its last frame.
#[derive(Debug, Clone, Copy)]
pub struct LakeResults<'a> {
    /// Findings.
    pub judged: &'a CaptureResult,
    /// Stories of the findings.
    pub diagnosis: &'a Diagnosis,
    /// Quality of the capture.
    pub quality: &'a CaptureQuality,
    /// State after the last frame.
    pub buses: Buses<'a>,
    /// Name of the format; `None` if it is unknown.
    pub format: Option<&'static str>,
    /// Lowest severity that counts as a failure.
    pub least: Option<Severity>,
}
