//! Change of the node-ID: state that moves with the node, and state that stays.

use std::sync::Arc;

use super::assign::assign_device;
use crate::event::{EventKind, NodeIdSource};
use crate::frame::{CanId, Frame};
use crate::profile::{ObjectRole, PdoName, as_integer};
use crate::session::bus::{Bus, IdentifierService, Node, predefined_identifier};
use crate::session::context::MachineContext;
use crate::session::device::{SettingAnnouncement, emit_announcement};
use crate::session::objects::{move_delivered, revert_object};
use crate::session::timers::DeadlineSubject;
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

/// Handles the first frame under `id`, if a node was configured with this node-ID.
pub(in crate::session) fn apply_node_id_change(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let (from, by) = if let Some((from, _)) = cx.bus.node_id_changes.take_by_lss(id) {
        (from.map(NodeId::Canopen).or_else(|| only_one_in_reset(&cx.bus, id)), NodeIdSource::Lss)
    } else if let Some(from) = cx.bus.node_id_changes.take_by_uds(id) {
        (Some(from), NodeIdSource::Uds)
    } else if let Some(from) = node_awaiting_id(&cx.bus, id) {
        (Some(from), NodeIdSource::Object)
    } else {
        return;
    };
    change_node_id(from, id, by, frame, cx);
    emit_node_id_announcement(id, frame, cx);
}

fn emit_node_id_announcement(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let text = format!("node-ID {}", id.number());
    let change = SettingAnnouncement { procedure: "node-ID change", word: "IDENT", finished: true, text };
    emit_announcement(id, change, frame, cx);
}

/// The only node that has not booted since its reset; LSS messages do not always identify the configured
/// node.
fn only_one_in_reset(bus: &Bus, but: NodeId) -> Option<NodeId> {
    let mut reset = bus.nodes().filter(|node| node.id != but && node.reset_frame.is_some());
    reset.next().map(|node| node.id).filter(|_| reset.next().is_none())
}

/// Handles a serial number (1018:04). A node with the identity of another one, silent since, is the same
/// device under a new node-ID; a rotary switch is not visible on the bus.
pub(in crate::session) fn join_by_serial(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let numbers = |node: &Node| {
        let number = |sub| node.store.number(ObjectAddress::new(0x1018, sub));
        Some([number(1)?, number(2)?, number(4).filter(|serial| *serial != 0)?])
    };
    let Some(own) = cx.bus.node(id).filter(|node| !node.is_joined) else { return };
    let Some(wanted) = numbers(own) else { return };
    let began = own.first_frame;
    let mut alike = cx
        .bus
        .nodes()
        .filter(|node| node.id != id && node.last_frame < began && numbers(node) == Some(wanted));
    let (Some(other), None) = (alike.next(), alike.next()) else { return };
    let (from, device, assigned) = (other.id, Arc::clone(&other.device), other.assigned);
    drop(alike);
    if let Some(node) = cx.bus.nodes.node_mut(id) {
        node.is_joined = true;
    }
    let is_open = cx.bus.node(id).is_some_and(|node| node.assigned.is_none());
    if let Some(by) = assigned.filter(|_| is_open) {
        assign_device(id, &device, by, cx);
    }
    let by = NodeIdSource::SerialNumber;
    let kind = EventKind::NodeIdChange { from: Some(from.number()), to: id.number(), by };
    cx.emit_event(frame, id, false, kind);
}

/// Node whose written node-ID object has the value `id` and takes effect at a restart.
fn node_awaiting_id(bus: &Bus, id: NodeId) -> Option<NodeId> {
    let is_reported = |node: &&Node| {
        node.id != id
            && node.store.all_waiting().any(|(object, waiting)| {
                let meaning = node.meaning(object).filter(|it| it.role == Some(ObjectRole::NodeId));
                let number = meaning.and_then(|meaning| as_integer(&meaning.decode(&waiting.value)));
                number == Some(i64::from(id.number()))
            })
    };
    bus.nodes().find(is_reported).map(|node| node.id)
}

/// Moves a node with all its state to another node-ID.
pub(in crate::session) fn change_node_id(
    from: Option<NodeId>,
    to: NodeId,
    by: NodeIdSource,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    if let Some(from) = from {
        let staying = retained_pdo_ids(&cx.bus, from);
        move_node(from, to, cx);
        if let Some(node) = cx.bus.nodes.node_mut(to) {
            node.previous_id = Some(from);
        }
        move_delivered(&mut cx.bus, to);
        for (name, id) in staying {
            cx.bus.routes.learn_service(id, IdentifierService::Pdo(name, to));
        }
        reset_moved_objects(&mut cx.bus, to);
    }
    cx.emit_event(
        frame,
        to,
        false,
        EventKind::NodeIdChange { from: from.map(NodeId::number), to: to.number(), by },
    );
}

/// PDOs that keep the identifier of the old node-ID, as the manual states.
fn retained_pdo_ids(bus: &Bus, id: NodeId) -> Vec<(PdoName, CanId)> {
    let Some(node) = bus.node(id) else { return Vec::new() };
    let names = node.device.identity_change.cob_ids_stay.iter().filter_map(|name| name.parse().ok());
    let free = names.filter(|name| bus.routes.learnt_id(IdentifierService::Pdo(*name, id)).is_none());
    free.filter_map(|name| Some((name, predefined_identifier(name, id)?))).collect()
}

/// Resets objects that return to their defaults with a new node-ID.
fn reset_moved_objects(bus: &mut Bus, id: NodeId) {
    let Some(node) = bus.node(id) else { return };
    let ranges = node.device.identity_change.resets.clone();
    let objects: Vec<_> = node.store.sorted().into_iter().map(|(object, _)| object).collect();
    for object in objects.into_iter().filter(|it| ranges.iter().any(|range| range.covers(*it, 0, 0))) {
        if let Some(node) = bus.nodes.node_mut(id) {
            Arc::make_mut(&mut node.store).remove(object);
        }
        revert_object(bus, id, object);
    }
}

/// Changes the node-ID of a node; a node that has it already is removed. Learnt identifiers stay with the
/// node, default identifiers follow the node-ID.
fn move_node(from: NodeId, to: NodeId, cx: &mut MachineContext<'_>) {
    cx.bus.nodes.change_id(from, to);
    for (id, service) in cx.bus.routes.learnt_services() {
        let moved = match service {
            IdentifierService::Pdo(name, node) if node == from => IdentifierService::Pdo(name, to),
            IdentifierService::Emcy(node) if node == from => IdentifierService::Emcy(to),
            _ => continue,
        };
        cx.bus.routes.learn_service(id, moved);
    }
    cx.bus.nodes.refresh_pdo_users();
    // Deadlines are queued by node-ID.
    for id in [from, to] {
        cx.timers.remove_subject(DeadlineSubject::Heartbeat(id));
    }
    if let Some(heartbeat) = cx.bus.nodes.known_node_mut(to).map(|node| &mut node.heartbeat) {
        heartbeat.queued = heartbeat.deadline.is_some();
        if let Some(deadline) = heartbeat.deadline {
            cx.timers.add_deadline(deadline, DeadlineSubject::Heartbeat(to));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use crate::frame::{BusIndex, Timestamp};
    use crate::session::BusDecoder;
    use crate::session::SessionOptions;

    /// Boot-up of a node, then uploads of 1018:01, :02 and :04.
    fn introduced(bus: &mut BusDecoder, id: u8, serial: u8, number: &mut u64) -> Vec<Event> {
        let mut events = Vec::new();
        let mut push = |can_id: u16, data: &[u8]| {
            *number += 1;
            let mut frame = Frame::data_frame(CanId::from_standard(can_id), data);
            frame.number = *number;
            frame.time = Some(Timestamp(1_000_000 * i64::try_from(*number).unwrap()));
            bus.push(&frame, &mut |event: &Event, _: &Bus| events.push(event.clone()));
        };
        push(0x700 + u16::from(id), &[0]);
        for (sub, value) in [(1, 0x19), (2, 7), (4, serial)] {
            push(0x600 + u16::from(id), &[0x40, 0x18, 0x10, sub, 0, 0, 0, 0]);
            push(0x580 + u16::from(id), &[0x43, 0x18, 0x10, sub, value, 0, 0, 0]);
        }
        events
    }

    fn changes(events: &[Event]) -> Vec<(Option<u8>, u8, NodeIdSource)> {
        let change = |event: &Event| match event.kind {
            EventKind::NodeIdChange { from, to, by } => Some((from, to, by)),
            _ => None,
        };
        events.iter().filter_map(change).collect()
    }

    #[test]
    fn a_node_with_the_numbers_of_a_silent_one_is_that_one() {
        let mut bus = BusDecoder::new(BusIndex(0), "can0", Arc::new(SessionOptions::default()));
        let mut number = 0;
        assert!(changes(&introduced(&mut bus, 2, 9, &mut number)).is_empty());
        assert!(changes(&introduced(&mut bus, 3, 8, &mut number)).is_empty(), "another serial number");
        let events = introduced(&mut bus, 5, 9, &mut number);
        assert_eq!(changes(&events), [(Some(2), 5, NodeIdSource::SerialNumber)]);
        // Without a serial number two equal devices cannot be distinguished.
        introduced(&mut bus, 6, 0, &mut number);
        assert!(changes(&introduced(&mut bus, 7, 0, &mut number)).is_empty());
    }
}
