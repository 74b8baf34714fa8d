//! Messages for which the manual of the receiver gives a max interval.

use std::sync::Arc;

use crate::frame::Frame;
use crate::profile::ValueCarrier;
use crate::session::bus::{Bus, Cadence};
use crate::session::context::MachineContext;
use crate::session::device::reassess_set_points;
use crate::session::timers::DeadlineSubject;

/// Handles a message with a monitored interval. A gap is emitted when it ends, with its length.
pub(in crate::session) fn on_watched_message(slot: usize, frame: &Frame, cx: &mut MachineContext<'_>) {
    if !cx.bus.clock.has_timestamps() {
        return;
    }
    let now = cx.bus.clock.now();
    let Some(cadence) = cx.bus.routes.slot_mut(slot).and_then(|slot| slot.cadence.as_deref_mut()) else {
        return;
    };
    let was_overdue = std::mem::replace(&mut cadence.is_overdue, false);
    let gap = was_overdue.then(|| (cadence.node, cadence.name.clone(), cadence.gap_event(now, true)));
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
        cx.timers.add_deadline(deadline, DeadlineSubject::Message(slot));
    }
    if let Some((node, name, kind)) = gap {
        cx.emit_event(frame, node, false, kind);
        if let Some(node) = cx.bus.nodes.node_mut(node) {
            node.behaviour.overdue.retain(|overdue| *overdue != name);
        }
        reassess_set_points(node, frame, cx);
    }
}

/// Handles the queue entry of a message that is due.
pub(in crate::session) fn on_message_deadline(slot: u16, now: i64, cx: &mut MachineContext<'_>) {
    let Some(cadence) =
        cx.bus.routes.slot_mut(usize::from(slot)).and_then(|slot| slot.cadence.as_deref_mut())
    else {
        return;
    };
    cadence.is_queued = false;
    let deadline = cadence.last.saturating_add(cadence.limit);
    if deadline >= now {
        cadence.is_queued = true;
        return cx.timers.add_deadline(deadline, DeadlineSubject::Message(slot));
    }
    cadence.is_overdue = true;
    let (node, name, number) = (cadence.node, cadence.name.clone(), cadence.last_frame);
    if let Some(node) = cx.bus.nodes.node_mut(node)
        && !node.behaviour.overdue.contains(&name)
    {
        node.behaviour.overdue.push(name);
    }
    // The event has the time of the deadline, and the last message as evidence.
    let frame = Frame { number, time: cx.bus.clock.stamp_of(deadline), ..Frame::EMPTY };
    reassess_set_points(node, &frame, cx);
}

/// Emits the messages that are still missing at the end of the capture.
pub(in crate::session) fn emit_overdue_messages(cx: &mut MachineContext<'_>) {
    let now = cx.bus.clock.now();
    let overdue: Vec<_> = cx
        .bus
        .routes
        .cadences()
        .filter(|cadence| cadence.is_overdue)
        .map(|cadence| (cadence.node, cadence.last_frame, cadence.gap_event(now, false)))
        .collect();
    for (node, number, kind) in overdue {
        let frame = Frame { number, time: cx.bus.last_time, ..Frame::EMPTY };
        cx.emit_event(&frame, node, false, kind);
    }
}

/// Starts monitoring the interval of a message.
pub(in crate::session) fn watch_message(bus: &mut Bus, slot: usize, cadence: Option<Cadence>) {
    if let Some(slot) = bus.routes.slot_mut(slot)
        && slot.cadence.is_none()
    {
        slot.cadence = cadence.map(Box::new);
    }
}

/// Message name of a carrier; `None` for a PDO.
pub(super) fn carrier_name(carrier: &ValueCarrier) -> Option<&Arc<str>> {
    match carrier {
        ValueCarrier::Message(name) => Some(name),
        ValueCarrier::Pdo(_) => None,
    }
}
