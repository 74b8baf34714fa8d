//! Messages of more than eight bytes: many frames become one transfer.
//!
//! ```text
//! Bus::on_transport ─▶ wire::j1939::management, packet ─▶ Transports, Session ─▶ irregularities at once
//!                                                           Received: its packets └▶ j1939-transfer at its end
//! ```
//!
//! A size that is announced is never believed: memory grows with packets that came, up to
//! `TRANSFER_DATA_LIMIT` a transfer and `OPEN_DATA_LIMIT` in all; `TRANSPORT_LIMIT` transfers are open at once.

mod received;
mod session;
mod sessions;

pub(in crate::session) use sessions::Transports;

use session::{Ending, Odd, Opening, SHORTEST, Session, Step};
use sessions::{Due, Key};

use crate::event::{
    EventKind, Irregularity, IrregularityKind, J1939Transfer, Outcome, TransportAbort, TransportMode,
};
use crate::frame::{Frame, FrameFlags};
use crate::session::timers::Subject;
use crate::session::{Bus, Observer};
use crate::wire::Malformed;
use crate::wire::j1939::{
    ALL, ETP_SIZES, J1939Id, Management, PACKET_SIZE, Pgn, TP_SIZES, management, packet, packets_of,
};

/// A frame of a transport protocol: whose, and what it is called.
#[derive(Clone, Copy)]
struct Part<'a> {
    id: J1939Id,
    pgn: Option<Pgn>,
    message: &'static str,
    frame: &'a Frame,
}

impl Part<'_> {
    /// The transfer its sender sends.
    fn sent(&self) -> Key {
        let is_extended = is_extended(self.id.pgn);
        Key { source: self.id.source, destination: self.id.destination, is_extended }
    }

    /// The transfer its sender receives.
    fn received(&self) -> Key {
        let sent = self.sent();
        Key { source: sent.destination, destination: sent.source, ..sent }
    }
}

const fn is_extended(pgn: Pgn) -> bool {
    matches!(pgn, Pgn::ETP_CM | Pgn::ETP_DT)
}

impl Bus {
    /// A frame of a transport protocol; it makes no event by itself unless something is irregular.
    pub(super) fn on_transport(&mut self, id: J1939Id, frame: &Frame, out: &mut dyn Observer) {
        if frame.flags.contains(FrameFlags::REMOTE) {
            return self.undecoded(frame, None, out);
        }
        let is_extended = is_extended(id.pgn);
        if matches!(id.pgn, Pgn::TP_DT | Pgn::ETP_DT) {
            match packet(frame.data(), is_extended) {
                Ok((sequence, bytes)) => {
                    let message = if is_extended { "ETP.DT" } else { "TP.DT" };
                    self.on_packet(Part { id, pgn: None, message, frame }, sequence, &bytes, out);
                }
                Err(error) => self.malformed_j1939(id, error, "a data packet has eight bytes", frame, out),
            }
            return;
        }
        match management(frame.data(), is_extended) {
            Ok((message, pgn)) => {
                let name = message.name(is_extended);
                self.on_management(Part { id, pgn: Some(pgn), message: name, frame }, message, pgn, out);
            }
            Err(error) => {
                self.malformed_j1939(id, error, "connection management has eight bytes", frame, out);
            }
        }
    }

    fn on_management(&mut self, part: Part<'_>, message: Management, pgn: Pgn, out: &mut dyn Observer) {
        let now = self.clock.now();
        let is_extended = is_extended(part.id.pgn);
        let (frame, sent, received) = (part.frame, part.sent(), part.received());
        match message {
            Management::RequestToSend { size, packets } => {
                let mode = if is_extended { TransportMode::Extended } else { TransportMode::Connection };
                self.on_opening(part, Opening { mode, pgn, size, packets }, out);
            }
            Management::Announce { size, packets } => {
                let mode = TransportMode::Broadcast;
                self.on_opening(part, Opening { mode, pgn, size, packets }, out);
            }
            Management::ClearToSend { count, next } => {
                self.transport_step(part, received, |session| session.clear(count, next, frame, now), out);
            }
            Management::EndOfMessage { size } => {
                self.transport_step(part, received, |session| session.acknowledged(size, frame, now), out);
            }
            Management::PacketOffset { count, offset } => {
                self.transport_step(
                    part,
                    sent,
                    |session| session.packet_offset(count, offset, frame, now),
                    out,
                );
            }
            Management::Abort { reason } => {
                let by_sender = !self.has_transport(received, pgn);
                let key = if by_sender { sent } else { received };
                let abort = TransportAbort { reason, by_sender };
                self.transport_step(part, key, |session| session.aborted(abort, frame), out);
            }
            Management::Unknown => {
                self.contradicts(part, "unknown control byte of connection management", out);
            }
        }
    }

    /// A frame whose bytes are enough, and contradict the protocol or each other.
    fn contradicts(&self, part: Part<'_>, reason: &'static str, out: &mut dyn Observer) {
        let layer = if is_extended(part.id.pgn) { "etp.cm" } else { "tp.cm" };
        let error = Malformed { layer, offset: 0, needed: 0, available: part.frame.length };
        self.malformed_j1939(part.id, error, reason, part.frame, out);
    }

    /// Whether a transfer is open that can be about a group.
    fn has_transport(&self, key: Key, pgn: Pgn) -> bool {
        let open = self.transports.find(key).and_then(|place| self.transports.get(place));
        open.is_some_and(|session| session.pgn.is_none_or(|open| open == pgn))
    }

    /// A message about an open transfer.
    fn transport_step(
        &mut self,
        part: Part<'_>,
        key: Key,
        take: impl FnOnce(&mut Session) -> Step,
        out: &mut dyn Observer,
    ) {
        let place =
            self.transports.find(key).filter(|_| part.pgn.is_some_and(|pgn| self.has_transport(key, pgn)));
        let open = place.and_then(|place| Some((place, self.transports.get_mut(place)?)));
        let Some((place, session)) = open else {
            let odd = Odd::new(IrregularityKind::Unexpected, None, None);
            return self.say_odd(part, odd, out);
        };
        session.pgn = session.pgn.or(part.pgn);
        let step = take(session);
        let about = Part { pgn: session.pgn, ..part };
        self.after_transport(about, place, step, out);
    }

    /// The sender of a message asks for a connection, or announces a broadcast.
    fn on_opening(&mut self, part: Part<'_>, opening: Opening, out: &mut dyn Observer) {
        let now = self.clock.now();
        if let Some(reason) = contradiction(part.id, opening) {
            self.contradicts(part, reason, out);
        }
        let is_broadcast = opening.mode == TransportMode::Broadcast;
        if opening.packets == 0 || opening.size == 0 || is_broadcast != (part.id.destination == ALL) {
            // Nothing that follows could belong to it.
            return;
        }
        if let Some(place) = self.transports.find(part.sent()) {
            if let Some(session) = self.transports.get_mut(place)
                && session.is_asked_again(opening)
            {
                session.asked_again(part.frame, now);
                let odd = Odd::new(IrregularityKind::Retransmission, None, None);
                return self.say_odd(part, odd, out);
            }
            if let Some(session) = self.transports.close(place) {
                self.finish_transport(session, Ending::Superseded, part.frame, out);
            }
        }
        let session = Session::new(opening, part.id, part.frame, now);
        self.open_transport(part, session, out);
    }

    fn open_transport(&mut self, part: Part<'_>, session: Session, out: &mut dyn Observer) -> u16 {
        let (place, given_up) = self.transports.open(part.sent(), session);
        if let Some(given_up) = given_up {
            let kind = EventKind::Evicted { what: "J1939 transfer", count: 1 };
            self.emit_j1939(part.frame, given_up.id(), kind, out);
        }
        self.arm_transport(place);
        place
    }

    fn on_packet(&mut self, part: Part<'_>, sequence: u8, bytes: &[u8; 7], out: &mut dyn Observer) {
        let now = self.clock.now();
        let mut place = self.transports.find(part.sent());
        if let Some(open) = place
            && self.transports.get_mut(open).is_some_and(|session| session.begins_anew(sequence))
            && let Some(session) = self.transports.close(open)
        {
            self.finish_transport(session, Ending::Superseded, part.frame, out);
            place = None;
        }
        let place = match place {
            Some(place) => place,
            None if sequence == 0 => {
                let odd = Odd::new(IrregularityKind::Unexpected, Some(0), None);
                return self.say_odd(part, odd, out);
            }
            None => {
                let mode = match (is_extended(part.id.pgn), part.id.destination) {
                    (true, _) => TransportMode::Extended,
                    (false, ALL) => TransportMode::Broadcast,
                    (false, _) => TransportMode::Connection,
                };
                let session = Session::cut(mode, part.id, sequence, part.frame, now);
                self.open_transport(part, session, out)
            }
        };
        let Some(session) = self.transports.get_mut(place) else { return };
        let before = session.received.held();
        let step = session.packet(sequence, bytes, part.frame, now);
        let about = Part { pgn: session.pgn, ..part };
        if self.transports.grew(place, before) {
            let kind = EventKind::Evicted { what: "data of open J1939 transfers", count: 1 };
            self.emit_j1939(part.frame, part.id, kind, out);
        }
        self.after_transport(about, place, step, out);
    }

    /// Says what is irregular about a frame, and ends the transfer where the frame ends it.
    fn after_transport(&mut self, part: Part<'_>, place: u16, step: Step, out: &mut dyn Observer) {
        for odd in [step.late, step.odd].into_iter().flatten() {
            self.say_odd(part, odd, out);
        }
        match step.end {
            Some(ending) => {
                if let Some(session) = self.transports.close(place) {
                    self.finish_transport(session, ending, part.frame, out);
                }
            }
            None => self.arm_transport(place),
        }
    }

    fn say_odd(&self, part: Part<'_>, odd: Odd, out: &mut dyn Observer) {
        let irregularity = Irregularity {
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
        self.emit_j1939(part.frame, part.id, kind, out);
    }

    /// Sees to it that a transfer has an entry in the timer queue. It lies at the shortest time-out, so that a
    /// deadline that moves never lies before it.
    fn arm_transport(&mut self, place: u16) {
        if self.clock.runs()
            && let Some(deadline) = self.transports.queue(place)
        {
            let soonest = self.clock.now().saturating_add(SHORTEST);
            self.timers.add(deadline.min(soonest), Subject::Transport(place));
        }
    }

    /// The entry of a place in the timer queue came due.
    pub(in crate::session) fn transport_deadline(&mut self, place: u16, now: i64, out: &mut dyn Observer) {
        match self.transports.due(place, now) {
            Due::Nothing => {}
            Due::Later(deadline) => {
                let soonest = now.saturating_add(SHORTEST);
                self.timers.add(deadline.min(soonest), Subject::Transport(place));
            }
            Due::Over(session, deadline) => {
                let time = self.clock.stamp_of(deadline);
                let frame = Frame { number: session.frames.last, time, ..Frame::EMPTY };
                self.finish_transport(session, Ending::Timeout, &frame, out);
            }
        }
    }

    /// The capture ends: open transfers are unfinished.
    pub(in crate::session) fn finish_transports(&mut self, out: &mut dyn Observer) {
        let frame = Frame { number: self.last_frame, time: self.last_time, ..Frame::EMPTY };
        for session in self.transports.drain() {
            self.finish_transport(session, Ending::Unfinished, &frame, out);
        }
    }

    /// Emits a transfer. `frame` is the one that ended it.
    fn finish_transport(
        &mut self,
        session: Box<Session>,
        ending: Ending,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let (id, frames) = (session.id(), session.frames);
        let transfer = self.transport_event(session, ending);
        let mut event = self.j1939_event(frame, id, EventKind::J1939Transfer(Box::new(transfer)));
        event.frames = frames;
        out.event(&event, self);
        let EventKind::J1939Transfer(transfer) = event.kind else { return };
        // An answer the capture lacks makes the data no less whole.
        if !transfer.truncated && matches!(transfer.outcome, Outcome::Complete | Outcome::Timeout) {
            self.on_j1939_payload(id, &transfer.data, frames, frame, out);
        }
    }

    /// A transfer as an event; its data moves there.
    fn transport_event(&self, mut session: Box<Session>, ending: Ending) -> J1939Transfer {
        let is_whole = session.is_whole();
        let outcome = match ending {
            Ending::Last if is_whole => Outcome::Complete,
            // Of one without start nobody knows what its end should have been.
            Ending::Timeout | Ending::Superseded if session.cut_start => Outcome::Incomplete,
            Ending::Last => Outcome::Incomplete,
            Ending::Abort(_) => Outcome::Aborted,
            Ending::Timeout => Outcome::Timeout,
            Ending::Superseded => Outcome::Superseded,
            Ending::Unfinished => Outcome::Unfinished,
        };
        let data = session.received.take_data(session.announced);
        let has_all = is_whole && session.announced.is_some_and(|size| u32::try_from(data.len()) == Ok(size));
        let known = session.pgn.map(|_| self.group(session.id(), data.len()));
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
            missing: session.missing(),
            repeated: session.received.repeated(),
            spacing: session.spacing,
            data,
            truncated: !has_all,
            layout: layout.filter(|_| has_all),
            duration: session.duration(),
            outcome,
            timer: (outcome == Outcome::Timeout).then_some(session.timer),
            abort: match ending {
                Ending::Abort(abort) => Some(abort),
                _ => None,
            },
            cut_start: session.cut_start,
            cut_end: ending == Ending::Unfinished,
            frame_count: session.frame_count,
        }
    }
}

/// What the frame that opens a transfer says against the protocol or against itself.
fn contradiction(id: J1939Id, opening: Opening) -> Option<&'static str> {
    let Opening { mode, size, packets, .. } = opening;
    let is_broadcast = mode == TransportMode::Broadcast;
    let (smallest, largest) = if mode == TransportMode::Extended { ETP_SIZES } else { TP_SIZES };
    if is_broadcast && id.destination != ALL {
        return Some("a broadcast announced to one address");
    }
    if !is_broadcast && id.destination == ALL {
        return Some("a connection asked of all");
    }
    if packets == 0 {
        return Some("a message of no packets");
    }
    if size > packets.saturating_mul(PACKET_SIZE) {
        return Some("more bytes announced than the packets hold");
    }
    if packets > packets_of(size) {
        return Some("more packets announced than the bytes need");
    }
    (!(smallest..=largest).contains(&size)).then_some("a size the protocol does not have")
}
