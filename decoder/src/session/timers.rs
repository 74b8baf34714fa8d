//! One queue of deadlines per bus.
//!
//! A subject that moves its deadline with every frame does not touch the queue. Its entry stays, and the
//! present deadline is checked when the entry is due. So a frame causes no work here, and a subject has at
//! most one entry.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::session::bus::UdsLink;
use crate::wire::NodeId;

/// Subject of a deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum DeadlineSubject {
    /// Open transfer of an SDO channel.
    SdoChannel(u16),
    /// NMT error control of a node.
    Heartbeat(NodeId),
    /// Set points of a node that wait for SYNC.
    SetPoint(NodeId),
    /// J1939 message in a slot of the routing table.
    Message(u16),
    /// DM1 of a node with active trouble codes.
    Dm1(NodeId),
    /// Incomplete ISO-TP message.
    IsoTp(UdsLink),
    /// Waiting UDS requests of a link.
    UdsRequest(UdsLink),
    /// J1939 transfer, by its index in the table of transfers.
    Transport(u16),
    /// Incomplete fast packets of the bus.
    FastPackets,
}

/// Deadlines in monotonic ns.
#[derive(Debug, Clone)]
pub(super) struct Timers {
    queue: BinaryHeap<Reverse<(i64, DeadlineSubject)>>,
    /// Earliest entry; `i64::MAX` if the queue is empty.
    next: i64,
}

impl Default for Timers {
    fn default() -> Self {
        Self { queue: BinaryHeap::new(), next: i64::MAX }
    }
}

impl Timers {
    /// Adds a deadline for `subject`, which must not be in the queue.
    pub(super) fn add_deadline(&mut self, deadline: i64, subject: DeadlineSubject) {
        self.queue.push(Reverse((deadline, subject)));
        self.next = self.next.min(deadline);
    }

    /// Whether an entry may be due.
    #[inline]
    pub(super) fn is_due(&self, now: i64) -> bool {
        self.next < now
    }

    /// Removes and returns the earliest entry if it is before `now`.
    pub(super) fn take_due(&mut self, now: i64) -> Option<(i64, DeadlineSubject)> {
        let due = match self.queue.peek() {
            Some(Reverse((deadline, _))) if *deadline < now => self.queue.pop().map(|Reverse(entry)| entry),
            _ => None,
        };
        self.next = self.queue.peek().map_or(i64::MAX, |Reverse((deadline, _))| *deadline);
        due
    }

    /// Removes all entries of a subject.
    pub(super) fn remove_subject(&mut self, subject: DeadlineSubject) {
        self.queue.retain(|Reverse((_, queued))| *queued != subject);
        self.next = self.queue.peek().map_or(i64::MAX, |Reverse((deadline, _))| *deadline);
    }

    /// Bytes held by the queue.
    pub(super) fn footprint(&self) -> usize {
        self.queue.len() * size_of::<(i64, DeadlineSubject)>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_come_out_in_order_and_only_when_due() {
        let mut timers = Timers::default();
        timers.add_deadline(30, DeadlineSubject::Heartbeat(NodeId::Canopen(3)));
        timers.add_deadline(10, DeadlineSubject::SdoChannel(1));
        assert!(!timers.is_due(10) && timers.is_due(11));
        assert_eq!(timers.take_due(31), Some((10, DeadlineSubject::SdoChannel(1))));
        assert_eq!(timers.take_due(30), None);
        assert_eq!(timers.take_due(31), Some((30, DeadlineSubject::Heartbeat(NodeId::Canopen(3)))));
        assert_eq!(timers.take_due(i64::MAX), None);
        timers.add_deadline(10, DeadlineSubject::SdoChannel(1));
        timers.add_deadline(20, DeadlineSubject::Heartbeat(NodeId::Canopen(3)));
        timers.remove_subject(DeadlineSubject::SdoChannel(1));
        assert!(!timers.is_due(20) && timers.is_due(21));
    }
}
