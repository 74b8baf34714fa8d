//! Short path of a frame: its contents bring nothing that the session or an observer needs, so no event is made.

use super::bus::{Bus, LastPayload, Service};
use super::decoder::BusDecoder;
use super::observer::{Observer, Preview};
use crate::frame::Frame;
use crate::profile::PdoDirection;
use crate::wire::NodeId;
use crate::wire::j1939::NO_ADDRESS;

impl BusDecoder {
    /// Whether nobody needs the event of a frame; if so, times and counters are updated. The frame follows the last one
    /// in time.
    #[inline]
    pub(super) fn is_skipped(
        &mut self,
        (identifier, service): (usize, Service),
        frame: &Frame,
        out: &mut dyn Observer,
    ) -> bool {
        let bus = &mut self.shared.bus;
        let Some(state) = bus.routes.slot(identifier) else { return false };
        let (Some(needed), Some(time)) = (state.needed, frame.time) else { return false };
        let payload = LastPayload::of(frame);
        let change = state.last.change(payload).filter(|change| change & needed == 0);
        let Some(change) = change.filter(|_| frame.flags.is_classic_data()) else { return false };
        if !bus.is_settled_sender(service) {
            return false;
        }
        let (pdo, node) = match service {
            Service::Pdo(name, node) => (Some(name), node),
            Service::J1939(id) => (None, NodeId::J1939(id.source)),
            _ => return false,
        };
        let (frame, now) = (frame.number, bus.clock.now());
        let preview = Preview { identifier, pdo, node, frame, time, now, change };
        if out.needs(&preview, bus) {
            return false;
        }
        bus.skip(&preview, payload);
        out.skip(&preview, bus);
        true
    }
}

impl Bus {
    /// Whether the protocol of a PDO or message is confirmed, and its sender present in a known state.
    #[inline]
    fn is_settled_sender(&self, service: Service) -> bool {
        match service {
            Service::Pdo(name, node) => {
                let is_sent = name.direction == PdoDirection::Transmit;
                self.canopen.is_confirmed()
                    && (!is_sent || self.node(node).is_none_or(|node| !node.attention))
            }
            Service::J1939(id) => {
                self.j1939.is_confirmed()
                    && (id.source >= NO_ADDRESS || self.node(NodeId::J1939(id.source)).is_some())
            }
            _ => false,
        }
    }

    /// Updates an identifier and its sender at a frame without an event.
    #[inline]
    fn skip(&mut self, preview: &Preview, payload: LastPayload) {
        if let Some(state) = self.routes.slot_mut(preview.identifier) {
            state.last = payload;
            if let Some(planned) = state.plan.as_mut().filter(|planned| planned.plan.commands) {
                planned.recent.push(preview.frame, preview.now);
            }
        }
        if preview.pdo.is_some_and(|pdo| pdo.direction == PdoDirection::Receive) {
            return;
        }
        // A PDO alone does not prove its node: the identifier may be configured in another one.
        if let Some(node) = self.known_node_mut(preview.node) {
            node.last_frame = preview.frame;
            node.last_seen = Some(preview.time);
            node.last_heard = preview.now;
        }
    }
}
