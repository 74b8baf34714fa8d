//! Object values at a restart: waiting values take effect, volatile values are lost. A power-on is not
//! visible on the bus, so its effects are presumed until a message confirms or contradicts them.

use std::sync::Arc;

use super::delivered::revert_to_delivered;
use super::parameters::{apply_object, revert_object};
use super::values::mark_unsaved_stale;
use crate::event::{ChangeOrigin, EventKind, ObjectChange};
use crate::frame::Frame;
use crate::profile::device::ErrorCodeOrder;
use crate::profile::object::NumberFormat;
use crate::profile::{ValueStorage, WriteEffect};
use crate::session::bus::{Bus, Node, OriginKind, RestartType, StoredOrigin};
use crate::session::context::MachineContext;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// A value that the restart changed.
pub(in crate::session) struct RestartChange {
    object: ObjectAddress,
    from: Option<Vec<u8>>,
    to: Option<Vec<u8>>,
    origin: ChangeOrigin,
}

/// Number of written values lost by a restart, for the boot event.
pub(in crate::session) fn count_lost_settings(bus: &Bus, id: NodeId) -> u32 {
    let Some(node) = bus.node(id) else { return 0 };
    let lost = lost_values(node).into_iter().filter(|change| {
        let entry = node.store.get(change.object);
        change.from != change.to && entry.is_some_and(|entry| entry.origin.kind == OriginKind::Download)
    });
    u32::try_from(lost.count()).unwrap_or(u32::MAX)
}

/// Applies a restart to the values of a node; returns the changes, which are emitted after the boot event.
pub(in crate::session) fn restart_values(bus: &mut Bus, id: NodeId, frame: &Frame) -> Vec<RestartChange> {
    let Some(node) = bus.nodes.node_mut(id) else { return Vec::new() };
    let presumed = node.restart == RestartType::PowerOn;
    let is_due = node.restart_brings();
    let waiting = Arc::make_mut(&mut node.store).take_waiting(is_due);
    let mut changes = lost_values(node);
    let store = Arc::make_mut(&mut node.store);
    for change in &changes {
        match &change.to {
            Some(kept) => store.fall_back(change.object, kept),
            None => store.remove(change.object),
        }
    }
    for (object, value) in waiting {
        let from = store.seen_value(object).map(|entry| entry.value.clone());
        let origin = StoredOrigin { kind: OriginKind::Download, frame: frame.number, time: frame.time };
        if store.set(object, &value, origin).is_ok() && presumed {
            store.mark_doubtful(object);
        }
        changes.push(RestartChange { object, from, to: Some(value), origin: ChangeOrigin::Restart });
    }
    mark_unsaved_stale(bus, id);
    bus.routes.refresh_pdos_of(id);
    changes
}

pub(in crate::session) fn emit_restart_changes(
    id: NodeId,
    changes: Vec<RestartChange>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    for RestartChange { object, from, to, origin } in changes {
        if from == to {
            continue;
        }
        revert_value(&mut cx.bus, id, object);
        let kind = EventKind::ObjectChange(Box::new(ObjectChange {
            object,
            from,
            to,
            origin,
            effect: None,
            persists: None,
        }));
        cx.emit_event(frame, id, origin != ChangeOrigin::Restart, kind);
    }
}

/// Applies an object that changed without a message: its identifiers and times follow.
fn revert_value(bus: &mut Bus, id: NodeId, object: ObjectAddress) {
    if let Some(node) = bus.nodes.node_mut(id) {
        let decides = node.device.emcy.byte_order.as_ref().and_then(ErrorCodeOrder::object) == Some(object);
        node.emcy_order = node.emcy_order.filter(|_| !decides);
    }
    let known = bus.node(id).is_some_and(|node| node.store.seen_value(object).is_some());
    if known {
        apply_object(bus, id, object);
    } else {
        revert_object(bus, id, object);
        revert_to_delivered(bus, id, object);
    }
}

/// Values lost by a restart: volatile objects, and those written but not stored.
fn lost_values(node: &Node) -> Vec<RestartChange> {
    let mut changes = Vec::new();
    for (object, entry) in node.store.sorted() {
        if matches!(entry.origin.kind, OriginKind::BusFile | OriginKind::DeviceFile) {
            continue;
        }
        let known = node.device.dictionary.find_object(object).and_then(|found| found.entry);
        // A signature is a command, not a value.
        let known = known.filter(|known| known.format != NumberFormat::Ascii);
        let kept = node.store.stored_value(object).map(<[u8]>::to_vec);
        let to = match known.map(|known| known.storage) {
            Some(ValueStorage::Volatile) => None,
            Some(ValueStorage::Save) if entry.origin.kind == OriginKind::Download => kept,
            _ => continue,
        };
        if to.as_ref() != Some(&entry.value) {
            changes.push(RestartChange {
                object,
                from: Some(entry.value.clone()),
                to,
                origin: ChangeOrigin::Reset,
            });
        }
    }
    changes
}

impl Node {
    /// Condition for a waiting value to take effect at the present restart.
    fn restart_brings(&self) -> impl Fn(WriteEffect) -> bool + use<> {
        let restart = self.restart;
        move |effect| restart.applies_value(effect)
    }
}
