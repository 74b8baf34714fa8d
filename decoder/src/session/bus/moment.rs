//! Moments on a bus.

/// Something that happened: what, when, in which frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct Moment<T> {
    pub(in crate::session) what: T,
    pub(in crate::session) frame: u64,
    /// Monotonic time in nanoseconds.
    pub(in crate::session) time: i64,
}
