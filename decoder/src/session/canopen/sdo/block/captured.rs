//! Segments of a block, and blocks of which the receiver acknowledges a part before the sender has sent all of it.

/// Data bytes per segment.
pub(super) const SEGMENT: usize = 7;

/// A segment as captured; length 0 if it was not.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct CapturedSegment {
    pub(super) bytes: [u8; SEGMENT],
    pub(super) length: u8,
}

impl CapturedSegment {
    pub(super) fn from_data(data: &[u8]) -> Self {
        let mut segment = Self::default();
        for (target, source) in segment.bytes.iter_mut().zip(data) {
            *target = *source;
            segment.length += 1;
        }
        segment
    }

    pub(super) fn is_seen(self) -> bool {
        self.length > 0
    }
}

/// A block of which the receiver acknowledged a part before the sender had sent all of it. The sender has three ways
/// to continue: with 1 (CiA 301 §7.2.4.3.9); with segments that it sent before it received the acknowledgement, and
/// then with 1; or with the number after the acknowledged one.
#[derive(Debug, Clone, Default)]
pub(super) struct PartialBlock {
    /// Last acknowledged segment, and last segment sent before the acknowledgement.
    pub(super) count: u8,
    pub(super) sent: u8,
    /// Segments that continue the numbers of the block, until number 1 or an acknowledgement decides.
    pub(super) held: Vec<(CapturedSegment, bool)>,
}

impl PartialBlock {
    pub(super) fn new(count: u8, sent: u8) -> Self {
        Self { count, sent: sent.max(count), held: Vec::new() }
    }

    /// Whether an acknowledgement covers more than the one before.
    pub(super) fn is_exceeded_by(&self, sequence: u8) -> bool {
        sequence > self.count
    }

    /// Whether the final segment is held.
    pub(super) fn has_last(&self) -> bool {
        self.held.iter().any(|(_, last)| *last)
    }

    /// Bytes held.
    pub(super) fn footprint(&self) -> usize {
        self.held.capacity() * size_of::<(CapturedSegment, bool)>()
    }
}
