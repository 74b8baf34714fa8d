//! How events are written, where their format leaves that open.

use crate::capture::Packing;

/// Options of all formats of events; each takes its own.
#[derive(Debug, Clone, Copy, Default)]
pub struct SinkOptions {
    /// Text.
    pub text: TextOptions,
    /// How chunks of MCAP are packed.
    pub packing: Packing,
}

/// What the time column shows, as candump's `-t`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeColumn {
    /// `z`: seconds since the first frame.
    #[default]
    Zero,
    /// `a`: seconds as recorded.
    Absolute,
    /// `d`: seconds since the line before.
    Delta,
    /// `A`: date and time, UTC.
    Date,
}

/// Which PDOs and J1939 messages are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PdoLines {
    /// The first of an identifier, and those that say something new.
    #[default]
    Change,
    /// All.
    All,
    /// None.
    None,
}

/// What the text shows.
#[derive(Debug, Clone, Copy, Default)]
pub struct TextOptions {
    /// Time column.
    pub time: TimeColumn,
    /// PDOs.
    pub pdo: PdoLines,
    /// Repetitions of everything else: heartbeats, SYNC, guarding, scan steps.
    pub all: bool,
    /// Frames no protocol owns.
    pub frames: bool,
    /// Everything known of an event, on further lines.
    pub verbose: bool,
    /// ANSI colours.
    pub color: bool,
}
