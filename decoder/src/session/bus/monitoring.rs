//! NMT error control of a node: its heartbeat, its guarding.

/// Heartbeat of a node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Heartbeat {
    /// Monotonic time of the last one; `None` before the first and after a reset.
    pub(in crate::session) last: Option<i64>,
    /// The last intervals, newest first, zero = none.
    pub(in crate::session) intervals: [i64; 4],
    /// Monotonic deadline, `None` = not monitored.
    pub(in crate::session) deadline: Option<i64>,
    /// An entry is in the timer queue.
    pub(in crate::session) queued: bool,
    /// Producer time (object 0x1017) in nanoseconds as learnt; 0 = switched off.
    pub(in crate::session) configured: Option<i64>,
}

impl Heartbeat {
    /// The interval to expect: configured, else the longest of the last four once there are four.
    pub(in crate::session) fn expected(&self) -> Option<i64> {
        match self.configured {
            Some(0) => None,
            Some(time) => Some(time),
            None if self.intervals.contains(&0) => None,
            None => self.intervals.iter().copied().max(),
        }
    }
}

/// Guarding of a node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Guarding {
    /// A request waits for its reply.
    pub(in crate::session) is_open: bool,
    /// Requests without reply in a row.
    pub(in crate::session) missed: u8,
    /// Toggle bit of the last reply.
    pub(in crate::session) toggle: Option<bool>,
    /// Monotonic time of the last reply.
    pub(in crate::session) last_reply: Option<i64>,
    /// Any request was seen.
    pub(in crate::session) seen: bool,
}
