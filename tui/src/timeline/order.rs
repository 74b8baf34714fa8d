//! Requests for the content at a position, and their results.

use std::sync::Arc;

use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::replay::{EventPosition, ReplayState};

use super::{ReplayRow, RowMatcher};

/// A position to go to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SeekTarget {
    /// An event.
    Event(EventPosition),
    /// After all events up to a time.
    Time(Timestamp),
    /// After the last event.
    End,
}

/// A request for a window.
#[derive(Debug, Clone)]
pub struct WindowRequest {
    /// Serial number, returned in the window.
    pub serial: u64,
    /// Requested position.
    pub target: SeekTarget,
    /// Maximum number of rows up to the position.
    pub before: usize,
    /// Maximum number of rows after it.
    pub after: usize,
    /// Selection of the rows.
    pub matcher: RowMatcher,
    /// Go to the next or previous match from there.
    pub search: Option<TextSearch>,
}

/// A text search from a position.
#[derive(Debug, Clone)]
pub struct TextSearch {
    /// Condition for the row, in addition to that of the order.
    pub matcher: RowMatcher,
    /// Search towards the start.
    pub is_backward: bool,
}

/// Rows and state at a position.
#[derive(Clone)]
pub struct RowWindow {
    /// Serial number of the order.
    pub serial: u64,
    /// Rows around the position, in order.
    pub rows: Vec<ReplayRow>,
    /// Index of the last row up to the position; 0 if all rows are after it.
    pub selected: usize,
    /// Position of the cursor.
    pub spot: EventPosition,
    /// State of the buses there.
    pub world: Arc<ReplayState>,
    /// Frames of the selected transfer, if they are few and close together.
    pub frames: Vec<Frame>,
    /// The position is not indexed yet; the window is a preview or the last indexed position.
    pub is_pending: bool,
    /// The search found no match.
    pub is_missed: bool,
}
