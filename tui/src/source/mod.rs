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

pub use file::open;
pub use series::{CaptureFile, Relations, Series, mixed_clocks, relate, time_span};
pub use series_frames::SeriesFrames;
pub use store::{Store, StoreReader, StoreWriter};
