//! Responses that are held until the next message of the client, and the state before them.

use super::segments::SegmentProgress;
use crate::frame::Frame;

/// Max responses of one channel that are held; more of them in sequence belong to none.
const HELD_RESPONSES: usize = 8;

/// Responses that contradict the open transfer, since the last frame of the client.
#[derive(Debug, Clone, Default)]
pub(super) struct UnrequestedResponses {
    pub(super) held: Vec<Frame>,
    /// All of them, held or not.
    pub(super) count: u64,
}

impl UnrequestedResponses {
    pub(super) fn hold_response(&mut self, frame: &Frame) {
        self.count = self.count.saturating_add(1);
        if self.held.len() < HELD_RESPONSES {
            self.held.push(*frame);
        }
    }

    /// Bytes held.
    pub(super) fn footprint(&self) -> usize {
        self.held.capacity() * size_of::<Frame>()
    }
}

/// State of a segmented transfer before responses that may have been sent without a request.
#[derive(Debug, Clone)]
pub(super) struct SegmentCheckpoint {
    pub(super) size: u64,
    pub(super) unseen: u64,
    pub(super) data: usize,
    pub(super) ranges: usize,
    pub(super) last_range: usize,
    pub(super) truncated: bool,
    pub(super) last_seen: bool,
    pub(super) segments: SegmentProgress,
}
