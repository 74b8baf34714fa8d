//! Captures: bytes to frames.
//!
//! ```text
//! bytes ─Reader (buffer, offset)─▶ Parser of one format ─▶ Batch of frames and notices
//! ```
//!
//! A [`Parser`] knows one format and nothing of files: it is given the bytes at hand and says how many
//! it took. It is cloneable, so a place in a capture can be kept and returned to. [`Reader`] owns the
//! source and the one reused buffer. Formats are found by content, never by suffix.
//!
//! A line or record that cannot be read becomes a [`Notice`]; reading goes on behind it. So does a record inside of which
//! the capture ends; of text the last line is one like any other, without its end too.

pub mod adapter;
mod batch;
mod bus_error;
mod byte_order;
mod calendar;
mod compression;
mod elapsed;
mod formats;
mod holds;
mod inflate;
mod link;
mod merged;
mod reader;
mod remark;
#[cfg(test)]
mod testing;
mod text;
mod writer;

use std::fmt;
use std::io::ErrorKind;

use crate::frame::{BusIndex, LinkState, Timestamp};
use crate::words::plural;

pub use batch::{BATCH_FRAMES, Batch, Item};
pub use compression::{decompress, is_compressed};
#[cfg(feature = "mcap")]
pub use formats::mcap::{McapWriter, Topic};
pub use formats::{FORMATS, WRITABLE, candump::TimeStyle, detect};
pub use holds::{Directions, ErrorFrames, Holds, Losses};
pub use link::kernel_frame;
pub use merged::{Merged, MergedCapture, MergedPosition};
pub use reader::{Position, Reader};
pub use writer::{FrameWriter, Packing, WritableFormat, WriteOptions};

/// Input a parser may be asked to look at before it must take some, unless it says otherwise
/// ([`Parser::largest`]): longer lines and records are skipped by it piece by piece.
pub const LARGEST_RECORD: usize = 128 * 1024;

/// How many buses one capture may name; frames of further ones are unreadable.
pub const MAX_BUSES: usize = 64;

/// Bytes of a bus name that are kept.
pub const MAX_BUS_NAME: usize = 32;

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

/// What became of the source.
fn how(error: &std::io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::UnexpectedEof => "the file is cut off",
        _ => "reading failed",
    }
}

/// What failed stands in the text, so it is no source: those who print sources too would say it twice.
impl From<std::io::Error> for CaptureError {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

/// Why a capture cannot be read at all, or no further.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The source failed, or breaks off inside of what it is compressed with.
    #[error("{how}: {0}", how = how(.0))]
    Io(std::io::Error),
    /// No format's reader knows these bytes.
    #[error("not a capture in a known format ({known}); it begins with {found}")]
    Unrecognised {
        /// Titles of the formats that were tried.
        known: String,
        /// The first bytes, printable.
        found: String,
    },
    /// The format is known but its header cannot be used.
    #[error("{format}: byte {offset}: found {found}, expected {expected}")]
    Header {
        /// Title of the format.
        format: &'static str,
        /// Byte offset in the decompressed capture.
        offset: u64,
        /// What stands there.
        found: String,
        /// What should stand there.
        expected: &'static str,
    },
    /// No bytes at all.
    #[error("the capture is empty")]
    Empty,
}

/// How to read what a capture leaves open.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReadOptions {
    /// What candump's relative times mean; `None` finds out from the first 1,000 lines.
    pub time_style: Option<TimeStyle>,
}

/// Names of the buses of one capture, in order of appearance.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BusNames(Vec<String>);

impl BusNames {
    /// Names in order of their index.
    pub fn names(&self) -> &[String] {
        &self.0
    }

    /// Index of `name`, added if new; `None` when [`MAX_BUSES`] are known.
    /// Names longer than [`MAX_BUS_NAME`] bytes are cut; bytes that are no UTF-8 are replaced.
    pub fn index_of(&mut self, name: &[u8]) -> Option<BusIndex> {
        let name = String::from_utf8_lossy(name.get(..MAX_BUS_NAME).unwrap_or(name));
        let index = match self.0.iter().position(|known| *known == name) {
            Some(index) => index,
            None if self.0.len() < MAX_BUSES => {
                self.0.push(name.into_owned());
                self.0.len() - 1
            }
            None => return None,
        };
        u8::try_from(index).ok().map(BusIndex)
    }
}

/// Reader of one format: takes bytes, gives frames. Holds no source, so that it can be cloned.
pub trait Parser: Send + Sync {
    /// Takes frames from the front of `input` into `batch` until either runs out; returns how many
    /// bytes it took. `at_end` says that nothing follows `input`.
    ///
    /// Taking nothing and giving nothing asks for more input; given [`Parser::largest`] bytes, or `at_end`
    /// with any, it takes or gives some. A parser of containers takes one only when all that is in it has
    /// been given: meanwhile it gives frames and takes nothing, and is called again with the same bytes.
    ///
    /// # Errors
    /// Only where no later byte can be read either.
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError>;

    /// Bytes it may need to see at once before it takes some.
    fn largest(&self) -> usize {
        LARGEST_RECORD
    }

    /// Buses seen so far.
    fn buses(&self) -> &BusNames;

    /// Line that was taken last, from 1; none in a binary format.
    fn line(&self) -> Option<u64> {
        None
    }

    /// A copy at the same place. It is kept for every place that is returned to, so it is small: what can
    /// be made again of the bytes not taken yet is not in it.
    fn clone_box(&self) -> Box<dyn Parser>;
}

/// One readable format.
pub struct Format {
    /// Short name, as options take it.
    pub name: &'static str,
    /// What people call it.
    pub title: &'static str,
    /// A line a frame: it can be entered behind the end of any line.
    pub is_text: bool,
    /// Whether the first bytes of a capture (up to 64 KiB) look like it.
    pub detect: fn(&[u8]) -> bool,
    /// A parser at the start of a capture.
    pub parser: fn(&ReadOptions) -> Box<dyn Parser>,
}
