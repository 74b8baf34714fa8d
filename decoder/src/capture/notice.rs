//! Messages of a reader other than frames, and positions in a capture.

use std::fmt;

use crate::frame::{BusIndex, LinkState, Timestamp};
use crate::words::count_noun;

/// Position in a capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CapturePlace {
    /// Line of a text capture, from 1.
    Line(u64),
    /// Byte offset of a binary capture, from 0, after decompression.
    Offset(u64),
    /// On a live bus, at the present time.
    Now,
}

impl fmt::Display for CapturePlace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Offset(offset) => write!(f, "byte {offset}"),
            Self::Now => f.write_str("live"),
        }
    }
}

/// Beginning of the reasons of unreadable frames that are valid CAN XL frames.
pub(super) const CAN_XL: &str = "CAN XL frame";

/// Message of a reader other than a frame. Texts may contain bytes of the capture: escape before printing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Notice {
    /// A line or record that should contain a frame but cannot be read.
    Unreadable {
        /// Position of the line or record.
        place: CapturePlace,
        /// The content found and the content expected.
        reason: String,
    },
    /// The capture ends inside a record: the recorder was switched off, or the file was not copied
    /// completely.
    CutOff {
        /// Start of the record.
        place: CapturePlace,
        /// The part of the record found.
        reason: String,
    },
    /// An assumption about the whole capture, emitted once ("times read as UTC").
    Assumption(String),
    /// The recorder reports lost frames.
    LostFrames {
        /// Position of the report.
        place: CapturePlace,
        /// Bus of the lost frames; the first bus if the recorder does not state it.
        bus: BusIndex,
        /// Number of lost frames; `None` if the recorder does not state it.
        count: Option<u64>,
    },
    /// The connection to a bus opened or closed; frames while it was closed are missing.
    Link {
        /// Bus of the link.
        bus: BusIndex,
        /// Time of the change, on the clock of the bus's frames.
        time: Timestamp,
        /// State after the change.
        state: LinkState,
        /// Bit rate of the bus in bit/s; `None` if the recorder does not know it.
        bit_rate: Option<u32>,
    },
    /// The recorder received nothing up to this time.
    Quiet(Timestamp),
    /// The clock that sets the times of the frames was set forward.
    ClockSet {
        /// Bus whose frames use the clock.
        bus: BusIndex,
        /// Time after the step.
        time: Timestamp,
        /// Size of the step, in ns.
        step: i64,
    },
}

impl Notice {
    /// Whether the capture contains a valid frame here of a type that is not supported.
    pub fn is_unsupported_frame(&self) -> bool {
        matches!(self, Self::Unreadable { reason, .. } if reason.starts_with(CAN_XL))
    }

    /// Bus that the notice refers to; the first bus if it refers to none.
    pub fn bus(&self) -> BusIndex {
        match self {
            Self::LostFrames { bus, .. } | Self::Link { bus, .. } | Self::ClockSet { bus, .. } => *bus,
            Self::Unreadable { .. } | Self::CutOff { .. } | Self::Assumption(_) | Self::Quiet(_) => {
                BusIndex(0)
            }
        }
    }
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unreadable { place, reason } | Self::CutOff { place, reason } => {
                write!(f, "{place}: {reason}")
            }
            Self::Assumption(text) => f.write_str(text),
            Self::LostFrames { place, count: Some(count), .. } => {
                write!(f, "{place}: {} lost", count_noun(*count, "frame"))
            }
            Self::LostFrames { place, count: None, .. } => write!(f, "{place}: frames lost"),
            Self::Link { time, state, .. } => write!(f, "{time}: link {}", state.name()),
            Self::Quiet(time) => write!(f, "no frame received until {time}"),
            Self::ClockSet { time, step, .. } => {
                write!(f, "{time}: clock set forward by {} ms", step / 1_000_000)
            }
        }
    }
}
