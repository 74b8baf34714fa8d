//! Range of frames of an event.

/// First and last frame of an event, numbered from 1 within a capture; 0 for none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameRange {
    /// First frame.
    pub first: u64,
    /// Last frame.
    pub last: u64,
}

impl FrameRange {
    /// Range of a single frame.
    pub const fn one(number: u64) -> Self {
        Self { first: number, last: number }
    }
}
