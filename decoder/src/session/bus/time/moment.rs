//! Time and frame of an occurrence on a bus.

/// An occurrence with its frame and time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct FrameMoment<T> {
    pub(in crate::session) what: T,
    pub(in crate::session) frame: u64,
    /// Monotonic time in ns.
    pub(in crate::session) time: i64,
}
