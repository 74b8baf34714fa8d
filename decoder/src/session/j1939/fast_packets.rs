//! Fast packets of NMEA 2000: up to 223 bytes in several frames of one group.
//!
//! ```text
//! byte 0   bits 7..5 sequence counter of the packet, bits 4..0 number of the frame, from 0
//! byte 1   of frame 0: length of the packet; 6 bytes of data follow, 7 in each other frame
//! ```
//!
//! A frame does not show whether its group uses fast packets; `profiles/lookups/nmea2000.toml` lists them. A
//! missing, repeated or late frame makes the packet incomplete. Its later frames still belong to it, so that
//! each packet causes one event.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::event::{EventKind, EvictedState, FrameRange, J1939Transfer, SdoOutcome, TransportMode};
use crate::frame::{Frame, FrameFlags};
use crate::session::bus::Bus;
use crate::session::context::MachineContext;
use crate::session::limits::TRANSPORT_LIMIT;
use crate::session::machine::{ProtocolMachine, TimedMachine};
use crate::session::timers::DeadlineSubject;
use crate::wire::MalformedPayload;
use crate::wire::j1939::{FastFrame, J1939Id, Pgn, fast_frame, fast_frames_of};

/// Time in ns after which the next frame of a packet is late, as T1 of J1939-21 §5.10.2.4.
const NEXT_FRAME: i64 = 750_000_000;

/// Frames of a complete packet that confirm J1939: their numbers agree with the length.
const EVIDENCE_FRAMES: u32 = 3;

/// Sender, receiver, group and sequence counter.
type Key = (u8, u8, Pgn, u8);

/// State of one packet.
#[derive(Debug, Clone)]
struct FastPacketState {
    id: J1939Id,
    /// Length in bytes; `None` if frame 0 was not seen.
    announced: Option<u8>,
    /// One bit per frame number received.
    seen: u32,
    repeated: u32,
    /// Number of the next frame in order.
    next: u8,
    /// A frame was missing, repeated or late.
    is_broken: bool,
    /// The packet was emitted because a frame was late; later frames belong to no packet.
    is_over: bool,
    data: Vec<u8>,
    size: u64,
    frames: FrameRange,
    frame_count: u64,
    times: (Option<i64>, Option<i64>),
    deadline: i64,
}

impl FastPacketState {
    fn new(id: J1939Id, frame: &Frame) -> Self {
        let time = frame.time.map(|time| time.0);
        Self {
            id,
            announced: None,
            seen: 0,
            repeated: 0,
            next: 0,
            is_broken: false,
            is_over: false,
            data: Vec::new(),
            size: 0,
            frames: FrameRange::one(frame.number),
            frame_count: 0,
            times: (time, time),
            deadline: i64::MAX,
        }
    }

    /// Frames that the announced length needs.
    fn needed_frames(&self) -> Option<u32> {
        self.announced.map(fast_frames_of)
    }

    /// Applies a frame.
    fn take_frame(&mut self, part: FastFrame<'_>, frame: &Frame, now: i64) {
        self.frames.last = frame.number;
        self.frame_count = self.frame_count.saturating_add(1);
        self.times.1 = frame.time.map(|time| time.0).or(self.times.1);
        self.deadline = now.saturating_add(NEXT_FRAME);
        let bit = 1_u32.checked_shl(u32::from(part.number)).unwrap_or(0);
        if self.seen & bit != 0 {
            self.repeated = self.repeated.saturating_add(1);
            self.is_broken = true;
            return;
        }
        self.seen |= bit;
        if part.number == 0 {
            self.announced = Some(part.length);
        }
        self.is_broken |= part.number != self.next;
        self.next = part.number.saturating_add(1);
        let start = u64::from(part.number) * 7 - u64::from(part.number > 0);
        let rest = self.announced.map_or(u64::MAX, |length| u64::from(length).saturating_sub(start));
        let usable = part.data.get(..usize::try_from(rest).unwrap_or(usize::MAX)).unwrap_or(part.data);
        self.size = self.size.saturating_add(usable.len() as u64);
        // A frame that is too short leaves a gap, as a missing one does.
        self.is_broken |= (usable.len() as u64) < rest.min(u64::from(part.full));
        if self.data.len() as u64 == start {
            self.data.extend_from_slice(usable);
        }
    }

    /// Whether the last frame was received, also if earlier ones are missing.
    fn is_at_end(&self) -> bool {
        self.needed_frames().is_some_and(|needed| u32::from(self.next) >= needed)
    }

    fn is_complete(&self) -> bool {
        !self.is_broken && self.announced.is_some() && self.missing_frames() == 0
    }

    /// Frames that are missing; only gaps if the length is unknown.
    fn missing_frames(&self) -> u32 {
        let highest = u32::BITS - self.seen.leading_zeros();
        let needed = self.needed_frames().unwrap_or(highest);
        let usable = u32::MAX.checked_shr(u32::BITS.saturating_sub(needed)).unwrap_or(0);
        needed.saturating_sub((self.seen & usable).count_ones())
    }
}

/// Open packets of all senders.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct FastPackets {
    open: HashMap<Key, FastPacketState, FixedState>,
    /// Data of the last complete packet of each sender, receiver and group.
    last: HashMap<(u8, u8, Pgn), Vec<u8>, FixedState>,
    is_queued: bool,
}

impl ProtocolMachine for FastPackets {
    type Route<'a> = J1939Id;
    type Product = ();

    fn on_frame(&mut self, id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) {
        if frame.flags.contains(FrameFlags::REMOTE) {
            return cx.emit_undecoded(frame, None);
        }
        let part = match fast_frame(frame.data()) {
            Ok(part) => part,
            Err(error) => return emit_malformed(id, error, frame, cx),
        };
        let key = (id.source, id.destination, id.pgn, part.sequence);
        if part.number == 0 {
            self.end_before(key, frame, cx);
        }
        if self.open.get(&key).is_some_and(|packet| packet.is_over) {
            return cx.emit_undecoded(frame, None);
        }
        if !self.open.contains_key(&key) {
            self.make_room(frame, cx);
        }
        let now = cx.bus.clock.now();
        let packet = self.open.entry(key).or_insert_with(|| FastPacketState::new(id, frame));
        packet.take_frame(part, frame, now);
        if packet.is_at_end() {
            return self.end_packet(key, false, frame, cx);
        }
        self.arm_timer(cx);
    }

    fn on_silence(&mut self, delay: i64, _: &mut Bus) {
        for packet in self.open.values_mut() {
            packet.deadline = packet.deadline.saturating_add(delay);
        }
    }

    fn on_end(&mut self, cx: &mut MachineContext<'_>) {
        let frame = cx.last_frame();
        for key in self.in_order(|_| true) {
            self.end_packet(key, true, &frame, cx);
        }
    }

    fn memory_size(&self) -> usize {
        let open = self.open.values().map(|packet| packet.data.capacity()).sum::<usize>();
        self.open.capacity() * size_of::<(Key, FastPacketState)>()
            + open
            + self.last.capacity() * size_of::<((u8, u8, Pgn), Vec<u8>)>()
            + self.last.values().map(Vec::capacity).sum::<usize>()
    }
}

impl TimedMachine for FastPackets {
    type Deadline = ();

    /// Emits the packets whose next frame is late, and keeps them to recognise that frame.
    fn on_deadline(&mut self, (): (), now: i64, cx: &mut MachineContext<'_>) {
        self.is_queued = false;
        for key in self.in_order(|packet| packet.deadline < now) {
            let Some(packet) = self.open.get_mut(&key) else { continue };
            packet.is_over = true;
            let time = cx.bus.clock.stamp_of(packet.deadline);
            let frame = Frame { number: packet.frames.last, time, ..Frame::EMPTY };
            let packet = packet.clone();
            self.emit_packet(packet, false, &frame, cx);
        }
        self.arm_timer(cx);
    }
}

impl FastPackets {
    /// Keys of open packets in the order of their start.
    fn in_order(&self, is_chosen: impl Fn(&FastPacketState) -> bool) -> Vec<Key> {
        let chosen = self.open.iter().filter(|(_, packet)| !packet.is_over && is_chosen(packet));
        let mut keys: Vec<_> = chosen.map(|(key, packet)| (packet.frames.first, *key)).collect();
        keys.sort_unstable();
        keys.into_iter().map(|(_, key)| key).collect()
    }

    /// Ends packets that cannot continue because `key` begins: one with the same counter, and those of the
    /// same group whose start is not in the capture.
    fn end_before(&mut self, key: Key, frame: &Frame, cx: &mut MachineContext<'_>) {
        let (source, destination, pgn, sequence) = key;
        for number in 0..8 {
            let other = (source, destination, pgn, number);
            let ends = self.open.get(&other).is_some_and(|it| number == sequence || it.announced.is_none());
            if ends {
                self.end_packet(other, false, frame, cx);
            }
        }
    }

    /// Evicts the oldest packet if the table is full.
    fn make_room(&mut self, frame: &Frame, cx: &mut MachineContext<'_>) {
        if self.open.len() < TRANSPORT_LIMIT {
            return;
        }
        let oldest = self.open.iter().min_by_key(|(_, packet)| (!packet.is_over, packet.frames.first));
        let Some(packet) = oldest.map(|(key, _)| *key).and_then(|key| self.open.remove(&key)) else { return };
        if !packet.is_over {
            cx.emit_j1939(frame, packet.id, EventKind::Evicted { what: EvictedState::FastPacket, count: 1 });
        }
    }

    /// Removes a packet and emits it.
    fn end_packet(&mut self, key: Key, is_cut: bool, frame: &Frame, cx: &mut MachineContext<'_>) {
        if let Some(packet) = self.open.remove(&key).filter(|packet| !packet.is_over) {
            self.emit_packet(packet, is_cut, frame, cx);
        }
    }

    fn emit_packet(
        &mut self,
        packet: FastPacketState,
        is_cut: bool,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) {
        let (id, frames) = (packet.id, packet.frames);
        let is_complete = packet.is_complete();
        if is_complete {
            cx.bus.protocols.has_nmea2000 = true;
            if packet.seen.count_ones() >= EVIDENCE_FRAMES && !cx.bus.protocols.j1939.is_confirmed() {
                cx.bus.protocols.j1939.add_evidence();
            }
        }
        let repeats = is_complete && self.repeats_data(id, &packet.data);
        let transfer = packet_event(&cx.bus, packet, is_cut);
        let mut event = cx.j1939_event(frame, id, EventKind::J1939Transfer(Box::new(transfer)));
        event.frames = frames;
        event.routine = repeats;
        cx.send_event(&event);
    }

    /// Whether the data equal those of the previous packet of this sender and group.
    fn repeats_data(&mut self, id: J1939Id, data: &[u8]) -> bool {
        let key = (id.source, id.destination, id.pgn);
        let has_room = self.last.len() < TRANSPORT_LIMIT;
        match self.last.get_mut(&key) {
            Some(last) if last == data => true,
            Some(last) => {
                last.clear();
                last.extend_from_slice(data);
                false
            }
            None => {
                if has_room {
                    self.last.insert(key, data.to_vec());
                }
                false
            }
        }
    }

    /// Adds the earliest deadline to the timer queue, if no entry is there.
    fn arm_timer(&mut self, cx: &mut MachineContext<'_>) {
        if self.is_queued || !cx.bus.clock.has_timestamps() {
            return;
        }
        let open = self.open.values().filter(|packet| !packet.is_over);
        if let Some(deadline) = open.map(|packet| packet.deadline).min() {
            self.is_queued = true;
            cx.timers.add_deadline(deadline, DeadlineSubject::FastPackets);
        }
    }
}

fn emit_malformed(id: J1939Id, error: MalformedPayload, frame: &Frame, cx: &mut MachineContext<'_>) {
    let reason = if error.needed == 0 {
        "a fast packet has at most 223 bytes"
    } else {
        "a fast packet starts with counter and length"
    };
    cx.emit_malformed_j1939(id, error, reason, frame);
}

/// Event of a packet; the data moves to the event.
fn packet_event(bus: &Bus, packet: FastPacketState, is_cut: bool) -> J1939Transfer {
    let is_complete = packet.is_complete();
    let outcome = match (is_complete, is_cut && !packet.is_broken && packet.announced.is_some()) {
        (true, _) => SdoOutcome::Complete,
        (false, true) => SdoOutcome::Unfinished,
        (false, false) => SdoOutcome::Incomplete,
    };
    let group = bus.sender_group(packet.id, &packet.data);
    let duration = packet.times.1.zip(packet.times.0).map(|(last, first)| last.saturating_sub(first));
    J1939Transfer {
        mode: Some(TransportMode::FastPacket),
        pgn: Some(packet.id.pgn),
        name: group.name,
        priority: packet.id.priority,
        source: packet.id.source,
        destination: packet.id.destination,
        announced: packet.announced.map(u32::from),
        packets: packet.needed_frames(),
        size: packet.size,
        missing: packet.missing_frames(),
        repeated: packet.repeated,
        spacing: None,
        data: packet.data,
        truncated: !is_complete,
        layout: group.layout.filter(|_| is_complete),
        duration,
        outcome,
        timer: None,
        abort: None,
        cut_start: packet.announced.is_none(),
        cut_end: outcome == SdoOutcome::Unfinished,
        frame_count: packet.frame_count,
    }
}
