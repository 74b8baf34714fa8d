//! One transfer of several packets, from its first frame to its last.
//!
//! ```text
//! sender    BAM ─ DT DT … DT                                           T1 between packets, whole at the last one
//! sender    RTS ─────── DT DT … ──────── DT DT … ───────── (T3)
//! receiver      CTS n,k          CTS n,k           EOMA, CTS 0 holds
//!           Tr, T3   T2, T1 …   Tr, T3   T2, T1 …  Tr, T3      Th, T4
//! extended  RTS, CTS, then DPO before the packets of each window
//! ```
//!
//! Tr and Th are told when the answer comes at last; T1 to T4 end the transfer (J1939-21 §5.10.2.4). While no
//! clear to send was seen, one side may be missing in the capture: then any packet is taken, and T3 runs.

use super::received::Received;
use crate::event::{FrameRange, IrregularityKind, Timer, TransportAbort, TransportMode};
use crate::frame::Frame;
use crate::wire::j1939::{J1939Id, PACKET_SIZE, Pgn, packets_of};

const MILLISECOND: i64 = 1_000_000;

/// Nanoseconds of the shortest time-out that ends a transfer.
pub(super) const SHORTEST: i64 = limit(Timer::T1);

/// Nanoseconds of a time-out (J1939-21 §5.10.2.4).
const fn limit(timer: Timer) -> i64 {
    let milliseconds = match timer {
        Timer::Tr => 200,
        Timer::Th => 500,
        Timer::T1 => 750,
        Timer::T2 | Timer::T3 => 1_250,
        Timer::T4 => 1_050,
        Timer::NBs | Timer::NCr => 1_000,
    };
    milliseconds * MILLISECOND
}

/// How a transfer ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ending {
    /// It came to its end.
    Last,
    /// By an abort.
    Abort(TransportAbort),
    /// By the time-out that runs.
    Timeout,
    /// Another one began in its place.
    Superseded,
    /// The capture ended.
    Unfinished,
}

/// Something irregular about a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Odd {
    pub(super) what: IrregularityKind,
    pub(super) packet: Option<u32>,
    pub(super) expected: Option<u32>,
    /// The time-out that passed, and the nanoseconds it took.
    pub(super) late: Option<(Timer, i64)>,
}

impl Odd {
    pub(super) const fn new(what: IrregularityKind, packet: Option<u32>, expected: Option<u32>) -> Self {
        Self { what, packet, expected, late: None }
    }
}

/// What a frame comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Step {
    pub(super) late: Option<Odd>,
    pub(super) odd: Option<Odd>,
    pub(super) end: Option<Ending>,
}

/// What the frame that opens a transfer says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Opening {
    pub(super) mode: TransportMode,
    pub(super) pgn: Pgn,
    pub(super) size: u32,
    pub(super) packets: u32,
}

/// Which packets the sender may send now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Window {
    /// Any: a broadcast, or no clear to send was seen.
    Any,
    /// Up to this one.
    To(u32),
    /// None: the connection is held.
    Held,
}

/// One transfer.
#[derive(Debug, Clone)]
pub(super) struct Session {
    pub(super) mode: TransportMode,
    pub(super) pgn: Option<Pgn>,
    priority: u8,
    source: u8,
    destination: u8,
    pub(super) announced: Option<u32>,
    pub(super) packets: Option<u32>,
    pub(super) received: Received,
    window: Window,
    /// Packet that comes next in order.
    due: u32,
    /// First packet the receiver asked for last.
    asked: Option<u32>,
    /// Packets before sequence number 1.
    offset: u32,
    /// A clear to send of the extended protocol waits for its packet offset.
    lacks_offset: bool,
    pub(super) cut_start: bool,
    pub(super) frames: FrameRange,
    pub(super) frame_count: u64,
    times: (Option<i64>, Option<i64>),
    /// Of a broadcast, shortest and longest time between frames that follow each other.
    pub(super) spacing: Option<(i64, i64)>,
    /// The time-out that ends it, and since when it runs in monotonic nanoseconds.
    pub(super) timer: Timer,
    since: i64,
    /// The time-out after which an answer of the receiver is late.
    late: Option<Timer>,
}

impl Session {
    /// A transfer that `frame` opens.
    pub(super) fn new(opening: Opening, id: J1939Id, frame: &Frame, now: i64) -> Self {
        let mut session = Self::bare(opening.mode, id, 1, frame, now);
        session.pgn = Some(opening.pgn);
        (session.announced, session.packets) = (Some(opening.size), Some(opening.packets));
        if opening.mode != TransportMode::Broadcast {
            session.wait(Timer::T3, Some(Timer::Tr), now);
        }
        session
    }

    /// A transfer of which `frame`, a packet, is the first that was seen.
    pub(super) fn cut(mode: TransportMode, id: J1939Id, sequence: u8, frame: &Frame, now: i64) -> Self {
        let mut session = Self::bare(mode, id, u32::from(sequence), frame, now);
        session.cut_start = true;
        session
    }

    fn bare(mode: TransportMode, id: J1939Id, first: u32, frame: &Frame, now: i64) -> Self {
        let time = frame.time.map(|time| time.0);
        Self {
            mode,
            pgn: None,
            priority: id.priority,
            source: id.source,
            destination: id.destination,
            announced: None,
            packets: None,
            received: Received::new(first),
            window: Window::Any,
            due: first,
            asked: None,
            offset: 0,
            lacks_offset: false,
            cut_start: false,
            frames: FrameRange::one(frame.number),
            frame_count: 1,
            times: (time, time),
            spacing: None,
            timer: Timer::T1,
            since: now,
            late: None,
        }
    }

    /// What the identifier of the whole message would be.
    pub(super) fn id(&self) -> J1939Id {
        J1939Id {
            priority: self.priority,
            pgn: self.pgn.unwrap_or_default(),
            source: self.source,
            destination: self.destination,
        }
    }

    /// Nanoseconds from first to last frame.
    pub(super) fn duration(&self) -> Option<i64> {
        Some(self.times.1?.saturating_sub(self.times.0?))
    }

    /// Monotonic time at which it is given up.
    pub(super) fn deadline(&self) -> i64 {
        self.since.saturating_add(limit(self.timer))
    }

    /// All traffic stopped for so long: the time does not count.
    pub(super) fn postpone(&mut self, delay: i64) {
        self.since = self.since.saturating_add(delay);
    }

    /// Whether every packet was seen, and together they hold the message.
    pub(super) fn is_whole(&self) -> bool {
        let (Some(size), Some(packets)) = (self.announced, self.packets) else { return false };
        !self.cut_start && self.received.distinct() == packets && size <= packets.saturating_mul(PACKET_SIZE)
    }

    /// Packets that were not seen, as far as it is known how many there are.
    pub(super) fn missing(&self) -> u32 {
        match self.packets {
            Some(packets) => packets.saturating_sub(self.received.distinct()),
            None => self.received.gaps(),
        }
    }

    /// Whether `opening` is the request that opened it, sent again because no answer was heard.
    pub(super) fn is_asked_again(&self, opening: Opening) -> bool {
        let same = self.pgn == Some(opening.pgn) && self.announced == Some(opening.size);
        same && self.mode != TransportMode::Broadcast && self.received.distinct() == 0
    }

    /// The request came again: what was cleared is not any more.
    pub(super) fn asked_again(&mut self, frame: &Frame, now: i64) {
        self.add_frame(frame);
        (self.window, self.asked, self.lacks_offset) = (Window::Any, None, false);
        self.wait(Timer::T3, Some(Timer::Tr), now);
    }

    /// Another frame belongs to it.
    fn add_frame(&mut self, frame: &Frame) {
        if self.frames.last != frame.number {
            self.frames.last = frame.number;
            self.frame_count = self.frame_count.saturating_add(1);
            self.times.1 = frame.time.map(|time| time.0).or(self.times.1);
        }
    }

    fn wait(&mut self, timer: Timer, late: Option<Timer>, now: i64) {
        (self.timer, self.late, self.since) = (timer, late, now);
    }

    /// Whether the receiver's answer that comes now is late.
    fn lateness(&self, now: i64) -> Option<Odd> {
        let timer = self.late?;
        let delay = now.saturating_sub(self.since);
        let late = Some((timer, delay));
        (delay > limit(timer)).then_some(Odd { late, ..Odd::new(IrregularityKind::Late, None, None) })
    }

    /// Whether a packet lies before all that was seen of a transfer without start: another one began.
    pub(super) fn begins_anew(&self, sequence: u8) -> bool {
        self.cut_start && self.number(sequence) < self.received.first()
    }

    fn number(&self, sequence: u8) -> u32 {
        self.offset.saturating_add(u32::from(sequence))
    }

    /// The sender sent a packet.
    pub(super) fn packet(&mut self, sequence: u8, bytes: &[u8; 7], frame: &Frame, now: i64) -> Step {
        let mut odd = None;
        if self.lacks_offset {
            // As if it had come: the packets are those the receiver asked for.
            self.lacks_offset = false;
            self.offset = self.asked.map_or(0, |asked| asked.saturating_sub(1));
            odd = Some(Odd::new(IrregularityKind::Unexpected, Some(self.number(sequence)), None));
        }
        let number = self.number(sequence);
        if sequence == 0 || self.packets.is_some_and(|packets| number > packets) {
            let odd = Odd::new(IrregularityKind::Unexpected, Some(number), Some(self.due));
            return Step { odd: Some(odd), ..Step::default() };
        }
        self.add_frame(frame);
        odd = odd.or_else(|| self.oddity(number));
        let was_asked = number >= self.due;
        if self.mode == TransportMode::Broadcast && number == self.due && frame.time.is_some() {
            self.took_its_time(now.saturating_sub(self.since));
        }
        self.received.take(number, bytes, self.announced, was_asked);
        self.due = self.due.max(number.saturating_add(1));
        self.after_packet(number, now);
        let is_last = self.mode == TransportMode::Broadcast && self.packets == Some(number);
        Step { late: None, odd, end: is_last.then_some(Ending::Last) }
    }

    /// A packet of a broadcast came in order, so long behind the frame before.
    fn took_its_time(&mut self, gap: i64) {
        // Of one without start nobody knows what came before its first packet.
        if !(self.cut_start && self.received.distinct() == 0) {
            let (shortest, longest) = self.spacing.unwrap_or((gap, gap));
            self.spacing = Some((shortest.min(gap), longest.max(gap)));
        }
    }

    /// What is irregular about a packet, if anything.
    fn oddity(&mut self, number: u32) -> Option<Odd> {
        let is_cleared = match self.window {
            Window::Any => true,
            Window::To(last) => number <= last,
            Window::Held => false,
        };
        if !is_cleared {
            // Said once: the clear to send may be what the capture lacks.
            self.window = Window::Any;
            return Some(Odd::new(IrregularityKind::Unexpected, Some(number), None));
        }
        if number > self.due {
            return Some(Odd::new(IrregularityKind::Gap, Some(number), Some(self.due)));
        }
        let is_duplicate = number < self.due && self.received.has(number);
        is_duplicate.then(|| Odd::new(IrregularityKind::Duplicate, Some(number), None))
    }

    fn after_packet(&mut self, number: u32, now: i64) {
        let is_all = self.packets == Some(self.received.distinct());
        match (self.mode, self.window) {
            (TransportMode::Broadcast, _) => self.wait(Timer::T1, None, now),
            (_, Window::To(last)) if number >= last => self.wait(Timer::T3, Some(Timer::Tr), now),
            _ if is_all => self.wait(Timer::T3, Some(Timer::Tr), now),
            (_, Window::To(_)) => self.wait(Timer::T1, None, now),
            (_, Window::Any | Window::Held) => self.wait(Timer::T3, None, now),
        }
    }

    /// The receiver asks for `count` packets from `next` on, or holds the connection.
    pub(super) fn clear(&mut self, count: u8, next: u32, frame: &Frame, now: i64) -> Step {
        let is_hold = count == 0;
        if !is_hold && (next == 0 || self.packets.is_some_and(|packets| next > packets)) {
            let odd = Odd::new(IrregularityKind::Unexpected, Some(next), Some(self.due));
            return Step { odd: Some(odd), ..Step::default() };
        }
        let late = self.lateness(now);
        self.add_frame(frame);
        if is_hold {
            self.window = Window::Held;
            self.wait(Timer::T4, Some(Timer::Th), now);
            return Step { late, ..Step::default() };
        }
        let is_again = next <= self.received.highest() && !(self.cut_start && self.received.distinct() == 0);
        let odd = is_again.then(|| Odd::new(IrregularityKind::Retransmission, None, Some(next)));
        let last = next.saturating_add(u32::from(count)).saturating_sub(1);
        self.window = Window::To(self.packets.map_or(last, |packets| last.min(packets)));
        self.asked = Some(next);
        // Packets the capture lacks are told when the next one comes.
        self.due = next.min(self.received.highest().saturating_add(1));
        self.lacks_offset = self.mode == TransportMode::Extended;
        self.wait(Timer::T2, None, now);
        Step { late, odd, end: None }
    }

    /// The sender says that packets `offset` + 1 to `offset` + `count` follow.
    pub(super) fn packet_offset(&mut self, count: u8, offset: u32, frame: &Frame, now: i64) -> Step {
        self.add_frame(frame);
        let first = offset.saturating_add(1);
        if self.cut_start && self.asked.is_none() {
            self.received.renumber(offset);
        }
        let other = self.asked.filter(|asked| *asked != first);
        let odd = other.map(|asked| Odd::new(IrregularityKind::Unexpected, Some(first), Some(asked)));
        self.offset = offset;
        self.lacks_offset = false;
        self.due = first.min(self.received.highest().saturating_add(1));
        self.window = Window::To(offset.saturating_add(u32::from(count)));
        if self.timer != Timer::T2 {
            self.wait(Timer::T2, None, now);
        }
        Step { odd, ..Step::default() }
    }

    /// The receiver has the message.
    pub(super) fn acknowledged(&mut self, size: u32, frame: &Frame, now: i64) -> Step {
        let late = self.lateness(now);
        self.add_frame(frame);
        self.announced.get_or_insert(size);
        self.packets.get_or_insert(packets_of(size));
        Step { late, odd: None, end: Some(Ending::Last) }
    }

    /// One side gives up.
    pub(super) fn aborted(&mut self, abort: TransportAbort, frame: &Frame) -> Step {
        self.add_frame(frame);
        Step { end: Some(Ending::Abort(abort)), ..Step::default() }
    }
}
