//! All inputs: files and standard input, decompressed, as frame readers.

mod ahead;
mod file;
pub mod live;
mod original;
mod positioned;
mod progress;
mod series;
mod series_frames;
mod store;

pub use file::open_capture;
pub use series::{
    CaptureFile, CaptureRelations, CaptureSeries, mixed_clocks, relate_files, siblings_note, time_span,
};
pub use series_frames::SeriesFrames;
pub use store::{DecompressedBytes, StoreReader, StoreWriter};
