//! State of one multi-packet transfer.
//!
//! ```text
//! sender    BAM ─ DT DT … DT                                 T1 between packets; ends with the last packet
//! sender    RTS ─────── DT DT … ──────── DT DT … ───────── (T3)
//! receiver      CTS n,k          CTS n,k           EOMA; CTS 0 keeps the connection open
//!           Tr, T3   T2, T1 …   Tr, T3   T2, T1 …  Tr, T3      Th, T4
//! extended  RTS, CTS, then DPO before the packets of each window
//! ```
//!
//! Exceeding Tr or Th is reported when the response arrives; T1 to T4 end the transfer (J1939-21 §5.10.2.4).
//! Without a clear to send, the receiver may be missing in the capture: then any packet is accepted, with T3.

use super::received::ReceivedPackets;
use crate::event::{FrameRange, IrregularityKind, Timer, TransportAbort, TransportMode};
use crate::frame::Frame;
use crate::wire::j1939::{J1939Id, PACKET_SIZE, Pgn, packets_of};

const MILLISECOND: i64 = 1_000_000;

/// Shortest timeout that ends a transfer, in ns.
pub(super) const SHORTEST: i64 = limit(Timer::T1);

/// Duration of a timeout in ns (J1939-21 §5.10.2.4).
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

/// Reason for the end of a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ending {
    /// Last packet or end of message acknowledgement.
    Last,
    /// Abort message.
    Abort(TransportAbort),
    /// Timeout of the running timer.
    Timeout,
    /// Start of another transfer with the same addresses.
    Superseded,
    /// End of the capture.
    Unfinished,
}

/// An irregularity of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TransportIrregularity {
    pub(super) what: IrregularityKind,
    pub(super) packet: Option<u32>,
    pub(super) expected: Option<u32>,
    /// Exceeded timeout, and the actual time in ns.
    pub(super) late: Option<(Timer, i64)>,
}

impl TransportIrregularity {
    pub(super) const fn new(what: IrregularityKind, packet: Option<u32>, expected: Option<u32>) -> Self {
        Self { what, packet, expected, late: None }
    }
}

/// Result of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct TransferStep {
    pub(super) late: Option<TransportIrregularity>,
    pub(super) odd: Option<TransportIrregularity>,
    pub(super) end: Option<Ending>,
}

/// Contents of the frame that opens a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Opening {
    pub(super) mode: TransportMode,
    pub(super) pgn: Pgn,
    pub(super) size: u32,
    pub(super) packets: u32,
}

/// Packets that the sender may send at present.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Window {
    /// All packets: a broadcast, or no clear to send yet.
    Any,
    /// Packets up to this one.
    To(u32),
    /// No packets: the receiver keeps the connection open.
    Held,
}

/// State of one transfer.
#[derive(Debug, Clone)]
pub(super) struct Session {
    pub(super) mode: TransportMode,
    pub(super) pgn: Option<Pgn>,
    priority: u8,
    source: u8,
    destination: u8,
    pub(super) announced: Option<u32>,
    pub(super) packets: Option<u32>,
    pub(super) received: ReceivedPackets,
    window: Window,
    /// Next packet in order.
    due: u32,
    /// First packet of the last request.
    asked: Option<u32>,
    /// Number of packets before sequence number 1.
    offset: u32,
    /// A clear to send of the extended protocol has no packet offset yet.
    lacks_offset: bool,
    pub(super) cut_start: bool,
    pub(super) frames: FrameRange,
    pub(super) frame_count: u64,
    times: (Option<i64>, Option<i64>),
    /// Min and max time between consecutive frames of a broadcast, in ns.
    pub(super) spacing: Option<(i64, i64)>,
    /// Running timeout that ends the transfer, and its start in monotonic ns.
    pub(super) timer: Timer,
    since: i64,
    /// Timeout after which a response of the receiver is late.
    late: Option<Timer>,
}

impl Session {
    /// Creates the transfer that `frame` opens.
    pub(super) fn new(opening: Opening, id: J1939Id, frame: &Frame, now: i64) -> Self {
        let mut session = Self::bare(opening.mode, id, 1, frame, now);
        session.pgn = Some(opening.pgn);
        (session.announced, session.packets) = (Some(opening.size), Some(opening.packets));
        if opening.mode != TransportMode::Broadcast {
            session.wait(Timer::T3, Some(Timer::Tr), now);
        }
        session
    }

    /// Creates a transfer without start; `frame` is its first packet in the capture.
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
            received: ReceivedPackets::new(first),
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

    /// Identifier of the complete message.
    pub(super) fn id(&self) -> J1939Id {
        J1939Id {
            priority: self.priority,
            pgn: self.pgn.unwrap_or_default(),
            source: self.source,
            destination: self.destination,
        }
    }

    /// Time from the first to the last frame, in ns.
    pub(super) fn duration(&self) -> Option<i64> {
        Some(self.times.1?.saturating_sub(self.times.0?))
    }

    /// Monotonic time of the running timeout.
    pub(super) fn deadline(&self) -> i64 {
        self.since.saturating_add(limit(self.timer))
    }

    /// Moves the timeout by `delay` ns, during which all traffic stopped.
    pub(super) fn postpone(&mut self, delay: i64) {
        self.since = self.since.saturating_add(delay);
    }

    /// Whether all packets were received and can contain the announced size.
    pub(super) fn is_whole(&self) -> bool {
        let (Some(size), Some(packets)) = (self.announced, self.packets) else { return false };
        !self.cut_start && self.received.distinct() == packets && size <= packets.saturating_mul(PACKET_SIZE)
    }

    /// Missing packets; only gaps if the number of packets is unknown.
    pub(super) fn missing(&self) -> u32 {
        match self.packets {
            Some(packets) => packets.saturating_sub(self.received.distinct()),
            None => self.received.gaps(),
        }
    }

    /// Whether `opening` repeats the request for the connection, before any packet.
    pub(super) fn is_asked_again(&self, opening: Opening) -> bool {
        let same = self.pgn == Some(opening.pgn) && self.announced == Some(opening.size);
        same && self.mode != TransportMode::Broadcast && self.received.distinct() == 0
    }

    /// Handles a repeated request: an earlier clear to send is void.
    pub(super) fn asked_again(&mut self, frame: &Frame, now: i64) {
        self.add_frame(frame);
        (self.window, self.asked, self.lacks_offset) = (Window::Any, None, false);
        self.wait(Timer::T3, Some(Timer::Tr), now);
    }

    /// Adds a frame to the transfer.
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

    /// Lateness of a response of the receiver that arrives at `now`.
    fn lateness(&self, now: i64) -> Option<TransportIrregularity> {
        let timer = self.late?;
        let delay = now.saturating_sub(self.since);
        let late = Some((timer, delay));
        (delay > limit(timer)).then_some(TransportIrregularity {
            late,
            ..TransportIrregularity::new(IrregularityKind::Late, None, None)
        })
    }

    /// Whether a packet is before the first one of a transfer without start: another transfer has started.
    pub(super) fn begins_anew(&self, sequence: u8) -> bool {
        self.cut_start && self.number(sequence) < self.received.first()
    }

    fn number(&self, sequence: u8) -> u32 {
        self.offset.saturating_add(u32::from(sequence))
    }

    /// Handles a data packet.
    pub(super) fn packet(&mut self, sequence: u8, bytes: &[u8; 7], frame: &Frame, now: i64) -> TransferStep {
        let mut odd = None;
        if self.lacks_offset {
            // Assumed packet offset: the packets are those that the receiver requested.
            self.lacks_offset = false;
            self.offset = self.asked.map_or(0, |asked| asked.saturating_sub(1));
            odd = Some(TransportIrregularity::new(
                IrregularityKind::Unexpected,
                Some(self.number(sequence)),
                None,
            ));
        }
        let number = self.number(sequence);
        if sequence == 0 || self.packets.is_some_and(|packets| number > packets) {
            let odd = TransportIrregularity::new(IrregularityKind::Unexpected, Some(number), Some(self.due));
            return TransferStep { odd: Some(odd), ..TransferStep::default() };
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
        TransferStep { late: None, odd, end: is_last.then_some(Ending::Last) }
    }

    /// Adds the time between two consecutive packets of a broadcast.
    fn took_its_time(&mut self, gap: i64) {
        // Without the start, the time before the first packet is unknown.
        if !(self.cut_start && self.received.distinct() == 0) {
            let (shortest, longest) = self.spacing.unwrap_or((gap, gap));
            self.spacing = Some((shortest.min(gap), longest.max(gap)));
        }
    }

    /// Irregularity of a packet, if any.
    fn oddity(&mut self, number: u32) -> Option<TransportIrregularity> {
        let is_cleared = match self.window {
            Window::Any => true,
            Window::To(last) => number <= last,
            Window::Held => false,
        };
        if !is_cleared {
            // Reported once, because the clear to send may be missing in the capture.
            self.window = Window::Any;
            return Some(TransportIrregularity::new(IrregularityKind::Unexpected, Some(number), None));
        }
        if number > self.due {
            return Some(TransportIrregularity::new(IrregularityKind::Gap, Some(number), Some(self.due)));
        }
        let is_duplicate = number < self.due && self.received.has(number);
        is_duplicate.then(|| TransportIrregularity::new(IrregularityKind::Duplicate, Some(number), None))
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

    /// Handles a clear to send for `count` packets from `next` on; 0 keeps the connection open.
    pub(super) fn clear(&mut self, count: u8, next: u32, frame: &Frame, now: i64) -> TransferStep {
        let is_hold = count == 0;
        if !is_hold && (next == 0 || self.packets.is_some_and(|packets| next > packets)) {
            let odd = TransportIrregularity::new(IrregularityKind::Unexpected, Some(next), Some(self.due));
            return TransferStep { odd: Some(odd), ..TransferStep::default() };
        }
        let late = self.lateness(now);
        self.add_frame(frame);
        if is_hold {
            self.window = Window::Held;
            self.wait(Timer::T4, Some(Timer::Th), now);
            return TransferStep { late, ..TransferStep::default() };
        }
        let is_again = next <= self.received.highest() && !(self.cut_start && self.received.distinct() == 0);
        let odd =
            is_again.then(|| TransportIrregularity::new(IrregularityKind::Retransmission, None, Some(next)));
        let last = next.saturating_add(u32::from(count)).saturating_sub(1);
        self.window = Window::To(self.packets.map_or(last, |packets| last.min(packets)));
        self.asked = Some(next);
        // Packets missing in the capture are reported with the next packet.
        self.due = next.min(self.received.highest().saturating_add(1));
        self.lacks_offset = self.mode == TransportMode::Extended;
        self.wait(Timer::T2, None, now);
        TransferStep { late, odd, end: None }
    }

    /// Handles the announcement of packets `offset` + 1 to `offset` + `count`.
    pub(super) fn packet_offset(&mut self, count: u8, offset: u32, frame: &Frame, now: i64) -> TransferStep {
        self.add_frame(frame);
        let first = offset.saturating_add(1);
        if self.cut_start && self.asked.is_none() {
            self.received.renumber(offset);
        }
        let other = self.asked.filter(|asked| *asked != first);
        let odd = other
            .map(|asked| TransportIrregularity::new(IrregularityKind::Unexpected, Some(first), Some(asked)));
        self.offset = offset;
        self.lacks_offset = false;
        self.due = first.min(self.received.highest().saturating_add(1));
        self.window = Window::To(offset.saturating_add(u32::from(count)));
        if self.timer != Timer::T2 {
            self.wait(Timer::T2, None, now);
        }
        TransferStep { odd, ..TransferStep::default() }
    }

    /// Handles the end of message acknowledgement.
    pub(super) fn acknowledged(&mut self, size: u32, frame: &Frame, now: i64) -> TransferStep {
        let late = self.lateness(now);
        self.add_frame(frame);
        self.announced.get_or_insert(size);
        self.packets.get_or_insert(packets_of(size));
        TransferStep { late, odd: None, end: Some(Ending::Last) }
    }

    /// Handles an abort of the sender or receiver.
    pub(super) fn aborted(&mut self, abort: TransportAbort, frame: &Frame) -> TransferStep {
        self.add_frame(frame);
        TransferStep { end: Some(Ending::Abort(abort)), ..TransferStep::default() }
    }
}
