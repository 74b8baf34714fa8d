//! Single-frame messages: the hot path. One prepared event per identifier is updated in place and lent to the
//! observer, as with PDOs.

use std::sync::Arc;

use super::cadence::{
    carrier_name, emit_overdue_messages, on_message_deadline, on_watched_message, watch_message,
};
use crate::event::{EventKind, FrameRange, J1939Message};
use crate::frame::{Frame, FrameFlags};
use crate::profile::device::MessageSpec;
use crate::profile::{EntryResolver, LayoutOrigin, NoValues, PdoDirection, ValueCarrier, is_nmea2000_group};
use crate::session::bus::{
    Bus, Cadence, IdentifierPlan, LastPayload, OriginKind, RecentFrames, SenderGroup, StoredOrigin, WatchPlan,
};
use crate::session::bus::{ConcernedDevice, layout_of_profile};
use crate::session::context::MachineContext;
use crate::session::device::on_values;
use crate::session::identity::refresh_messages;
use crate::session::machine::{ProtocolMachine, TimedMachine};
use crate::wire::j1939::{J1939Id, Pgn};

/// Last PGN of data page 0; those of NMEA 2000 are higher.
const LAST_OF_PAGE_0: u32 = 0xFFFF;

/// Single-frame messages of all addresses; the last one of each identifier is in its slot.
#[derive(Debug, Clone)]
pub(in crate::session) struct MessageMachine;

impl ProtocolMachine for MessageMachine {
    /// Slot of the identifier, if there is one, and the identifier.
    type Route<'a> = (Option<usize>, J1939Id);
    type Product = ();

    #[inline]
    fn on_frame(&mut self, (slot, id): (Option<usize>, J1939Id), frame: &Frame, cx: &mut MachineContext<'_>) {
        if frame.flags.contains(FrameFlags::REMOTE) {
            return cx.emit_undecoded(frame, None);
        }
        let Some(slot) = slot else { return unprepared_message(id, frame, cx) };
        let believed = cx.bus.protocols.j1939.is_confirmed() || cx.bus.protocols.named.concerns_named(id);
        let bus = &mut cx.bus;
        let Some(entry) = bus.routes.slot_mut(slot) else { return };
        let Some(event) = &mut entry.prepared else { return first_message(slot, id, frame, cx) };
        let EventKind::J1939Message(message) = &mut event.kind else { return };
        let continues = id.pgn.number() > LAST_OF_PAGE_0 && is_second_frame(message.payload(), frame.data());
        let last = std::mem::replace(&mut entry.last, LastPayload::payload_of(frame));
        let change = match last.changed_bits(entry.last) {
            Some(change) => (change != 0).then_some(change),
            None => changed_bits(message, frame),
        };
        if let (Some(change), Some(planned)) = (change, &entry.plan)
            && change & planned.plan.deciding != 0
        {
            // A field of the message decides how the message is decoded.
            return first_message(slot, id, frame, cx);
        }
        if let Some(change) = change {
            entry.pulse.note_change((bus.clock.now(), frame.number), entry.last.word(), change);
        }
        event.time = frame.time;
        event.frames = FrameRange::one(frame.number);
        event.presumed = !believed;
        event.routine = change.is_none();
        message.length = frame.length;
        message.bytes = frame.bytes;
        let mut matters = false;
        if let Some(planned) = &mut entry.plan {
            matters = planned.plan.triggers || change.is_some_and(|change| change & planned.plan.mask != 0);
            if planned.plan.commands {
                planned.recent.push(frame.number, bus.clock.now());
            }
        }
        let watched = entry.cadence.is_some();
        if watched {
            on_watched_message(slot, frame, cx);
        }
        cx.send_prepared(slot);
        if matters {
            pass_values_to_device(slot, id, frame, cx);
        }
        if continues {
            emit_fast_packet_note(id.pgn, frame, cx);
        }
    }

    fn on_silence(&mut self, delay: i64, bus: &mut Bus) {
        for cadence in bus.routes.cadences_mut() {
            cadence.postpone_reception(delay);
        }
    }

    fn on_end(&mut self, cx: &mut MachineContext<'_>) {
        emit_overdue_messages(cx);
    }
}

impl TimedMachine for MessageMachine {
    /// Slot of a message with a monitored interval.
    type Deadline = u16;

    fn on_deadline(&mut self, slot: u16, now: i64, cx: &mut MachineContext<'_>) {
        on_message_deadline(slot, now, cx);
    }
}

/// NMEA 2000 splits longer messages into fast packets; a frame does not show whether its group does.
#[cold]
fn emit_fast_packet_note(pgn: Pgn, frame: &Frame, cx: &mut MachineContext<'_>) {
    // By chance, data of a single-frame group can look like the counter of a fast packet.
    if is_nmea2000_group(pgn) {
        return;
    }
    cx.bus.protocols.omissions.fast_packets += 1;
    if !std::mem::replace(&mut cx.notices.fast_packets, true) {
        let text =
            format!("PGN {pgn} looks like fast packets, but is not in the list: each frame is one message");
        cx.emit_note(frame, text);
    }
}

/// Handles the first message of an identifier, and a message whose layout changes.
#[cold]
fn first_message(slot: usize, id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) {
    cx.bus.protocols.has_nmea2000 |= is_nmea2000_group(id.pgn);
    if cx.bus.protocols.note_rv_c(id.pgn, usize::from(frame.length)) {
        refresh_messages(cx);
    }
    let concerned = cx.bus.nodes.concerned_device(id);
    if let Some(concerned) = &concerned {
        store_deciding_values(&mut cx.bus, concerned, frame);
    }
    let group = cx.bus.group_with(id, frame.data(), concerned.as_ref());
    let plan = concerned.as_ref().zip(group.layout.as_deref()).and_then(|(concerned, layout)| {
        let spec = concerned.message_spec()?;
        WatchPlan::plan_for(&concerned.device, &message_carrier(spec), spec.direction.into(), layout)
    });
    let plan = plan.or_else(|| WatchPlan::plan_deciding(group.deciding));
    let mut event = cx.j1939_event(frame, id, EventKind::J1939Message(build_message(id, frame, group)));
    let now = cx.bus.clock.now();
    let cadence = concerned.as_ref().and_then(|concerned| message_cadence(concerned, id));
    let needed = needed_bits(id, plan.as_ref(), cadence.as_ref(), cx.bus.protocols.has_nmea2000);
    if let Some(entry) = cx.bus.routes.slot_mut(slot) {
        event.routine = false;
        entry.last = LastPayload::payload_of(frame);
        entry.set_needed_bits(needed);
        entry.version = entry.version.wrapping_add(1);
        let before = entry.plan.take();
        entry.prepared = Some(Box::new(event));
        entry.plan = plan.map(|plan| {
            let mut recent = before.map_or(RecentFrames::default(), |before| before.recent);
            recent.push(frame.number, now);
            Box::new(IdentifierPlan { plan: Arc::new(plan), recent })
        });
    }
    watch_message(&mut cx.bus, slot, cadence);
    on_watched_message(slot, frame, cx);
    cx.send_prepared(slot);
    pass_values_to_device(slot, id, frame, cx);
}

/// Handles a message without a slot: the table of identifiers is full.
#[cold]
fn unprepared_message(id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) {
    let group = cx.bus.sender_group(id, frame.data());
    cx.emit_j1939(frame, id, EventKind::J1939Message(build_message(id, frame, group)));
}

fn pass_values_to_device(slot: usize, id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) {
    if cx.bus.routes.slot(slot).is_none_or(|slot| slot.plan.is_none()) {
        return;
    }
    let Some(concerned) = cx.bus.nodes.concerned_device(id) else { return };
    let Some(spec) = concerned.message_spec() else { return };
    let direction: PdoDirection = spec.direction.into();
    on_values(slot, (&message_carrier(spec), direction), concerned.node, frame, cx);
}

/// Stores values of the message that decide how the rest of it is decoded.
fn store_deciding_values(bus: &mut Bus, concerned: &ConcernedDevice, frame: &Frame) {
    let Some(spec) = concerned.message_spec() else { return };
    let mut resolver = EntryResolver::new(&concerned.device.dictionary, &NoValues);
    let Some(layout) = layout_of_profile(&spec.fields, LayoutOrigin::Profile, false, &mut resolver) else {
        return;
    };
    for field in &layout.fields {
        let decides = field.object().filter(|object| concerned.device.decides_meaning(*object));
        let (Some(object), Some(raw)) = (decides, field.extract_bits(frame.data())) else { continue };
        let length = usize::from(field.bits.div_ceil(8));
        let bytes = raw.to_le_bytes();
        let origin = StoredOrigin { kind: OriginKind::Pdo, frame: frame.number, time: frame.time };
        let Some(node) = bus.nodes.node_mut(concerned.node) else { return };
        // If the store is full, the value is ignored: no real profile lists that many objects.
        let _ = Arc::make_mut(&mut node.store).set(object, bytes.get(..length).unwrap_or(&bytes), origin);
    }
}

fn message_carrier(spec: &MessageSpec) -> ValueCarrier {
    ValueCarrier::Message(spec.name.as_str().into())
}

/// Max interval of a message, if the profile gives one.
fn message_cadence(concerned: &ConcernedDevice, id: J1939Id) -> Option<Cadence> {
    let spec = concerned.message_spec()?;
    let carrier = message_carrier(spec);
    let name = carrier_name(&carrier)?;
    Some(Cadence::new(concerned.node, Arc::clone(name), spec.title_of(id.pgn), spec.timeout?, id))
}

fn build_message(id: J1939Id, frame: &Frame, group: SenderGroup) -> J1939Message {
    J1939Message {
        id,
        can_id: frame.id,
        name: group.name,
        length: frame.length,
        bytes: frame.bytes,
        layout: group.layout,
    }
}

/// Whether a frame is the second one of a fast packet. Bits 7..5 of byte 0 are the sequence, bits 4..0 the
/// number of the frame; byte 1 of the first frame is the length.
#[inline]
fn is_second_frame(before: &[u8], now: &[u8]) -> bool {
    const LONGEST: u8 = 223;
    const NUMBER: u8 = 0x1F;
    match (before, now) {
        ([first, 9..=LONGEST, ..], [second, ..]) => first & NUMBER == 0 && *second == *first | 1,
        _ => false,
    }
}

/// All bits if a message that [`LastPayload`] cannot compare differs from the previous one; `None` if it is equal.
fn changed_bits(message: &J1939Message, frame: &Frame) -> Option<u64> {
    (message.length != frame.length || message.payload() != frame.data()).then_some(u64::MAX)
}

/// Payload bits that the session needs; `None` if it needs each message.
fn needed_bits(
    id: J1939Id,
    plan: Option<&WatchPlan>,
    cadence: Option<&Cadence>,
    is_nmea2000: bool,
) -> Option<u64> {
    // Trouble codes and addresses are decoded from each message. A frame on data page 1 may be part of a fast packet.
    let is_followed = matches!(id.pgn, Pgn::DM1 | Pgn::DM2 | Pgn::COMMANDED_ADDRESS) || cadence.is_some();
    let may_be_packet = id.pgn.number() > LAST_OF_PAGE_0;
    if is_followed || may_be_packet && !is_nmea2000 {
        return None;
    }
    if may_be_packet { Some(u64::MAX) } else { plan.map_or(Some(0), WatchPlan::needed_bits) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_frame_of_a_fast_packet() {
        // 26 bytes (1A) in frames 60, 61, 62, 63: sequence 3.
        let first = [0x60, 0x1A, 0, 0xB7, 6, 0x67, 0x0D, 0x0B];
        assert!(is_second_frame(&first, &[0x61, 1, 2, 3, 4, 5, 6, 7]));
        assert!(!is_second_frame(&first, &[0x62, 1, 2, 3, 4, 5, 6, 7]), "one lost");
        assert!(!is_second_frame(&first, &[0x81, 1, 2, 3, 4, 5, 6, 7]), "another sequence");
        assert!(!is_second_frame(&[0x60, 8, 0, 0, 0, 0, 0, 0], &[0x61; 8]), "would fit one frame");
        assert!(!is_second_frame(&[], &[]));
    }
}
