//! PDOs: the hot path. One prepared event per identifier is updated in place and lent to the observer.

use std::sync::Arc;

use super::nmt::confirm_operational_by_pdo;
use crate::event::{DecodedPdo as PdoEvent, Event, EventKind, EventProtocol, FrameRange};
use crate::frame::{Frame, FrameFlags, MAX_DATA};
use crate::profile::{PdoDirection, PdoName, ValueCarrier};
use crate::session::bus::{
    IdentifierPlan, IdentifierService, LastPayload, RecentFrames, WatchPlan, pdo_layout,
};
use crate::session::context::MachineContext;
use crate::session::device::{confirm_identifier, on_values};
use crate::session::machine::ProtocolMachine;
use crate::session::presence::mark_alive;
use crate::wire::NodeId;

/// PDOs of all nodes; the last PDO of each identifier is in its slot.
#[derive(Debug, Clone)]
pub(in crate::session) struct PdoMachine;

impl ProtocolMachine for PdoMachine {
    /// Slot of the identifier, name of the PDO, and node.
    type Route<'a> = (usize, PdoName, NodeId);
    type Product = ();

    #[expect(clippy::inline_always, reason = "the call alone costs 3 % of a frame")]
    #[inline(always)]
    fn on_frame(
        &mut self,
        (slot, name, id): (usize, PdoName, NodeId),
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) {
        let believed = cx.bus.protocols.canopen.is_confirmed() || cx.bus.protocols.named.note_canopen(id);
        if !believed {
            let now = cx.bus.clock.now();
            cx.bus.protocols.canopen.count_unsupported(id.number(), now);
            if !cx.is_decoded(Some(id), frame) {
                return;
            }
        }
        let is_request = frame.flags.contains(FrameFlags::REMOTE);
        if name.direction == PdoDirection::Transmit && !is_request {
            mark_producer_alive(id, frame, cx);
        }
        let bus = &mut cx.bus;
        let Some(entry) = bus.routes.slot_mut(slot) else { return };
        let Some(event) = &mut entry.prepared else { return first_pdo(slot, name, id, frame, cx) };
        let EventKind::Pdo(pdo) = &mut event.kind else { return };
        let last = std::mem::replace(&mut entry.last, LastPayload::payload_of(frame));
        let change = match last.changed_bits(entry.last) {
            Some(change) => (change != 0).then_some(change),
            None if pdo.is_request == is_request => changed_bits(pdo, frame),
            None => Some(u64::MAX),
        };
        let same = change.is_none();
        if let Some(change) = change {
            entry.pulse.note_change((bus.clock.now(), frame.number), entry.last.word(), change);
        }
        let is_resized = !same && pdo.length != frame.length && !is_request;
        event.time = frame.time;
        event.frames = FrameRange::one(frame.number);
        event.presumed = !believed;
        event.routine = same;
        // Copied even if equal: cheaper than a branch that is hard to predict.
        pdo.length = frame.length;
        pdo.is_request = is_request;
        copy_payload(&mut pdo.bytes, frame);
        let mut matters = false;
        if let Some(planned) = &mut entry.plan {
            matters = planned.plan.triggers
                || is_resized
                || change.is_some_and(|change| change & planned.plan.mask != 0);
            if planned.plan.commands {
                planned.recent.push(frame.number, bus.clock.now());
            }
        }
        cx.send_prepared(slot);
        if is_resized {
            record_length(id, name, frame, cx);
        }
        if matters {
            on_values(slot, (&ValueCarrier::Pdo(name), name.direction), id, frame, cx);
        }
    }
}

#[expect(clippy::inline_always, reason = "the call alone costs 1 % of a frame")]
#[inline(always)]
fn mark_producer_alive(id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    let now = cx.bus.clock.now();
    // A PDO alone does not prove its node: the identifier may be configured in another one.
    let Some(node) = cx.bus.nodes.known_node_mut(id) else { return };
    if node.attention {
        mark_alive(id, frame, cx);
        confirm_operational_by_pdo(id, frame, cx);
        return;
    }
    node.last_frame = frame.number;
    node.last_seen = frame.time;
    node.last_received = now;
}

/// Records the length of a PDO, which can suggest the profile of the node.
#[cold]
fn record_length(id: NodeId, name: PdoName, frame: &Frame, cx: &mut MachineContext<'_>) {
    if !frame.flags.contains(FrameFlags::REMOTE)
        && cx.bus.node(id).is_some()
        && let Some(node) = cx.bus.nodes.node_mut(id)
    {
        node.signs.note_pdo(name, frame.length);
    }
}

#[cold]
fn first_pdo(slot: usize, name: PdoName, id: NodeId, frame: &Frame, cx: &mut MachineContext<'_>) {
    record_length(id, name, frame, cx);
    let mut bytes = [0; MAX_DATA];
    copy_payload(&mut bytes, frame);
    let layout = cx.bus.node(id).and_then(|node| pdo_layout(node, name)).map(Arc::new);
    // A mapping that is learnt later applies from then on.
    let layout = layout.or_else(|| cx.described_message(frame).map(|message| Arc::clone(&message.layout)));
    // A possible SDO dialogue on unconfigured PDO identifiers: while it is examined, no event is prepared.
    let is_examined = layout.is_none()
        && !frame.flags.contains(FrameFlags::REMOTE)
        && cx.bus.hints.dialogues.is_candidate(frame)
        && !cx.bus.routes.is_placed(IdentifierService::Pdo(name, id))
        && cx.bus.pdo_identifier(id, name).is_none_or(|(_, is_confirmed)| !is_confirmed);
    if is_examined && cx.follow_dialogue(frame) {
        return cx.emit_undecoded(frame, Some("SDO-like response"));
    }
    let node = cx.bus.node(id);
    let plan = match (node.filter(|node| node.assigned.is_some()), &layout) {
        (Some(node), Some(layout)) => {
            WatchPlan::plan_for(&node.device, &ValueCarrier::Pdo(name), name.direction, layout)
        }
        _ => None,
    };
    let pdo = PdoEvent {
        name,
        cob_id: frame.id,
        is_request: frame.flags.contains(FrameFlags::REMOTE),
        length: frame.length,
        bytes,
        layout,
    };
    let event = Event {
        time: frame.time,
        bus: cx.bus.index,
        frames: FrameRange::one(frame.number),
        protocol: EventProtocol::Canopen,
        node: Some(id),
        presumed: !cx.bus.protocols.is_settled(Some(id)),
        routine: false,
        kind: EventKind::Pdo(pdo),
    };
    let now = cx.bus.clock.now();
    if let Some(entry) = cx.bus.routes.slot_mut(slot) {
        entry.prepared = Some(Box::new(event));
        entry.last = LastPayload::payload_of(frame);
        entry.set_needed_bits(plan.as_ref().map_or(Some(0), WatchPlan::needed_bits));
        entry.plan = plan.map(|plan| {
            let mut recent = RecentFrames::default();
            recent.push(frame.number, now);
            Box::new(IdentifierPlan { plan: Arc::new(plan), recent })
        });
    }
    cx.send_prepared(slot);
    on_values(slot, (&ValueCarrier::Pdo(name), name.direction), id, frame, cx);
    if name.direction == PdoDirection::Receive {
        confirm_identifier(id, name, frame, cx);
    }
    if is_examined && let Some(entry) = cx.bus.routes.slot_mut(slot) {
        entry.drop_event();
    }
}

/// All bits if a request, or a PDO that [`LastPayload`] cannot compare, differs from the previous one; `None` if it is
/// equal.
fn changed_bits(pdo: &PdoEvent, frame: &Frame) -> Option<u64> {
    (pdo.length != frame.length || pdo.payload() != frame.data()).then_some(u64::MAX)
}

/// Copies the payload of a frame; at most eight bytes are copied at once.
#[inline]
pub(in crate::session) fn copy_payload(bytes: &mut [u8; MAX_DATA], frame: &Frame) {
    if frame.length <= 8 {
        if let (Some(target), Some(source)) = (bytes.first_chunk_mut::<8>(), frame.bytes.first_chunk()) {
            *target = *source;
        }
    } else {
        *bytes = frame.bytes;
    }
}
