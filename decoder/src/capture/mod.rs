//! Captures: bytes to frames.
//!
//! ```text
//! bytes ─Reader (buffer, offset)─▶ Parser of one format ─▶ Batch of frames and notices
//! ```
//!
//! A [`FormatParser`] handles one format and does no I/O: it receives the available bytes and returns the number of
//! bytes it used. It is cloneable, so a position in a capture can be stored and resumed. [`CaptureReader`] owns the
//! source and the single reused buffer. Formats are detected by content, never by file name.
//!
//! A line or record that cannot be read becomes a [`Notice`], and reading continues after it. The same
//! applies to a record that is cut off by the end of the capture. The last line of a text capture needs no
//! line end.

pub mod adapter;
mod batch;
mod bus_error;
mod bus_names;
mod byte_order;
mod calendar;
mod column_list;
mod compression;
mod elapsed;
mod error;
mod foreign;
mod formats;
mod holds;
mod inflate;
mod link;
mod local_time;
mod merged;
mod notice;
mod parser;
mod reader;
mod remark;
#[cfg(feature = "rust-codecs")]
#[cfg_attr(
    any(feature = "zstd", feature = "mcap"),
    allow(dead_code, reason = "the codecs of these features take precedence")
)]
mod rust_codecs;
#[cfg(test)]
mod testing;
mod text;
mod writer;

pub use batch::{BATCH_FRAMES, Batch, BatchItem};
pub use bus_names::MAX_BUS_NAME;
pub use bus_names::{BusNames, MAX_BUSES};
pub use column_list::ColumnList;
pub use compression::{decompress, is_compressed};
pub use error::CaptureError;
pub use foreign::{ForeignFile, foreign_file};
#[cfg(feature = "mcap")]
pub(crate) use formats::mcap::{McapWriter, WrittenTopic};
pub use formats::{FORMATS, WRITABLE, detect_format};
pub use holds::{DirectionSupport, ErrorFrames, FormatCapabilities, LossCounter};
pub use link::kernel_frame;
pub use local_time::RecorderZones;
pub use merged::{MergedCapture, MergedPosition, MergedReader};
pub use notice::{CapturePlace, Notice};
pub use parser::{CaptureFormat, FormatParser, LARGEST_RECORD, ReadOptions, TimeStyle, TimeUnit};
pub use reader::{CaptureReader, ReaderPosition};
pub use writer::{CaptureCompression, FrameWriter, WritableFormat, WriteOptions};
