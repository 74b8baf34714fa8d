//! Messages of one frame: the hot path. One prepared event an identifier is updated in place and lent to the
//! observer, as with PDOs.

use std::sync::Arc;

use super::cadence::{Cadence, carrier_name};
use crate::event::{EventKind, FrameRange, J1939Message};
use crate::frame::{CanId, Frame, FrameFlags};
use crate::profile::device::{Direction, MessageSpec};
use crate::profile::{Carrier, Device, Layout, NothingKnown, PdoDirection, Resolver, isobus, pgn_name};
use crate::session::canopen::layout_of_profile;
use crate::session::device::{Plan, Planned, Recent};
use crate::session::store::{Origin, OriginKind};
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::j1939::{ALL, J1939Id, Pgn};

/// Last group of data page 0; those of NMEA 2000 lie above.
const LAST_OF_PAGE_0: u32 = 0xFFFF;

/// Bytes of a message that needs no transport protocol.
const FRAME_BYTES: usize = 8;

/// A device that a message is from or for, and what its profile says of it.
struct Concerned {
    node: NodeId,
    device: Arc<Device>,
    /// Place in the device's list.
    place: usize,
}

impl Concerned {
    fn spec(&self) -> Option<&MessageSpec> {
        self.device.messages.get(self.place)
    }
}

/// What is known of a group from an address: its name and what its bits mean.
pub(in crate::session) struct Group {
    pub(in crate::session) name: Option<Arc<str>>,
    pub(in crate::session) layout: Option<Arc<Layout>>,
}

impl Bus {
    #[inline]
    pub(super) fn on_j1939_message(
        &mut self,
        slot: Option<usize>,
        id: J1939Id,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        if frame.flags.contains(FrameFlags::REMOTE) {
            return self.undecoded(frame, None, out);
        }
        let Some(slot) = slot else { return self.unprepared_message(id, frame, out) };
        self.clock.saw_periodic();
        let believed = self.j1939.is_believed();
        let Some(entry) = self.routes.slot_mut(slot) else { return };
        let Some(event) = &mut entry.prepared else { return self.first_message(slot, id, frame, out) };
        let EventKind::J1939Message(message) = &mut event.kind else { return };
        let continues = id.pgn.number() > LAST_OF_PAGE_0 && continues(message.payload(), frame.data());
        let change = difference(message, frame);
        if let (Some(change), Some(planned)) = (change, &entry.plan)
            && change & planned.plan.deciding != 0
        {
            // The message itself decides how it is read.
            return self.first_message(slot, id, frame, out);
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
                planned.recent.push(frame.number, self.clock.now());
            }
        }
        let watched = entry.cadence.is_some();
        if watched {
            self.message_came(slot, frame, out);
        }
        if let Some(event) = self.routes.slot(slot).and_then(|entry| entry.prepared.as_deref()) {
            out.event(event, self);
        }
        if matters {
            self.device_saw_message(slot, id, frame, out);
        }
        if continues {
            self.say_fast_packets(frame, out);
        }
    }

    /// NMEA 2000 sends longer messages in frames of its own making; which groups do is not told on the bus.
    #[cold]
    fn say_fast_packets(&mut self, frame: &Frame, out: &mut dyn Observer) {
        if !std::mem::replace(&mut self.said.fast_packets, true) {
            let text = "this looks like NMEA 2000: fast packets are not put together, their frames are shown as they are";
            self.note(frame, text.into(), out);
        }
    }

    /// The first message of an identifier, and those that change how it is read.
    #[cold]
    fn first_message(&mut self, slot: usize, id: J1939Id, frame: &Frame, out: &mut dyn Observer) {
        let concerned = self.concerned(id);
        if let Some(concerned) = &concerned {
            self.sample_deciding(concerned, frame);
        }
        let group = self.group_with(id, usize::from(frame.length), concerned.as_ref());
        let plan = concerned.as_ref().zip(group.layout.as_deref()).and_then(|(concerned, layout)| {
            let spec = concerned.spec()?;
            Plan::of(&concerned.device, &carrier(spec), spec.direction.into(), layout)
        });
        let mut event = self.j1939_event(frame, id, EventKind::J1939Message(message(id, frame, group)));
        let now = self.clock.now();
        if let Some(entry) = self.routes.slot_mut(slot) {
            event.routine = false;
            let before = entry.plan.take();
            entry.prepared = Some(Box::new(event));
            entry.plan = plan.map(|plan| {
                let mut recent = before.map_or(Recent::default(), |before| before.recent);
                recent.push(frame.number, now);
                Box::new(Planned { plan: Arc::new(plan), recent })
            });
        }
        self.watch_message(slot, concerned.and_then(|concerned| cadence(&concerned, id)));
        self.message_came(slot, frame, out);
        if let Some(event) = self.routes.slot(slot).and_then(|entry| entry.prepared.as_deref()) {
            out.event(event, self);
        }
        self.device_saw_message(slot, id, frame, out);
    }

    /// A message of an identifier that is not kept apart: too many were seen.
    #[cold]
    fn unprepared_message(&mut self, id: J1939Id, frame: &Frame, out: &mut dyn Observer) {
        let group = self.group(id, usize::from(frame.length));
        self.emit_j1939(frame, id, EventKind::J1939Message(message(id, frame, group)), out);
    }

    fn device_saw_message(&mut self, slot: usize, id: J1939Id, frame: &Frame, out: &mut dyn Observer) {
        if self.routes.slot(slot).is_none_or(|slot| slot.plan.is_none()) {
            return;
        }
        let Some(concerned) = self.concerned(id) else { return };
        let Some(spec) = concerned.spec() else { return };
        let direction: PdoDirection = spec.direction.into();
        self.device_saw(slot, (&carrier(spec), direction), concerned.node, frame, out);
    }

    /// Values within the message that decide how the rest of it is read.
    fn sample_deciding(&mut self, concerned: &Concerned, frame: &Frame) {
        let Some(spec) = concerned.spec() else { return };
        let mut resolver = Resolver::new(&concerned.device.dictionary, &NothingKnown);
        let Some(layout) = layout_of_profile(&spec.fields, "profile", false, &mut resolver) else { return };
        for field in &layout.fields {
            let decides = field.object().filter(|object| concerned.device.decides(*object));
            let (Some(object), Some(raw)) = (decides, field.extract(frame.data())) else { continue };
            let length = usize::from(field.bits.div_ceil(8));
            let bytes = raw.to_le_bytes();
            let origin = Origin { kind: OriginKind::Pdo, frame: frame.number, time: frame.time };
            let Some(node) = self.node_mut(concerned.node) else { return };
            // More objects than a node can have are a profile no person wrote.
            let _ = Arc::make_mut(&mut node.store).set(object, bytes.get(..length).unwrap_or(&bytes), origin);
        }
    }

    /// The device whose profile knows a message: the sender's, else that of a node it is for.
    fn concerned(&self, id: J1939Id) -> Option<Concerned> {
        let find = |node: NodeId, direction: Direction| {
            let address = node.j1939()?;
            let known = self.node(node).filter(|known| known.assigned.is_some())?;
            let mut messages = known.device.messages.iter();
            let place =
                messages.position(|spec| spec.direction == direction && spec.concerns(id.pgn, address))?;
            Some(Concerned { node, device: Arc::clone(&known.device), place })
        };
        if let Some(sender) = find(NodeId::J1939(id.source), Direction::Transmit) {
            return Some(sender);
        }
        if id.destination != ALL {
            return find(NodeId::J1939(id.destination), Direction::Receive);
        }
        let assigned = self.nodes.iter().filter(|node| node.assigned.is_some());
        assigned.map(|node| node.id).find_map(|node| find(node, Direction::Receive))
    }

    /// What is known of a group from an address, for a payload of so many bytes.
    pub(in crate::session) fn group(&self, id: J1939Id, length: usize) -> Group {
        self.group_with(id, length, self.concerned(id).as_ref())
    }

    fn group_with(&self, id: J1939Id, length: usize, concerned: Option<&Concerned>) -> Group {
        let of_device = concerned.and_then(|concerned| {
            let spec = concerned.spec()?;
            let node = self.node(concerned.node)?;
            let mut resolver = node.resolver();
            let mut layout = layout_of_profile(&spec.fields, "profile", false, &mut resolver)?;
            layout.depends = resolver.looked_at;
            Some((spec.title_of(id.pgn), layout))
        });
        if let Some((name, layout)) = of_device {
            return Group { name: Some(name.into()), layout: Some(Arc::new(layout)) };
        }
        if let Some(group) = self.of_database(id.pgn, length) {
            return group;
        }
        let (name, layout) = match of_standard(id.pgn) {
            Some((name, layout)) => (Some(name), Some(Arc::new(layout))),
            None => (pgn_name(id.pgn), None),
        };
        Group { name: name.map(Into::into), layout }
    }

    /// What the user's databases tell of a group. A message longer than a frame is not laid over a single one: that
    /// is a part of it, or something else.
    fn of_database(&self, pgn: Pgn, length: usize) -> Option<Group> {
        let message = self.database.message(pgn)?;
        let is_long = message.length.is_none_or(|length| usize::from(length) > FRAME_BYTES);
        let layout = (length > FRAME_BYTES || !is_long).then(|| Arc::clone(&message.layout));
        Some(Group { name: Some(message.name.as_str().into()), layout })
    }

    /// What a J1939 identifier means: `FE30 AVC valve 0 of F1`, `EA00 request, F1 to 80`.
    pub(in crate::session) fn describe_group(&self, id: CanId) -> String {
        let CanId::Extended(id) = id else { return String::new() };
        let Some(id) = J1939Id::of(id) else { return String::new() };
        let name = self.group(id, FRAME_BYTES).name.map_or(String::new(), |name| format!(" {name}"));
        let ends = match (id.pgn.is_addressed(), id.destination) {
            (false, _) => format!(" of {:02X}", id.source),
            (true, ALL) => format!(", {:02X} to all", id.source),
            (true, destination) => format!(", {:02X} to {destination:02X}", id.source),
        };
        format!("{:04X}{name}{ends}", id.pgn.number())
    }

    /// Name of a group, whoever sends it.
    pub(in crate::session) fn group_name(&self, pgn: Pgn) -> Option<Arc<str>> {
        let own = self.database.message(pgn).map(|message| message.name.as_str().into());
        own.or_else(|| pgn_name(pgn).map(Into::into))
    }
}

/// What ISO 11783 says of a group.
fn of_standard(pgn: Pgn) -> Option<(String, Layout)> {
    let standard = isobus();
    let spec = standard.messages.iter().find(|spec| spec.number_of(pgn).is_some())?;
    let mut resolver = Resolver::new(&standard.dictionary, &NothingKnown);
    let layout = layout_of_profile(&spec.fields, "standard", false, &mut resolver)?;
    Some((spec.title_of(pgn), layout))
}

fn carrier(spec: &MessageSpec) -> Carrier {
    Carrier::Message(spec.name.as_str().into())
}

/// How often a message must come, where the profile says it.
fn cadence(concerned: &Concerned, id: J1939Id) -> Option<Cadence> {
    let spec = concerned.spec()?;
    let carrier = carrier(spec);
    let name = carrier_name(&carrier)?;
    Some(Cadence::new(concerned.node, Arc::clone(name), spec.title_of(id.pgn), spec.timeout?, id))
}

fn message(id: J1939Id, frame: &Frame, group: Group) -> J1939Message {
    J1939Message {
        id,
        can_id: frame.id,
        name: group.name,
        length: frame.length,
        bytes: frame.bytes,
        layout: group.layout,
    }
}

/// Whether a frame is the second of a fast packet that the one before began: the same sequence in the upper
/// three bits of byte 0, the frame's number in the lower five; the first one tells the length in byte 1.
#[inline]
fn continues(before: &[u8], now: &[u8]) -> bool {
    const LONGEST: u8 = 223;
    const NUMBER: u8 = 0x1F;
    match (before, now) {
        ([first, 9..=LONGEST, ..], [second, ..]) => first & NUMBER == 0 && *second == *first | 1,
        _ => false,
    }
}

/// The bits in which a frame differs from the one before, all for another length; `None` if it repeats it.
#[inline]
fn difference(message: &J1939Message, frame: &Frame) -> Option<u64> {
    if message.length != frame.length {
        return Some(u64::MAX);
    }
    match (message.bytes.first_chunk(), frame.bytes.first_chunk()) {
        (Some(before), Some(now)) if frame.length <= 8 => {
            let unused = 64 - 8 * u32::from(frame.length);
            let difference = u64::from_le_bytes(*before) ^ u64::from_le_bytes(*now);
            let difference = difference & u64::MAX.checked_shr(unused).unwrap_or(0);
            (difference != 0).then_some(difference)
        }
        _ => (message.payload() != frame.data()).then_some(u64::MAX),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_frame_of_a_fast_packet() {
        // 26 bytes (1A) in frames 60, 61, 62, 63: sequence 3.
        let first = [0x60, 0x1A, 0, 0xB7, 6, 0x67, 0x0D, 0x0B];
        assert!(continues(&first, &[0x61, 1, 2, 3, 4, 5, 6, 7]));
        assert!(!continues(&first, &[0x62, 1, 2, 3, 4, 5, 6, 7]), "one lost");
        assert!(!continues(&first, &[0x81, 1, 2, 3, 4, 5, 6, 7]), "another sequence");
        assert!(!continues(&[0x60, 8, 0, 0, 0, 0, 0, 0], &[0x61; 8]), "would fit one frame");
        assert!(!continues(&[], &[]));
    }
}
