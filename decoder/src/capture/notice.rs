//! What a reader has to say besides frames, and where in a capture it stands.

use std::fmt;

use crate::frame::{BusIndex, LinkState, Timestamp};
use crate::words::plural;

/// Where in a capture something stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// Line of a text capture, from 1.
    Line(u64),
    /// Byte offset of a binary capture, from 0, after decompression.
    Offset(u64),
    /// On a live bus, as it happens.
    Now,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Offset(offset) => write!(f, "byte {offset}"),
            Self::Now => f.write_str("live"),
        }
    }
}

/// What a reader has to say besides frames. Texts may hold bytes of the capture: escape before printing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Notice {
    /// A line or record that is no frame although it should be one.
    Unreadable {
        /// Where it stands.
        place: Place,
        /// What was found and what was expected.
        reason: String,
    },
    /// The capture ends inside a record: the recorder was switched off, or the file was not copied whole.
    CutOff {
        /// Where the record begins.
        place: Place,
        /// What was found of it.
        reason: String,
    },
    /// Something assumed of the whole capture, said once ("times read as UTC").
    Assumption(String),
    /// The recorder itself says that frames were lost here.
    LostFrames {
        /// Where it says so.
        place: Place,
        /// The bus they were on; the first one where it does not say.
        bus: BusIndex,
        /// How many, if it says.
        count: Option<u64>,
    },
    /// The way to a bus opened or closed: frames in between were not seen.
    Link {
        /// The bus.
        bus: BusIndex,
        /// When, on the clock of its frames.
        time: Timestamp,
        /// How it is from here on.
        state: LinkState,
        /// Bit rate of the bus in bit/s, where the recorder knows it.
        bit_rate: Option<u32>,
    },
    /// The recorder listened up to this time, and nothing came.
    Quiet(Timestamp),
}

impl Notice {
    /// The bus it is about; the first one where it is about none.
    pub fn bus(&self) -> BusIndex {
        match self {
            Self::LostFrames { bus, .. } | Self::Link { bus, .. } => *bus,
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
                write!(f, "{place}: {} lost", plural(*count, "frame"))
            }
            Self::LostFrames { place, count: None, .. } => write!(f, "{place}: frames lost"),
            Self::Link { time, state, .. } => write!(f, "{time}: link {}", state.name()),
            Self::Quiet(time) => write!(f, "nothing until {time}"),
        }
    }
}
