//! Options for event formats.

use crate::capture::CaptureCompression;

/// Options for all event formats; each format uses its own.
#[derive(Debug, Clone, Copy, Default)]
pub struct SinkOptions {
    /// Options for text.
    pub text: TextOptions,
    /// Compression of MCAP chunks.
    pub packing: CaptureCompression,
}

/// Content of the time column, as for candump's `-t`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeColumn {
    /// `z`: seconds since the first frame.
    #[default]
    Zero,
    /// `a`: seconds as in the capture.
    Absolute,
    /// `d`: seconds since the previous line.
    Delta,
    /// `A`: date and time, UTC.
    Date,
}

/// PDOs and J1939 messages to print.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PdoLines {
    /// The first message of an identifier and those with new information.
    #[default]
    Change,
    /// All of them.
    All,
    /// None of them.
    None,
}

/// Content of the text.
#[derive(Debug, Clone, Copy, Default)]
pub struct TextOptions {
    /// Content of the time column.
    pub time: TimeColumn,
    /// PDOs and J1939 messages to print.
    pub pdo: PdoLines,
    /// Also print repeated events: heartbeat, SYNC, guarding, LSS Fastscan.
    pub all: bool,
    /// Also print frames that belong to no known protocol.
    pub frames: bool,
    /// Print all fields of an event below its line.
    pub verbose: bool,
    /// Use ANSI colours.
    pub color: bool,
}
