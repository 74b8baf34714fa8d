//! State of a segmented transfer: toggle bits and gaps.

use crate::wire::canopen::sdo::{SdoSegment, SdoSide};

/// Data bytes of a segment that is not the last one.
pub(super) const WHOLE: usize = 7;

/// Progress of a segmented transfer.
#[derive(Debug, Clone, Default)]
pub(super) struct SegmentProgress {
    /// Toggle bit of the next segment.
    pub(super) next: bool,
    /// Toggle bit of the last segment that the client sent or requested, until the server responds.
    pub(super) asked: Option<bool>,
    /// Content of the last segment.
    pub(super) last: Option<([u8; WHOLE], usize)>,
    /// Segments that were not captured; at least this many.
    pub(super) missing: u64,
    /// First skipped toggle bit: sender and frame.
    pub(super) skipped: Option<(SdoSide, u64)>,
    /// Response with another toggle bit than the last message of the client: bit and frame. It shows missing frames, unless
    /// the client goes on as if it had the right bit.
    pub(super) doubt: Option<(bool, u64)>,
    /// Gaps are violations of the protocol instead.
    pub(super) is_violated: bool,
    /// Number of gaps. Each may lack an even number of segments more than the toggle bits show.
    pub(super) gaps: u64,
}

impl SegmentProgress {
    /// Whether a segment repeats the last one: a retry after a response that the client did not receive.
    pub(super) fn is_repeated(&self, segment: &SdoSegment<'_>) -> bool {
        segment.toggle != self.next && self.last == Some(segment_content(segment))
    }
}

/// Data of a segment, padded, with its length.
pub(super) fn segment_content(segment: &SdoSegment<'_>) -> ([u8; WHOLE], usize) {
    let mut bytes = [0; WHOLE];
    bytes.iter_mut().zip(segment.data).for_each(|(target, source)| *target = *source);
    (bytes, segment.data.len())
}
