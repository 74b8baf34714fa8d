//! Gaps in the guarding of a node.

use super::monitoring::UNANSWERED;
use super::node::Node;
use crate::wire::canopen::ObjectAddress;

impl Node {
    /// Resets the monitoring state at a boot sign: the first response has toggle bit 0 again (CiA 301
    /// §7.2.8.3.2.1), and a series of heartbeats starts.
    pub(in crate::session) fn restart_monitoring(&mut self) {
        self.guarding.toggle = None;
        self.guarding.is_open = false;
        self.guarding.missed = 0;
        self.guarding.interval = 0;
        self.heartbeat.last = None;
        self.heartbeat.intervals = [0; 4];
        self.heartbeat.deadline = None;
    }

    /// Whether the life time of guarding passed between the last response and `now`: the node may have restarted
    /// without a boot sign, so that its next response may have either toggle bit. If the life time
    /// (100C × 100D) is unknown, three usual intervals apply.
    pub(in crate::session) fn has_outlived_guarding(&self, now: i64) -> bool {
        let Some(last) = self.guarding.last_reply else { return false };
        let number = |index| self.store.number(ObjectAddress::new(index, 0)).filter(|number| *number > 0);
        let life_time = number(0x100C).zip(number(0x100D)).and_then(|(time, factor)| {
            i64::try_from(time.saturating_mul(factor).saturating_mul(1_000_000)).ok()
        });
        let usual = self.guarding.interval.saturating_mul(i64::from(UNANSWERED));
        let limit = life_time.or_else(|| Some(usual).filter(|usual| *usual > 0));
        limit.is_some_and(|limit| now.saturating_sub(last) > limit)
    }
}
