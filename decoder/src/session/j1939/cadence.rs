//! Messages that must come again within the time the device's manual gives.

use std::sync::Arc;

use crate::event::{EventKind, MessageGap};
use crate::frame::Frame;
use crate::profile::Carrier;
use crate::session::timers::Subject;
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::j1939::J1939Id;

/// Intervals the usual one is taken of.
const INTERVALS: usize = 8;

/// What is remembered of such a message.
#[derive(Debug, Clone)]
pub(in crate::session) struct Cadence {
    /// Device whose manual says so.
    node: NodeId,
    /// Its name in the profile.
    name: Arc<str>,
    title: String,
    /// Nanoseconds permitted.
    limit: i64,
    id: J1939Id,
    /// Monotonic time of the last one, and its frame.
    last: i64,
    last_frame: u64,
    /// Last intervals, newest first; 0 for none.
    intervals: [i64; INTERVALS],
    is_overdue: bool,
    is_queued: bool,
}

impl Cadence {
    pub(super) fn new(node: NodeId, name: Arc<str>, title: String, milliseconds: u32, id: J1939Id) -> Self {
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

    /// Device whose manual gives a time, and that time in nanoseconds.
    pub(in crate::session) fn limit(&self) -> (NodeId, i64) {
        (self.node, self.limit)
    }

    /// Its name in the profile.
    pub(in crate::session) fn name(&self) -> &Arc<str> {
        &self.name
    }

    /// Monotonic time of the last one.
    pub(in crate::session) fn last(&self) -> Option<i64> {
        (self.last_frame != 0).then_some(self.last)
    }

    /// All traffic stopped for so long: the time does not count.
    pub(in crate::session) fn postpone(&mut self, delay: i64) {
        if !self.is_overdue {
            self.last = self.last.saturating_add(delay);
        }
    }

    /// Median of the last intervals, and the largest deviation from it; not of fewer than three.
    fn usual(&self) -> Option<(i64, i64)> {
        let mut sorted: Vec<i64> = self.intervals.iter().copied().filter(|interval| *interval > 0).collect();
        if sorted.len() < 3 {
            return None;
        }
        sorted.sort_unstable();
        let median = *sorted.get(sorted.len() / 2)?;
        let deviation = sorted.iter().map(|interval| interval.abs_diff(median)).max()?;
        Some((median, i64::try_from(deviation).unwrap_or(i64::MAX)))
    }

    fn gap(&self, now: i64, came_again: bool) -> EventKind {
        EventKind::MessageGap(Box::new(MessageGap {
            message: self.title.clone(),
            pgn: self.id.pgn,
            source: self.id.source,
            gap: now.saturating_sub(self.last),
            limit: self.limit,
            usual: self.usual(),
            came_again,
        }))
    }
}

impl Bus {
    /// A message came whose cadence is watched. A gap is told when it is over, with its length.
    pub(super) fn message_came(&mut self, slot: usize, frame: &Frame, out: &mut dyn Observer) {
        if !self.clock.runs() {
            return;
        }
        let now = self.clock.now();
        let Some(cadence) = self.routes.slot_mut(slot).and_then(|slot| slot.cadence.as_deref_mut()) else {
            return;
        };
        let was_overdue = std::mem::replace(&mut cadence.is_overdue, false);
        let gap = was_overdue.then(|| (cadence.node, cadence.name.clone(), cadence.gap(now, true)));
        let interval = now.saturating_sub(cadence.last);
        if !was_overdue && cadence.last_frame != 0 {
            cadence.intervals.rotate_right(1);
            if let Some(first) = cadence.intervals.first_mut() {
                *first = interval;
            }
        }
        (cadence.last, cadence.last_frame) = (now, frame.number);
        let deadline = now.saturating_add(cadence.limit);
        let must_queue = !std::mem::replace(&mut cadence.is_queued, true);
        if let (true, Ok(slot)) = (must_queue, u16::try_from(slot)) {
            self.timers.add(deadline, Subject::Message(slot));
        }
        if let Some((node, name, kind)) = gap {
            self.emit(frame, node, false, kind, out);
            if let Some(node) = self.node_mut(node) {
                node.behaviour.overdue.retain(|overdue| *overdue != name);
            }
            self.reassess(node, frame, out);
        }
    }

    /// The entry of a message in the queue came due.
    pub(in crate::session) fn message_deadline(&mut self, slot: u16, now: i64, out: &mut dyn Observer) {
        let Some(cadence) =
            self.routes.slot_mut(usize::from(slot)).and_then(|slot| slot.cadence.as_deref_mut())
        else {
            return;
        };
        cadence.is_queued = false;
        let deadline = cadence.last.saturating_add(cadence.limit);
        if deadline >= now {
            cadence.is_queued = true;
            return self.timers.add(deadline, Subject::Message(slot));
        }
        cadence.is_overdue = true;
        let (node, name, number) = (cadence.node, cadence.name.clone(), cadence.last_frame);
        if let Some(node) = self.node_mut(node)
            && !node.behaviour.overdue.contains(&name)
        {
            node.behaviour.overdue.push(name);
        }
        // The deadline's own time, and the last one as the evidence.
        let frame = Frame { number, time: self.clock.stamp_of(deadline), ..Frame::EMPTY };
        self.reassess(node, &frame, out);
    }

    /// The capture ends: messages that are still missing.
    pub(in crate::session) fn finish_messages(&mut self, out: &mut dyn Observer) {
        let now = self.clock.now();
        let overdue: Vec<_> = self
            .routes
            .cadences()
            .filter(|cadence| cadence.is_overdue)
            .map(|cadence| (cadence.node, cadence.last_frame, cadence.gap(now, false)))
            .collect();
        for (node, number, kind) in overdue {
            let frame = Frame { number, time: self.last_time, ..Frame::EMPTY };
            self.emit(&frame, node, false, kind, out);
        }
    }

    /// What devices are, or their addresses, changed: messages mean something else, and none is overdue.
    pub(in crate::session) fn refresh_messages(&mut self) {
        for (slot, cadence) in self.routes.refresh_messages() {
            self.timers.remove(Subject::Message(slot));
            if let Some(node) = self.node_mut(cadence.node) {
                node.behaviour.overdue.retain(|overdue| *overdue != cadence.name);
            }
        }
    }

    /// What an identifier brings to a device, and how often it must.
    pub(super) fn watch_message(&mut self, slot: usize, cadence: Option<Cadence>) {
        if let Some(slot) = self.routes.slot_mut(slot)
            && slot.cadence.is_none()
        {
            slot.cadence = cadence.map(Box::new);
        }
    }
}

/// Name of a message as what brings values.
pub(super) fn carrier_name(carrier: &Carrier) -> Option<&Arc<str>> {
    match carrier {
        Carrier::Message(name) => Some(name),
        Carrier::Pdo(_) => None,
    }
}
