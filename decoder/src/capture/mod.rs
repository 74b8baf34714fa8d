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
mod bus_names;
mod byte_order;
mod calendar;
mod compression;
mod elapsed;
mod error;
mod formats;
mod holds;
mod inflate;
mod link;
mod merged;
mod notice;
mod parser;
mod reader;
mod remark;
#[cfg(test)]
mod testing;
mod text;
mod writer;

pub use batch::{BATCH_FRAMES, Batch, Item};
pub use bus_names::MAX_BUS_NAME;
pub use bus_names::{BusNames, MAX_BUSES};
pub use compression::{decompress, is_compressed};
pub use error::CaptureError;
#[cfg(feature = "mcap")]
pub(crate) use formats::mcap::{McapWriter, Topic};
pub use formats::{FORMATS, WRITABLE, detect};
pub use holds::{Directions, ErrorFrames, Holds, Losses};
pub use link::kernel_frame;
pub use merged::{Merged, MergedCapture, MergedPosition};
pub use notice::{Notice, Place};
pub use parser::{Format, LARGEST_RECORD, Parser, ReadOptions, TimeStyle};
pub use reader::{Position, Reader};
pub use writer::{FrameWriter, Packing, WritableFormat, WriteOptions};
