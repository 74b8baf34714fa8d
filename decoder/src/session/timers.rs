//! One queue of deadlines a bus.
//!
//! A subject that moves its deadline with every frame does not touch the queue: its entry stays, and
//! when it comes due the subject is asked for its present deadline. So a frame costs nothing here, and a
//! subject has at most one entry.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::session::bus::Link;
use crate::wire::NodeId;

/// What has a deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Subject {
    /// Transfer of an SDO channel.
    SdoChannel(u16),
    /// Heartbeat of a node-ID.
    Heartbeat(NodeId),
    /// Set points of a node wait for SYNC.
    SetPoint(NodeId),
    /// J1939 message of a slot.
    Message(u16),
    /// DM1 of a node with active trouble codes.
    Dm1(NodeId),
    /// ISO-TP message on its way.
    IsoTp(Link),
    /// UDS requests of a link that wait.
    UdsRequest(Link),
    /// J1939 transfer at a place.
    Transport(u16),
}

/// Deadlines in monotonic nanoseconds.
#[derive(Debug, Clone)]
pub(super) struct Timers {
    queue: BinaryHeap<Reverse<(i64, Subject)>>,
    /// Earliest entry; `i64::MAX` without any.
    next: i64,
}

impl Default for Timers {
    fn default() -> Self {
        Self { queue: BinaryHeap::new(), next: i64::MAX }
    }
}

impl Timers {
    /// Puts `subject` into the queue; it must not be in it.
    pub(super) fn add(&mut self, deadline: i64, subject: Subject) {
        self.queue.push(Reverse((deadline, subject)));
        self.next = self.next.min(deadline);
    }

    /// Whether an entry may be due.
    #[inline]
    pub(super) fn is_due(&self, now: i64) -> bool {
        self.next < now
    }

    /// Takes the earliest entry out if it lies before `now`.
    pub(super) fn take_due(&mut self, now: i64) -> Option<(i64, Subject)> {
        let due = match self.queue.peek() {
            Some(Reverse((deadline, _))) if *deadline < now => self.queue.pop().map(|Reverse(entry)| entry),
            _ => None,
        };
        self.next = self.queue.peek().map_or(i64::MAX, |Reverse((deadline, _))| *deadline);
        due
    }

    /// Takes out the entries of a subject.
    pub(super) fn remove(&mut self, subject: Subject) {
        self.queue.retain(|Reverse((_, queued))| *queued != subject);
        self.next = self.queue.peek().map_or(i64::MAX, |Reverse((deadline, _))| *deadline);
    }

    /// Bytes held.
    pub(super) fn footprint(&self) -> usize {
        self.queue.len() * size_of::<(i64, Subject)>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_out_in_order_and_only_when_due() {
        let mut timers = Timers::default();
        timers.add(30, Subject::Heartbeat(NodeId::Canopen(3)));
        timers.add(10, Subject::SdoChannel(1));
        assert!(!timers.is_due(10) && timers.is_due(11));
        assert_eq!(timers.take_due(31), Some((10, Subject::SdoChannel(1))));
        assert_eq!(timers.take_due(30), None);
        assert_eq!(timers.take_due(31), Some((30, Subject::Heartbeat(NodeId::Canopen(3)))));
        assert_eq!(timers.take_due(i64::MAX), None);
        timers.add(10, Subject::SdoChannel(1));
        timers.add(20, Subject::Heartbeat(NodeId::Canopen(3)));
        timers.remove(Subject::SdoChannel(1));
        assert!(!timers.is_due(20) && timers.is_due(21));
    }
}
