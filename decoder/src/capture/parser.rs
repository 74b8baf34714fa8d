//! The [`FormatParser`] trait of format readers, and [`CaptureFormat`], their entry in the list of formats.

use super::batch::Batch;
use super::bus_names::BusNames;
use super::column_list::ColumnList;
use super::error::CaptureError;
use super::local_time::RecorderZones;

/// Default of [`FormatParser::largest_input`] in bytes: a parser must use input of this size. Longer lines and records
/// are skipped in pieces.
pub const LARGEST_RECORD: usize = 128 * 1024;

/// Meaning of ambiguous timestamps in candump text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TimeStyle {
    /// `-t a`, `-l`, `-L`, `-t A`, `-t z`: absolute times.
    Absolute,
    /// `-t d`: time since the frame before.
    Delta,
}

/// Unit of times in text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeUnit {
    /// Seconds.
    #[default]
    Second,
    /// Milliseconds.
    Millisecond,
    /// Microseconds.
    Microsecond,
    /// Nanoseconds.
    Nanosecond,
}

impl TimeUnit {
    /// Nanoseconds per unit.
    pub const fn nanoseconds(self) -> i64 {
        match self {
            Self::Second => 1_000_000_000,
            Self::Millisecond => 1_000_000,
            Self::Microsecond => 1_000,
            Self::Nanosecond => 1,
        }
    }
}

/// Options for data that a capture leaves ambiguous.
#[derive(Debug, Clone, Default)]
pub struct ReadOptions {
    /// Meaning of candump's relative times; `None` determines it from the first 1,000 lines.
    pub time_style: Option<TimeStyle>,
    /// Columns of text captures; `None` infers them if the format is unknown.
    pub columns: Option<ColumnList>,
    /// Unit of times in CSV and in layouts without a name; `None` uses that of the program, or infers it from the rate.
    pub time_unit: Option<TimeUnit>,
    /// Time zones of recorders that store local times; an unknown one is reported, and its times are read as UTC.
    pub time_zones: RecorderZones,
}

/// Parser of one format: bytes to frames. It owns no source, so it can be cloned.
pub trait FormatParser: Send + Sync {
    /// Parses frames from the start of `input` into `batch` until either is exhausted; returns the number of
    /// bytes used. `at_end` means that no data follows `input`.
    ///
    /// A call that uses and emits nothing requests more input. If `input` has [`FormatParser::largest_input`] bytes, or
    /// if `at_end` is set and `input` is not empty, the parser must use or emit something. A parser of
    /// containers uses a container only after it has emitted all of its content: until then it emits frames,
    /// uses nothing, and is called again with the same bytes.
    ///
    /// # Errors
    /// Only if no later byte can be read either.
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError>;

    /// Bytes of input that the parser may require at once before it uses any.
    fn largest_input(&self) -> usize {
        LARGEST_RECORD
    }

    /// Buses seen so far.
    fn buses(&self) -> &BusNames;

    /// Number of the last line used, from 1; `None` in a binary format.
    fn line_number(&self) -> Option<u64> {
        None
    }

    /// A copy at the same position. Copies are kept for all positions that may be resumed, so they are small:
    /// data that can be rebuilt from unused input is not copied.
    fn clone_box(&self) -> Box<dyn FormatParser>;
}

/// A format that can be read.
pub struct CaptureFormat {
    /// Short name, as used in options.
    pub name: &'static str,
    /// Name for display.
    pub title: &'static str,
    /// Whether the format is text with one line per frame: reading can start after any line end.
    pub is_text: bool,
    /// Whether frames are usually compressed inside of the capture.
    pub is_packed: bool,
    /// Whether the first bytes of a capture (up to 64 KiB) match the format.
    pub detect: fn(&[u8]) -> bool,
    /// Creates a parser at the start of a capture.
    pub parser: fn(&ReadOptions) -> Box<dyn FormatParser>,
}
