//! Captures around triggers, cut from a ring of the recent past.
//!
//! ```text
//!                    ┌─ evicted ─▶ state at the start of the ring ─▶ bus file of a capture
//! items ──▶ ring ────┤
//!            ▲       └─ trigger ─▶ capture: before … first frame … trigger … after
//!            └─ triggers precede the item that shows them
//! ```
//! A capture is written while its window is open. It stays open for later triggers as long as their windows can
//! overlap with it.

mod clock;
mod cut;
mod files;
mod name;
mod ring;
mod ring_files;
mod state;
mod writer;

use std::path::PathBuf;
use std::time::Duration;

use cobscope_decoder::frame::Timestamp;

use super::trigger::CaptureTrigger;
pub(super) use state::StateFollower;
pub use state::StateText;
pub(super) use writer::CutWriter;

/// Time for which the ring keeps items in addition to `before`: the first frame of a finding can be this much
/// earlier than the finding.
const SLACK: Duration = Duration::from_mins(1);

/// Captures and their limits.
#[derive(Debug, Clone)]
pub struct CutOptions {
    /// Folder of the captures.
    pub folder: PathBuf,
    /// Time before the first frame of a trigger.
    pub before: Duration,
    /// Time after a trigger.
    pub after: Duration,
    /// Maximum memory of the ring in bytes.
    pub ring_bytes: u64,
    /// Maximum size of the files of the ring in bytes; None for a ring in memory only.
    pub ring_files: Option<u64>,
    /// Maximum number of captures.
    pub files: u32,
    /// Maximum size of all captures in bytes; exceeded by at most one batch.
    pub bytes: u64,
}

/// Progress of the captures.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CutNews {
    /// A trigger is in a capture.
    Triggered {
        /// The trigger.
        trigger: CaptureTrigger,
        /// The capture.
        path: PathBuf,
        /// Time missing at the start of its window, in ns; 0 for none.
        late: i64,
    },
    /// A trigger is in no capture.
    Refused {
        /// The trigger.
        trigger: CaptureTrigger,
        /// Why not.
        reason: RefusalReason,
    },
    /// A capture is complete.
    Complete(CompleteCut),
}

/// Why a trigger has no capture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RefusalReason {
    /// The maximum number of captures exists.
    Files,
    /// The captures have their maximum size.
    Bytes,
}

/// Why a capture ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CutEnd {
    /// The window is over.
    Window,
    /// The captures have their maximum size.
    Bytes,
    /// Recording was stopped within the window.
    Stopped,
}

/// A complete capture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CompleteCut {
    /// Its files: more than one after a failure to write.
    pub paths: Vec<PathBuf>,
    /// The bus file with the state before its first frame, if it could be written.
    pub bus_file: Option<PathBuf>,
    /// Number of frames.
    pub frames: u64,
    /// Number of frames that could not be written.
    pub missing: u64,
    /// Size in bytes.
    pub bytes: u64,
    /// Number of triggers.
    pub triggers: u64,
    /// Timestamp of the last frame.
    pub last_time: Option<Timestamp>,
    /// Time from the first to the last frame in ns.
    pub duration: i64,
    /// Why it ends.
    pub end: CutEnd,
}
