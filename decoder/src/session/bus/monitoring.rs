//! NMT error control of a node: heartbeat and guarding.

/// Guarding requests without response after which a node is lost, if its life time factor (100D) is
/// unknown. Also the factor of its life time in intervals.
pub(in crate::session) const UNANSWERED: u8 = 3;

/// Heartbeat state of a node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct HeartbeatState {
    /// Monotonic time of the last heartbeat; `None` before the first one and after a reset.
    pub(in crate::session) last: Option<i64>,
    /// Last intervals in ns, newest first; 0 for none.
    pub(in crate::session) intervals: [i64; 4],
    /// Monotonic deadline; `None` if not monitored.
    pub(in crate::session) deadline: Option<i64>,
    /// The deadline is in the timer queue.
    pub(in crate::session) queued: bool,
    /// Producer time (object 0x1017) in ns; 0 = heartbeat disabled, `None` = unknown.
    pub(in crate::session) configured: Option<i64>,
}

impl HeartbeatState {
    /// Expected interval in ns: the configured one, otherwise the longest of the last four.
    pub(in crate::session) fn expected_interval(&self) -> Option<i64> {
        match self.configured {
            Some(0) => None,
            Some(time) => Some(time),
            None if self.intervals.contains(&0) => None,
            None => self.intervals.iter().copied().max(),
        }
    }
}

/// Guarding state of a node.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct GuardingState {
    /// A request waits for its response.
    pub(in crate::session) is_open: bool,
    /// Consecutive requests without response.
    pub(in crate::session) missed: u8,
    /// Toggle bit of the last response.
    pub(in crate::session) toggle: Option<bool>,
    /// Monotonic time of the last response.
    pub(in crate::session) last_reply: Option<i64>,
    /// Time between the last two responses in ns; 0 if unknown.
    pub(in crate::session) interval: i64,
    /// At least one request was sent.
    pub(in crate::session) seen: bool,
}
