//! All inputs: files and standard input, decompressed, as frame readers.

mod ahead;
mod arrange;
mod file;
pub mod live;
mod names;
mod original;
mod positioned;
mod progress;
mod scan;
mod series;
mod series_frames;
mod store;

pub use arrange::{CapturePlacement, arrange};
pub use file::open;
pub use scan::time_span;
pub use series::{CaptureFile, JoinOptions, Relations, Series, relate};
pub use series_frames::SeriesFrames;
pub use store::{Store, StoreReader, StoreWriter};
