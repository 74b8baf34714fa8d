//! A node takes another node-ID: what moves with it, what stays.

use super::procedure::Announcement;
use crate::event::EventKind;
use crate::frame::{CanId, Frame};
use crate::profile::{PdoDirection, PdoName, Role, integer};
use crate::session::routes::Service;
use crate::session::{Bus, Observer};

impl Bus {
    /// A node appears under `id`: if one was given that node-ID, it is that one.
    pub(in crate::session) fn take_node_id(&mut self, id: u8, frame: &Frame, out: &mut dyn Observer) {
        if let Some((from, to)) = self.lss.take_accepted(id) {
            let from = from.or_else(|| self.only_one_in_reset(id));
            self.change_node_id(from, to, "lss", frame, out);
            self.node_id_changed(to, frame, out);
        } else if let Some(from) = self.told_to_be(id) {
            self.change_node_id(Some(from), id, "object", frame, out);
            self.node_id_changed(id, frame, out);
        }
    }

    fn node_id_changed(&self, id: u8, frame: &Frame, out: &mut dyn Observer) {
        let text = format!("node-ID {id}");
        let change = Announcement { procedure: "node-ID change", word: "IDENT", finished: true, text };
        self.announce(id, change, frame, out);
    }

    /// The node that was reset and did not come back, if there is just one: LSS does not always tell which
    /// node it configured.
    fn only_one_in_reset(&self, but: u8) -> Option<u8> {
        let mut reset = self.nodes().filter(|node| node.id != but && node.reset_frame.is_some());
        reset.next().map(|node| node.id).filter(|_| reset.next().is_none())
    }

    /// The node whose node-ID object holds `id`, waiting for a restart.
    fn told_to_be(&self, id: u8) -> Option<u8> {
        let is_told = |node: &&crate::session::Node| {
            node.id != id
                && node.store.all_waiting().any(|(object, waiting)| {
                    let meaning = node.meaning(object).filter(|it| it.role == Some(Role::NodeId));
                    let number = meaning.and_then(|meaning| integer(&meaning.decode(&waiting.value)));
                    number == Some(i64::from(id))
                })
        };
        self.nodes().find(is_told).map(|node| node.id)
    }

    fn change_node_id(
        &mut self,
        from: Option<u8>,
        to: u8,
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
        self.emit(frame, to, false, EventKind::NodeIdChange { from, to, by }, out);
    }

    /// PDOs that keep the identifier of the old node-ID, by the device's manual.
    fn staying(&self, id: u8) -> Vec<(PdoName, CanId)> {
        let Some(node) = self.node(id) else { return Vec::new() };
        let names = node.device.identity_change.cob_ids_stay.iter().filter_map(|name| name.parse().ok());
        let free = names.filter(|name| self.routes.learnt_id(Service::Pdo(*name, id)).is_none());
        free.filter_map(|name| Some((name, predefined(name, id)?))).collect()
    }

    /// Objects that fall back to their defaults with a new node-ID.
    fn reset_by_move(&mut self, id: u8) {
        let Some(node) = self.node(id) else { return };
        let ranges = node.device.identity_change.resets.clone();
        let objects: Vec<_> = node.store.sorted().into_iter().map(|(object, _)| object).collect();
        for object in objects.into_iter().filter(|it| ranges.iter().any(|range| range.covers(*it, 0, 0))) {
            if let Some(node) = self.node_mut(id) {
                std::sync::Arc::make_mut(&mut node.store).remove(object);
            }
            self.forget_effect(id, object);
        }
    }
}

/// Identifier of a PDO by the predefined connection set (CiA 301 §7.3.3, table 39): four of each have one.
fn predefined(name: PdoName, node: u8) -> Option<CanId> {
    let base = match name.direction {
        PdoDirection::Transmit => 0x180,
        PdoDirection::Receive => 0x200,
    };
    let step = name.number.checked_sub(1).filter(|step| *step < 4)?;
    Some(CanId::standard(base + 0x100 * step + u16::from(node)))
}
