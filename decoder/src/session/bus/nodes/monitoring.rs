//! NMT error control of a node: heartbeat and guarding.

use crate::session::bus::objects::ObjectStore;
use crate::wire::canopen::ObjectAddress;

/// Guarding requests without response after which a node is lost, if its life time factor (100D) is
/// unknown. Also the factor of its life time in intervals.
pub(in crate::session) const UNANSWERED: u8 = 3;

/// Time in ns within which a master configures a node after its boot-up, and intervals of its earlier heartbeats.
const RESTART_TIME: i64 = 5_000_000_000;
const RESTART_INTERVALS: i64 = 3;

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
    /// Monotonic time of the last heartbeat before it was reported as missing, while PDOs of the node continue.
    pub(in crate::session) missing_since: Option<i64>,
    /// Monotonic time and frame of a boot-up without an NMT reset, after heartbeats, until the next heartbeat.
    pub(in crate::session) rebooted: Option<(i64, u64)>,
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

    /// A new series of heartbeats starts, at a boot sign.
    pub(in crate::session) fn restart_series(&mut self) {
        self.last = None;
        self.intervals = [0; 4];
        self.deadline = None;
        self.rebooted = None;
    }

    /// Time in ns after a restart without an NMT reset within which the next heartbeat must follow; `None` if the node
    /// sent no heartbeats.
    pub(in crate::session) fn restart_limit(&self) -> Option<i64> {
        let usual = self.intervals.iter().copied().max().filter(|interval| *interval > 0);
        let interval = self.configured.or(usual).filter(|interval| *interval > 0)?;
        Some(interval.saturating_mul(RESTART_INTERVALS).max(RESTART_TIME))
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
    /// Monotonic time of the first request without response since the last response.
    pub(in crate::session) unanswered_since: Option<i64>,
    /// The loss of the node was reported since the last response.
    pub(in crate::session) is_reported: bool,
    /// At least one request was sent.
    pub(in crate::session) seen: bool,
}

impl GuardingState {
    /// The first response after a boot sign has toggle bit 0 again (CiA 301 §7.2.8.3.2.1).
    pub(in crate::session) fn restart_series(&mut self) {
        self.toggle = None;
        self.is_open = false;
        self.missed = 0;
        self.interval = 0;
        self.unanswered_since = None;
        self.is_reported = false;
    }

    /// Whether `limit` requests without response show at `now` that the node is lost: it sent no other frame for so long
    /// either, and its loss was not reported since the last response.
    pub(in crate::session) fn shows_loss(&self, limit: u8, last_received: i64, now: i64) -> bool {
        let since = self.unanswered_since.map_or(0, |since| now.saturating_sub(since));
        let time = since.saturating_mul(limit.into()) / i64::from(self.missed.max(1));
        let is_silent = now.saturating_sub(last_received) >= time;
        self.missed >= limit && self.last_reply.is_some() && !self.is_reported && is_silent
    }

    /// Whether the life time of guarding passed between the last response and `now`: the node may have restarted
    /// without a boot sign, so that its next response may have either toggle bit. If the life time
    /// (100C × 100D) is unknown, three usual intervals apply.
    pub(in crate::session) fn has_outlived(&self, store: &ObjectStore, now: i64) -> bool {
        let Some(last) = self.last_reply else { return false };
        let number = |index| store.number(ObjectAddress::new(index, 0)).filter(|number| *number > 0);
        let life_time = number(0x100C).zip(number(0x100D)).and_then(|(time, factor)| {
            i64::try_from(time.saturating_mul(factor).saturating_mul(1_000_000)).ok()
        });
        let usual = self.interval.saturating_mul(i64::from(UNANSWERED));
        let limit = life_time.or_else(|| Some(usual).filter(|usual| *usual > 0));
        limit.is_some_and(|limit| now.saturating_sub(last) > limit)
    }
}
