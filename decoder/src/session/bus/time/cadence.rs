//! Intervals of messages for which the manual of the receiver gives a max time.

use std::sync::Arc;

use crate::event::{EventKind, MessageGap};
use crate::wire::NodeId;
use crate::wire::j1939::J1939Id;

/// Number of intervals used for the usual interval.
const INTERVALS: usize = 8;

/// State of one monitored message.
#[derive(Debug, Clone)]
pub(in crate::session) struct Cadence {
    /// Device whose manual gives the time.
    pub(in crate::session) node: NodeId,
    /// Message name in the profile.
    pub(in crate::session) name: Arc<str>,
    pub(in crate::session) title: String,
    /// Max interval in ns.
    pub(in crate::session) limit: i64,
    pub(in crate::session) id: J1939Id,
    /// Monotonic time and frame of the last message.
    pub(in crate::session) last: i64,
    pub(in crate::session) last_frame: u64,
    /// Last intervals in ns, newest first; 0 for none.
    pub(in crate::session) intervals: [i64; INTERVALS],
    pub(in crate::session) is_overdue: bool,
    pub(in crate::session) is_queued: bool,
}

impl Cadence {
    pub(in crate::session) fn new(
        node: NodeId,
        name: Arc<str>,
        title: String,
        milliseconds: u32,
        id: J1939Id,
    ) -> Self {
        Self {
            node,
            name,
            title,
            limit: i64::from(milliseconds) * 1_000_000,
            id,
            last: 0,
            last_frame: 0,
            intervals: [0; INTERVALS],
            is_overdue: false,
            is_queued: false,
        }
    }

    /// Device whose manual gives the time, and the max interval in ns.
    pub(in crate::session) fn max_interval(&self) -> (NodeId, i64) {
        (self.node, self.limit)
    }

    /// Message name in the profile.
    pub(in crate::session) fn name(&self) -> &Arc<str> {
        &self.name
    }

    /// Monotonic time of the last message; `None` before the first.
    pub(in crate::session) fn last_reception(&self) -> Option<i64> {
        (self.last_frame != 0).then_some(self.last)
    }

    /// Moves the last reception by `delay` ns, during which all traffic stopped.
    pub(in crate::session) fn postpone_reception(&mut self, delay: i64) {
        if !self.is_overdue {
            self.last = self.last.saturating_add(delay);
        }
    }

    /// Median of the last intervals and max deviation from it, in ns; `None` for fewer than three.
    pub(in crate::session) fn usual_interval(&self) -> Option<(i64, i64)> {
        let mut sorted: Vec<i64> = self.intervals.iter().copied().filter(|interval| *interval > 0).collect();
        if sorted.len() < 3 {
            return None;
        }
        sorted.sort_unstable();
        let median = *sorted.get(sorted.len() / 2)?;
        let deviation = sorted.iter().map(|interval| interval.abs_diff(median)).max()?;
        Some((median, i64::try_from(deviation).unwrap_or(i64::MAX)))
    }

    pub(in crate::session) fn gap_event(&self, now: i64, has_returned: bool) -> EventKind {
        EventKind::MessageGap(Box::new(MessageGap {
            message: self.title.clone(),
            pgn: self.id.pgn,
            source: self.id.source,
            gap: now.saturating_sub(self.last),
            limit: self.limit,
            usual: self.usual_interval(),
            has_returned,
        }))
    }
}
