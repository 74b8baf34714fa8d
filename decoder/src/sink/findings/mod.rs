//! What was judged of captures, one format a file.

pub mod text;

use crate::finding::Findings;
use crate::frame::Timestamp;

/// What was judged of one capture.
#[derive(Debug, Clone, Default)]
pub struct Judged {
    /// Name of the capture.
    pub capture: String,
    /// Frames read.
    pub frames: u64,
    /// Stamp of the first frame: the zero of times.
    pub first: Option<Timestamp>,
    /// Stamp of the last frame.
    pub last: Option<Timestamp>,
    /// Everything judged.
    pub findings: Findings,
    /// Why reading ended early, if it did.
    pub failure: Option<String>,
}
