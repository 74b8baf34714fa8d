//! A node takes another node-ID: what moves with it, what stays.

use std::sync::Arc;

use super::procedure::Announcement;
use crate::event::EventKind;
use crate::frame::{CanId, Frame};
use crate::profile::{PdoDirection, PdoName, Role, integer};
use crate::session::routes::Service;
use crate::session::{Bus, Node, Observer};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

impl Bus {
    /// A node appears under `id`: if one was given that node-ID, it is that one.
    pub(in crate::session) fn take_node_id(&mut self, id: NodeId, frame: &Frame, out: &mut dyn Observer) {
        let accepted = id.canopen().and_then(|id| self.lss.take_accepted(id));
        if let Some((from, to)) = accepted.map(|(from, to)| (from.map(NodeId::Canopen), NodeId::Canopen(to)))
        {
            let from = from.or_else(|| self.only_one_in_reset(id));
            self.change_node_id(from, to, "lss", frame, out);
            self.node_id_changed(to, frame, out);
        } else if let Some(from) = self.uds.take_accepted(id) {
            self.change_node_id(Some(from), id, "uds", frame, out);
            self.node_id_changed(id, frame, out);
        } else if let Some(from) = self.told_to_be(id) {
            self.change_node_id(Some(from), id, "object", frame, out);
            self.node_id_changed(id, frame, out);
        }
    }

    fn node_id_changed(&self, id: NodeId, frame: &Frame, out: &mut dyn Observer) {
        let text = format!("node-ID {}", id.number());
        let change = Announcement { procedure: "node-ID change", word: "IDENT", finished: true, text };
        self.announce(id, change, frame, out);
    }

    /// The node that was reset and did not come back, if there is just one: LSS does not always tell which
    /// node it configured.
    fn only_one_in_reset(&self, but: NodeId) -> Option<NodeId> {
        let mut reset = self.nodes().filter(|node| node.id != but && node.reset_frame.is_some());
        reset.next().map(|node| node.id).filter(|_| reset.next().is_none())
    }

    /// A node told its serial number (1018:04). A rotary switch is never seen on the bus: a node with the
    /// numbers of another one that is silent since is that one under a new node-ID.
    pub(in crate::session) fn join_by_serial(&mut self, id: NodeId, frame: &Frame, out: &mut dyn Observer) {
        let numbers = |node: &Node| {
            let number = |sub| node.store.number(ObjectAddress::new(0x1018, sub));
            Some([number(1)?, number(2)?, number(4).filter(|serial| *serial != 0)?])
        };
        let Some(own) = self.node(id).filter(|node| !node.is_joined) else { return };
        let Some(wanted) = numbers(own) else { return };
        let began = own.first_frame;
        let mut alike = self
            .nodes()
            .filter(|node| node.id != id && node.last_frame < began && numbers(node) == Some(wanted));
        let (Some(other), None) = (alike.next(), alike.next()) else { return };
        let (from, device, assigned) = (other.id, Arc::clone(&other.device), other.assigned);
        drop(alike);
        if let Some(node) = self.node_mut(id) {
            node.is_joined = true;
        }
        let is_open = self.node(id).is_some_and(|node| node.assigned.is_none());
        if let Some(by) = assigned.filter(|_| is_open) {
            self.assign(id, &device, by);
        }
        let kind =
            EventKind::NodeIdChange { from: Some(from.number()), to: id.number(), by: "serial number" };
        self.emit(frame, id, false, kind, out);
    }

    /// The node whose node-ID object holds `id`, waiting for a restart.
    fn told_to_be(&self, id: NodeId) -> Option<NodeId> {
        let is_told = |node: &&Node| {
            node.id != id
                && node.store.all_waiting().any(|(object, waiting)| {
                    let meaning = node.meaning(object).filter(|it| it.role == Some(Role::NodeId));
                    let number = meaning.and_then(|meaning| integer(&meaning.decode(&waiting.value)));
                    number == Some(i64::from(id.number()))
                })
        };
        self.nodes().find(is_told).map(|node| node.id)
    }

    fn change_node_id(
        &mut self,
        from: Option<NodeId>,
        to: NodeId,
        by: &'static str,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        if let Some(from) = from {
            let staying = self.staying(from);
            self.move_node(from, to);
            self.move_delivered(to);
            for (name, id) in staying {
                self.routes.learn(id, Service::Pdo(name, to));
            }
            self.reset_by_move(to);
        }
        self.emit(
            frame,
            to,
            false,
            EventKind::NodeIdChange { from: from.map(NodeId::number), to: to.number(), by },
            out,
        );
    }

    /// PDOs that keep the identifier of the old node-ID, by the device's manual.
    fn staying(&self, id: NodeId) -> Vec<(PdoName, CanId)> {
        let Some(node) = self.node(id) else { return Vec::new() };
        let names = node.device.identity_change.cob_ids_stay.iter().filter_map(|name| name.parse().ok());
        let free = names.filter(|name| self.routes.learnt_id(Service::Pdo(*name, id)).is_none());
        free.filter_map(|name| Some((name, predefined(name, id)?))).collect()
    }

    /// Objects that fall back to their defaults with a new node-ID.
    fn reset_by_move(&mut self, id: NodeId) {
        let Some(node) = self.node(id) else { return };
        let ranges = node.device.identity_change.resets.clone();
        let objects: Vec<_> = node.store.sorted().into_iter().map(|(object, _)| object).collect();
        for object in objects.into_iter().filter(|it| ranges.iter().any(|range| range.covers(*it, 0, 0))) {
            if let Some(node) = self.node_mut(id) {
                Arc::make_mut(&mut node.store).remove(object);
            }
            self.forget_effect(id, object);
        }
    }
}

/// Identifier of a PDO by the predefined connection set (CiA 301 §7.3.3, table 39): four of each have one.
pub(super) fn predefined(name: PdoName, node: NodeId) -> Option<CanId> {
    let base = match name.direction {
        PdoDirection::Transmit => 0x180,
        PdoDirection::Receive => 0x200,
    };
    let step = name.number.checked_sub(1).filter(|step| *step < 4)?;
    Some(CanId::standard(base + 0x100 * step + u16::from(node.number())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::Event;
    use crate::frame::{BusIndex, Timestamp};
    use crate::session::SessionOptions;

    /// Boot-up of a node, then uploads of 1018:01, :02 and :04.
    fn introduced(bus: &mut Bus, id: u8, serial: u8, number: &mut u64) -> Vec<Event> {
        let mut events = Vec::new();
        let mut push = |can_id: u16, data: &[u8]| {
            *number += 1;
            let mut frame = Frame::data_frame(CanId::standard(can_id), data);
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

    fn changes(events: &[Event]) -> Vec<(Option<u8>, u8, &'static str)> {
        let change = |event: &Event| match event.kind {
            EventKind::NodeIdChange { from, to, by } => Some((from, to, by)),
            _ => None,
        };
        events.iter().filter_map(change).collect()
    }

    #[test]
    fn a_node_with_the_numbers_of_a_silent_one_is_that_one() {
        let mut bus = Bus::new(BusIndex(0), "can0", Arc::new(SessionOptions::default()));
        let mut number = 0;
        assert!(changes(&introduced(&mut bus, 2, 9, &mut number)).is_empty());
        assert!(changes(&introduced(&mut bus, 3, 8, &mut number)).is_empty(), "another serial number");
        let events = introduced(&mut bus, 5, 9, &mut number);
        assert_eq!(changes(&events), [(Some(2), 5, "serial number")]);
        // Without a serial number nothing tells one device from its neighbour.
        introduced(&mut bus, 6, 0, &mut number);
        assert!(changes(&introduced(&mut bus, 7, 0, &mut number)).is_empty());
    }
}
