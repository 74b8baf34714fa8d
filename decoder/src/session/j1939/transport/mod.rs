//! Messages of more than eight bytes: combines frames to transfers.
//!
//! ```text
//! Transports::on_frame ─▶ wire::j1939::management, packet ─▶ Sessions, Session ─▶ irregularities at once
//!                                                  Received: packet data └▶ j1939-transfer at its end
//! ```
//!
//! Memory is not reserved for the announced size. It grows with the received packets, up to
//! `TRANSFER_DATA_LIMIT` per transfer and `OPEN_DATA_LIMIT` in total. At most `TRANSPORT_LIMIT` transfers
//! are open at once.

mod received;
mod session;
mod sessions;

use session::{
    SHORTEST, TransferStep, TransportEnding, TransportIrregularity, TransportOpening, TransportSession,
};
use sessions::{SessionKey, SessionTable, SessionTimeout};

use crate::event::{
    EventKind, EvictedState, IrregularityKind, J1939Transfer, SdoOutcome, TransferIrregularity,
    TransportAbort, TransportMode,
};
use crate::frame::{Frame, FrameFlags};
use crate::session::bus::Bus;
use crate::session::context::MachineContext;
use crate::session::j1939::payload::TransferPayload;
use crate::session::machine::{ProtocolMachine, TimedMachine};
use crate::session::timers::DeadlineSubject;
use crate::wire::MalformedPayload;
use crate::wire::j1939::{
    ALL, ConnectionManagement, ETP_SIZES, J1939Id, PACKET_SIZE, Pgn, TP_SIZES, packets_of, parse_management,
    parse_packet,
};

/// A frame of a transport protocol, with its parameter group and message name.
#[derive(Clone, Copy)]
struct TransportFrame<'a> {
    id: J1939Id,
    pgn: Option<Pgn>,
    message: &'static str,
    frame: &'a Frame,
}

impl TransportFrame<'_> {
    /// Transfer whose originator sent the frame.
    fn originated_key(&self) -> SessionKey {
        let is_extended = is_extended(self.id.pgn);
        SessionKey { source: self.id.source, destination: self.id.destination, is_extended }
    }

    /// Transfer whose responder sent the frame.
    fn answered_key(&self) -> SessionKey {
        let sent = self.originated_key();
        SessionKey { source: sent.destination, destination: sent.source, ..sent }
    }
}

const fn is_extended(pgn: Pgn) -> bool {
    matches!(pgn, Pgn::ETP_CM | Pgn::ETP_DT)
}

/// Multi-packet transfers of all addresses.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct TransportMachine {
    sessions: SessionTable,
}

impl ProtocolMachine for TransportMachine {
    type Route<'a> = J1939Id;
    /// Payload of the transfer that the frame ends.
    type Product = Option<TransferPayload>;

    /// Handles a transport frame; it causes an event only if it is irregular or ends a transfer.
    fn on_frame(&mut self, id: J1939Id, frame: &Frame, cx: &mut MachineContext<'_>) -> Self::Product {
        if frame.flags.contains(FrameFlags::REMOTE) {
            cx.emit_undecoded(frame, None);
            return None;
        }
        let is_extended = is_extended(id.pgn);
        if matches!(id.pgn, Pgn::TP_DT | Pgn::ETP_DT) {
            return match parse_packet(frame.data(), is_extended) {
                Ok((sequence, bytes)) => {
                    let message = if is_extended { "ETP.DT" } else { "TP.DT" };
                    self.on_packet(TransportFrame { id, pgn: None, message, frame }, sequence, &bytes, cx)
                }
                Err(error) => {
                    cx.emit_malformed_j1939(id, error, "a data packet has eight bytes", frame);
                    None
                }
            };
        }
        match parse_management(frame.data(), is_extended) {
            Ok((message, pgn)) => {
                let name = message.name(is_extended);
                self.on_management(
                    TransportFrame { id, pgn: Some(pgn), message: name, frame },
                    message,
                    pgn,
                    cx,
                )
            }
            Err(error) => {
                cx.emit_malformed_j1939(id, error, "connection management has eight bytes", frame);
                None
            }
        }
    }

    fn on_silence(&mut self, delay: i64, _: &mut Bus) {
        self.sessions.postpone_deadlines(delay);
    }

    /// Ends open transfers as unfinished.
    fn on_end(&mut self, cx: &mut MachineContext<'_>) {
        let frame = cx.last_frame();
        for session in self.sessions.drain_sessions() {
            emit_transfer(session, TransportEnding::Unfinished, &frame, cx);
        }
    }

    fn memory_size(&self) -> usize {
        self.sessions.footprint()
    }
}

impl TimedMachine for TransportMachine {
    /// Index of a session.
    type Deadline = u16;

    fn on_deadline(&mut self, place: u16, now: i64, cx: &mut MachineContext<'_>) -> Self::Product {
        match self.sessions.evaluate_timer(place, now) {
            SessionTimeout::Nothing => {}
            SessionTimeout::Later(deadline) => {
                let soonest = now.saturating_add(SHORTEST);
                cx.timers.add_deadline(deadline.min(soonest), DeadlineSubject::Transport(place));
            }
            SessionTimeout::Over(session, deadline) => {
                cx.bus.open_transfers.set_session(place, None);
                let time = cx.bus.clock.stamp_of(deadline);
                let frame = Frame { number: session.frames.last, time, ..Frame::EMPTY };
                return emit_transfer(session, TransportEnding::Timeout, &frame, cx);
            }
        }
        None
    }
}

impl TransportMachine {
    fn on_management(
        &mut self,
        part: TransportFrame<'_>,
        message: ConnectionManagement,
        pgn: Pgn,
        cx: &mut MachineContext<'_>,
    ) -> Option<TransferPayload> {
        let now = cx.bus.clock.now();
        let is_extended = is_extended(part.id.pgn);
        let (frame, sent, received) = (part.frame, part.originated_key(), part.answered_key());
        match message {
            ConnectionManagement::RequestToSend { size, packets } => {
                let mode = if is_extended { TransportMode::Extended } else { TransportMode::Connection };
                self.on_opening(part, TransportOpening { mode, pgn, size, packets }, cx);
                None
            }
            ConnectionManagement::Announce { size, packets } => {
                let mode = TransportMode::Broadcast;
                self.on_opening(part, TransportOpening { mode, pgn, size, packets }, cx);
                None
            }
            ConnectionManagement::ClearToSend { count, next } => self.transport_step(
                part,
                received,
                |session| session.on_clear_to_send(count, next, frame, now),
                cx,
            ),
            ConnectionManagement::EndOfMessage { size } => {
                self.transport_step(part, received, |session| session.on_acknowledged(size, frame, now), cx)
            }
            ConnectionManagement::PacketOffset { count, offset } => self.transport_step(
                part,
                sent,
                |session| session.packet_offset(count, offset, frame, now),
                cx,
            ),
            ConnectionManagement::Abort { reason } => {
                let by_sender = !self.has_transport(received, pgn);
                let key = if by_sender { sent } else { received };
                let abort = TransportAbort { reason, by_sender };
                self.transport_step(part, key, |session| session.on_aborted(abort, frame), cx)
            }
            ConnectionManagement::Unknown => {
                emit_contradiction(part, "unknown control byte of connection management", cx);
                None
            }
        }
    }

    /// Whether an open transfer may be about this group.
    fn has_transport(&self, key: SessionKey, pgn: Pgn) -> bool {
        let open = self.sessions.find_session(key).and_then(|place| self.sessions.get(place));
        open.is_some_and(|session| session.pgn.is_none_or(|open| open == pgn))
    }

    /// Applies a message to its open transfer.
    fn transport_step(
        &mut self,
        part: TransportFrame<'_>,
        key: SessionKey,
        take: impl FnOnce(&mut TransportSession) -> TransferStep,
        cx: &mut MachineContext<'_>,
    ) -> Option<TransferPayload> {
        let place = self
            .sessions
            .find_session(key)
            .filter(|_| part.pgn.is_some_and(|pgn| self.has_transport(key, pgn)));
        let open = place.and_then(|place| Some((place, self.sessions.get_mut(place)?)));
        let Some((place, session)) = open else {
            let odd = TransportIrregularity::new(IrregularityKind::Unexpected, None, None);
            emit_irregularity(part, odd, cx);
            return None;
        };
        session.pgn = session.pgn.or(part.pgn);
        let step = take(session);
        let about = TransportFrame { pgn: session.pgn, ..part };
        cx.bus.open_transfers.set_session(place, Some((key.source, session.pgn)));
        self.after_frame(about, place, step, cx)
    }

    /// Handles a request for a connection, or the announcement of a broadcast.
    fn on_opening(
        &mut self,
        part: TransportFrame<'_>,
        opening: TransportOpening,
        cx: &mut MachineContext<'_>,
    ) {
        let now = cx.bus.clock.now();
        if let Some(reason) = find_contradiction(part.id, opening) {
            emit_contradiction(part, reason, cx);
        }
        let is_broadcast = opening.mode == TransportMode::Broadcast;
        if opening.packets == 0 || opening.size == 0 || is_broadcast != (part.id.destination == ALL) {
            // No later frame can belong to it.
            return;
        }
        if let Some(place) = self.sessions.find_session(part.originated_key()) {
            if let Some(session) = self.sessions.get_mut(place)
                && session.is_asked_again(opening)
            {
                session.asked_again(part.frame, now);
                let odd = TransportIrregularity::new(IrregularityKind::Retransmission, None, None);
                return emit_irregularity(part, odd, cx);
            }
            self.close_session(place, TransportEnding::Superseded, part.frame, cx);
        }
        let session = TransportSession::new(opening, part.id, part.frame, now);
        self.open_session(part, session, cx);
    }

    fn open_session(
        &mut self,
        part: TransportFrame<'_>,
        session: TransportSession,
        cx: &mut MachineContext<'_>,
    ) -> u16 {
        let (key, pgn) = (part.originated_key(), session.pgn);
        let (place, evicted) = self.sessions.open_session(key, session);
        cx.bus.open_transfers.set_session(place, Some((key.source, pgn)));
        if let Some(evicted) = evicted {
            let kind = EventKind::Evicted { what: EvictedState::J1939Transfer, count: 1 };
            cx.emit_j1939(part.frame, evicted.id(), kind);
        }
        self.arm_timer(place, cx);
        place
    }

    /// Removes a transfer and emits it.
    fn close_session(
        &mut self,
        place: u16,
        ending: TransportEnding,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) -> Option<TransferPayload> {
        let session = self.sessions.close_session(place)?;
        cx.bus.open_transfers.set_session(place, None);
        emit_transfer(session, ending, frame, cx)
    }

    fn on_packet(
        &mut self,
        part: TransportFrame<'_>,
        sequence: u8,
        bytes: &[u8; 7],
        cx: &mut MachineContext<'_>,
    ) -> Option<TransferPayload> {
        let now = cx.bus.clock.now();
        let mut place = self.sessions.find_session(part.originated_key());
        if let Some(open) = place
            && self.sessions.get_mut(open).is_some_and(|session| session.restarts(sequence))
        {
            self.close_session(open, TransportEnding::Superseded, part.frame, cx);
            place = None;
        }
        let place = match place {
            Some(place) => place,
            None if sequence == 0 => {
                let odd = TransportIrregularity::new(IrregularityKind::Unexpected, Some(0), None);
                emit_irregularity(part, odd, cx);
                return None;
            }
            None => {
                let mode = match (is_extended(part.id.pgn), part.id.destination) {
                    (true, _) => TransportMode::Extended,
                    (false, ALL) => TransportMode::Broadcast,
                    (false, _) => TransportMode::Connection,
                };
                let session = TransportSession::without_start(mode, part.id, sequence, part.frame, now);
                self.open_session(part, session, cx)
            }
        };
        let session = self.sessions.get_mut(place)?;
        let before = session.received.held_bytes();
        let step = session.on_packet(sequence, bytes, part.frame, now);
        let about = TransportFrame { pgn: session.pgn, ..part };
        if self.sessions.update_size(place, before) {
            let kind = EventKind::Evicted { what: EvictedState::J1939Data, count: 1 };
            cx.emit_j1939(part.frame, part.id, kind);
        }
        self.after_frame(about, place, step, cx)
    }

    /// Reports irregularities of a frame, and ends the transfer if the frame is its last.
    fn after_frame(
        &mut self,
        part: TransportFrame<'_>,
        place: u16,
        step: TransferStep,
        cx: &mut MachineContext<'_>,
    ) -> Option<TransferPayload> {
        for odd in [step.late, step.odd].into_iter().flatten() {
            emit_irregularity(part, odd, cx);
        }
        if let Some(ending) = step.end {
            return self.close_session(place, ending, part.frame, cx);
        }
        self.arm_timer(place, cx);
        None
    }

    /// Ensures that a transfer has an entry in the timer queue. The entry uses the shortest timeout, so that
    /// it is never later than a moved deadline.
    fn arm_timer(&mut self, place: u16, cx: &mut MachineContext<'_>) {
        if cx.bus.clock.has_timestamps()
            && let Some(deadline) = self.sessions.queue_deadline(place)
        {
            let soonest = cx.bus.clock.now().saturating_add(SHORTEST);
            cx.timers.add_deadline(deadline.min(soonest), DeadlineSubject::Transport(place));
        }
    }
}

/// Reports a frame that is long enough but contradicts the protocol or itself.
fn emit_contradiction(part: TransportFrame<'_>, reason: &'static str, cx: &mut MachineContext<'_>) {
    let layer = if is_extended(part.id.pgn) { "etp.cm" } else { "tp.cm" };
    let error = MalformedPayload { layer, offset: 0, needed: 0, available: part.frame.length };
    cx.emit_malformed_j1939(part.id, error, reason, part.frame);
}

fn emit_irregularity(part: TransportFrame<'_>, odd: TransportIrregularity, cx: &mut MachineContext<'_>) {
    let irregularity = TransferIrregularity {
        what: odd.what,
        message: part.message,
        pgn: part.pgn,
        source: Some(part.id.source),
        destination: Some(part.id.destination),
        packet: odd.packet,
        expected: odd.expected,
        timer: odd.late.map(|(timer, _)| timer),
        delay: odd.late.map(|(_, delay)| delay),
    };
    let kind = EventKind::TransportIrregularity(Box::new(irregularity));
    cx.emit_j1939(part.frame, part.id, kind);
}

/// Emits a transfer; returns its payload if complete. `frame` is the last one of the transfer.
fn emit_transfer(
    session: Box<TransportSession>,
    ending: TransportEnding,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) -> Option<TransferPayload> {
    let (id, frames) = (session.id(), session.frames);
    let transfer = transfer_event(&cx.bus, session, ending);
    let mut event = cx.j1939_event(frame, id, EventKind::J1939Transfer(Box::new(transfer)));
    event.frames = frames;
    cx.send_event(&event);
    let EventKind::J1939Transfer(transfer) = event.kind else { return None };
    // The data is also complete if only a response is missing in the capture.
    let is_whole =
        !transfer.truncated && matches!(transfer.outcome, SdoOutcome::Complete | SdoOutcome::Timeout);
    is_whole.then_some(TransferPayload { id, data: transfer.data, frames, frame: *frame })
}

/// Event of a transfer; the data moves to the event.
fn transfer_event(bus: &Bus, mut session: Box<TransportSession>, ending: TransportEnding) -> J1939Transfer {
    let is_whole = session.is_whole();
    let outcome = match ending {
        TransportEnding::Last if is_whole => SdoOutcome::Complete,
        // Without the start, the expected end is unknown.
        TransportEnding::Timeout | TransportEnding::Superseded if session.cut_start => SdoOutcome::Incomplete,
        TransportEnding::Last => SdoOutcome::Incomplete,
        TransportEnding::Abort(_) => SdoOutcome::Aborted,
        TransportEnding::Timeout => SdoOutcome::Timeout,
        TransportEnding::Superseded => SdoOutcome::Superseded,
        TransportEnding::Unfinished => SdoOutcome::Unfinished,
    };
    let data = session.received.take_data(session.announced);
    let has_all = is_whole && session.announced.is_some_and(|size| u32::try_from(data.len()) == Ok(size));
    let known = session.pgn.map(|_| bus.sender_group(session.id(), &data));
    let (name, layout) = known.map_or((None, None), |group| (group.name, group.layout));
    J1939Transfer {
        mode: Some(session.mode),
        pgn: session.pgn,
        name,
        priority: session.id().priority,
        source: session.id().source,
        destination: session.id().destination,
        announced: session.announced,
        packets: session.packets,
        size: session.received.size(),
        missing: session.missing_packets(),
        repeated: session.received.repeated_count(),
        spacing: session.spacing,
        data,
        truncated: !has_all,
        layout: layout.filter(|_| has_all),
        duration: session.duration(),
        outcome,
        timer: (outcome == SdoOutcome::Timeout).then_some(session.timer),
        abort: match ending {
            TransportEnding::Abort(abort) => Some(abort),
            _ => None,
        },
        cut_start: session.cut_start,
        cut_end: ending == TransportEnding::Unfinished,
        frame_count: session.frame_count,
    }
}

/// Contradiction of an opening frame to the protocol or to itself.
fn find_contradiction(id: J1939Id, opening: TransportOpening) -> Option<&'static str> {
    let TransportOpening { mode, size, packets, .. } = opening;
    let is_broadcast = mode == TransportMode::Broadcast;
    let (smallest, largest) = if mode == TransportMode::Extended { ETP_SIZES } else { TP_SIZES };
    if is_broadcast && id.destination != ALL {
        return Some("a broadcast announced to one address");
    }
    if !is_broadcast && id.destination == ALL {
        return Some("a connection request to all addresses");
    }
    if packets == 0 {
        return Some("a message without packets");
    }
    if size > packets.saturating_mul(PACKET_SIZE) {
        return Some("announced size exceeds the announced packets");
    }
    if packets > packets_of(size) {
        return Some("more packets announced than the size needs");
    }
    (!(smallest..=largest).contains(&size)).then_some("message size outside the range of the protocol")
}
