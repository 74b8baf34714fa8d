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
use crate::event::{FrameRange, IrregularityKind, TransportAbort, TransportMode, TransportTimer};
use crate::frame::Frame;
use crate::wire::j1939::{J1939Id, PACKET_SIZE, Pgn, packets_of};

const MILLISECOND: i64 = 1_000_000;

/// Shortest timeout that ends a transfer, in ns.
pub(super) const SHORTEST: i64 = timeout_length(TransportTimer::T1);

/// Duration of a timeout in ns (J1939-21 §5.10.2.4).
const fn timeout_length(timer: TransportTimer) -> i64 {
    let milliseconds = match timer {
        TransportTimer::Tr => 200,
        TransportTimer::Th => 500,
        TransportTimer::T1 => 750,
        TransportTimer::T2 | TransportTimer::T3 => 1_250,
        TransportTimer::T4 => 1_050,
        TransportTimer::NBs | TransportTimer::NCr => 1_000,
    };
    milliseconds * MILLISECOND
}

/// Reason for the end of a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TransportEnding {
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
    pub(super) late: Option<(TransportTimer, i64)>,
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
    pub(super) end: Option<TransportEnding>,
}

/// Contents of the frame that opens a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct TransportOpening {
    pub(super) mode: TransportMode,
    pub(super) pgn: Pgn,
    pub(super) size: u32,
    pub(super) packets: u32,
}

/// Packets that the sender may send at present.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PacketWindow {
    /// All packets: a broadcast, or no clear to send yet.
    Any,
    /// Packets up to this one.
    To(u32),
    /// No packets: the receiver keeps the connection open.
    Held,
}

/// State of one transfer.
#[derive(Debug, Clone)]
pub(super) struct TransportSession {
    pub(super) mode: TransportMode,
    pub(super) pgn: Option<Pgn>,
    priority: u8,
    source: u8,
    destination: u8,
    pub(super) announced: Option<u32>,
    pub(super) packets: Option<u32>,
    pub(super) received: ReceivedPackets,
    window: PacketWindow,
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
    pub(super) timer: TransportTimer,
    since: i64,
    /// Timeout after which a response of the receiver is late.
    late: Option<TransportTimer>,
}

impl TransportSession {
    /// Creates the transfer that `frame` opens.
    pub(super) fn new(opening: TransportOpening, id: J1939Id, frame: &Frame, now: i64) -> Self {
        let mut session = Self::empty_session(opening.mode, id, 1, frame, now);
        session.pgn = Some(opening.pgn);
        (session.announced, session.packets) = (Some(opening.size), Some(opening.packets));
        if opening.mode != TransportMode::Broadcast {
            session.start_timeout(TransportTimer::T3, Some(TransportTimer::Tr), now);
        }
        session
    }

    /// Creates a transfer without start; `frame` is its first packet in the capture.
    pub(super) fn without_start(
        mode: TransportMode,
        id: J1939Id,
        sequence: u8,
        frame: &Frame,
        now: i64,
    ) -> Self {
        let mut session = Self::empty_session(mode, id, u32::from(sequence), frame, now);
        session.cut_start = true;
        session
    }

    fn empty_session(mode: TransportMode, id: J1939Id, first: u32, frame: &Frame, now: i64) -> Self {
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
            window: PacketWindow::Any,
            due: first,
            asked: None,
            offset: 0,
            lacks_offset: false,
            cut_start: false,
            frames: FrameRange::one(frame.number),
            frame_count: 1,
            times: (time, time),
            spacing: None,
            timer: TransportTimer::T1,
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
    pub(super) fn timeout_at(&self) -> i64 {
        self.since.saturating_add(timeout_length(self.timer))
    }

    /// Moves the timeout by `delay` ns, during which all traffic stopped.
    pub(super) fn postpone_timeout(&mut self, delay: i64) {
        self.since = self.since.saturating_add(delay);
    }

    /// Whether all packets were received and can contain the announced size.
    pub(super) fn is_whole(&self) -> bool {
        let (Some(size), Some(packets)) = (self.announced, self.packets) else { return false };
        !self.cut_start
            && self.received.distinct_count() == packets
            && size <= packets.saturating_mul(PACKET_SIZE)
    }

    /// Missing packets; only gaps if the number of packets is unknown.
    pub(super) fn missing_packets(&self) -> u32 {
        match self.packets {
            Some(packets) => packets.saturating_sub(self.received.distinct_count()),
            None => self.received.gap_count(),
        }
    }

    /// Whether `opening` repeats the request for the connection, before any packet.
    pub(super) fn is_asked_again(&self, opening: TransportOpening) -> bool {
        let same = self.pgn == Some(opening.pgn) && self.announced == Some(opening.size);
        same && self.mode != TransportMode::Broadcast && self.received.distinct_count() == 0
    }

    /// Handles a repeated request: an earlier clear to send is void.
    pub(super) fn asked_again(&mut self, frame: &Frame, now: i64) {
        self.add_frame(frame);
        (self.window, self.asked, self.lacks_offset) = (PacketWindow::Any, None, false);
        self.start_timeout(TransportTimer::T3, Some(TransportTimer::Tr), now);
    }

    /// Adds a frame to the transfer.
    fn add_frame(&mut self, frame: &Frame) {
        if self.frames.last != frame.number {
            self.frames.last = frame.number;
            self.frame_count = self.frame_count.saturating_add(1);
            self.times.1 = frame.time.map(|time| time.0).or(self.times.1);
        }
    }

    fn start_timeout(&mut self, timer: TransportTimer, late: Option<TransportTimer>, now: i64) {
        (self.timer, self.late, self.since) = (timer, late, now);
    }

    /// Lateness of a response of the receiver that arrives at `now`.
    fn late_response(&self, now: i64) -> Option<TransportIrregularity> {
        let timer = self.late?;
        let delay = now.saturating_sub(self.since);
        let late = Some((timer, delay));
        (delay > timeout_length(timer)).then_some(TransportIrregularity {
            late,
            ..TransportIrregularity::new(IrregularityKind::Late, None, None)
        })
    }

    /// Whether a packet is before the first one of a transfer without start: another transfer has started.
    pub(super) fn restarts(&self, sequence: u8) -> bool {
        self.cut_start && self.packet_number(sequence) < self.received.first()
    }

    fn packet_number(&self, sequence: u8) -> u32 {
        self.offset.saturating_add(u32::from(sequence))
    }

    /// Handles a data packet.
    pub(super) fn on_packet(
        &mut self,
        sequence: u8,
        bytes: &[u8; 7],
        frame: &Frame,
        now: i64,
    ) -> TransferStep {
        let mut odd = None;
        if self.lacks_offset {
            // Assumed packet offset: the packets are those that the receiver requested.
            self.lacks_offset = false;
            self.offset = self.asked.map_or(0, |asked| asked.saturating_sub(1));
            odd = Some(TransportIrregularity::new(
                IrregularityKind::Unexpected,
                Some(self.packet_number(sequence)),
                None,
            ));
        }
        let number = self.packet_number(sequence);
        if sequence == 0 || self.packets.is_some_and(|packets| number > packets) {
            let odd = TransportIrregularity::new(IrregularityKind::Unexpected, Some(number), Some(self.due));
            return TransferStep { odd: Some(odd), ..TransferStep::default() };
        }
        self.add_frame(frame);
        odd = odd.or_else(|| self.packet_irregularity(number));
        let was_asked = number >= self.due;
        if self.mode == TransportMode::Broadcast && number == self.due && frame.time.is_some() {
            self.took_its_time(now.saturating_sub(self.since));
        }
        self.received.take_packet(number, bytes, self.announced, was_asked);
        self.due = self.due.max(number.saturating_add(1));
        self.after_packet(number, now);
        let is_last = self.mode == TransportMode::Broadcast && self.packets == Some(number);
        TransferStep { late: None, odd, end: is_last.then_some(TransportEnding::Last) }
    }

    /// Adds the time between two consecutive packets of a broadcast.
    fn took_its_time(&mut self, gap: i64) {
        // Without the start, the time before the first packet is unknown.
        if !(self.cut_start && self.received.distinct_count() == 0) {
            let (shortest, longest) = self.spacing.unwrap_or((gap, gap));
            self.spacing = Some((shortest.min(gap), longest.max(gap)));
        }
    }

    /// Irregularity of a packet, if any.
    fn packet_irregularity(&mut self, number: u32) -> Option<TransportIrregularity> {
        let is_cleared = match self.window {
            PacketWindow::Any => true,
            PacketWindow::To(last) => number <= last,
            PacketWindow::Held => false,
        };
        if !is_cleared {
            // Reported once, because the clear to send may be missing in the capture.
            self.window = PacketWindow::Any;
            return Some(TransportIrregularity::new(IrregularityKind::Unexpected, Some(number), None));
        }
        if number > self.due {
            return Some(TransportIrregularity::new(IrregularityKind::Gap, Some(number), Some(self.due)));
        }
        let is_duplicate = number < self.due && self.received.was_received_before(number);
        is_duplicate.then(|| TransportIrregularity::new(IrregularityKind::Duplicate, Some(number), None))
    }

    fn after_packet(&mut self, number: u32, now: i64) {
        let is_all = self.packets == Some(self.received.distinct_count());
        match (self.mode, self.window) {
            (TransportMode::Broadcast, _) => self.start_timeout(TransportTimer::T1, None, now),
            (_, PacketWindow::To(last)) if number >= last => {
                self.start_timeout(TransportTimer::T3, Some(TransportTimer::Tr), now);
            }
            _ if is_all => self.start_timeout(TransportTimer::T3, Some(TransportTimer::Tr), now),
            (_, PacketWindow::To(_)) => self.start_timeout(TransportTimer::T1, None, now),
            (_, PacketWindow::Any | PacketWindow::Held) => self.start_timeout(TransportTimer::T3, None, now),
        }
    }

    /// Handles a clear to send for `count` packets from `next` on; 0 keeps the connection open.
    pub(super) fn on_clear_to_send(&mut self, count: u8, next: u32, frame: &Frame, now: i64) -> TransferStep {
        let is_hold = count == 0;
        if !is_hold && (next == 0 || self.packets.is_some_and(|packets| next > packets)) {
            let odd = TransportIrregularity::new(IrregularityKind::Unexpected, Some(next), Some(self.due));
            return TransferStep { odd: Some(odd), ..TransferStep::default() };
        }
        let late = self.late_response(now);
        self.add_frame(frame);
        if is_hold {
            self.window = PacketWindow::Held;
            self.start_timeout(TransportTimer::T4, Some(TransportTimer::Th), now);
            return TransferStep { late, ..TransferStep::default() };
        }
        let is_again =
            next <= self.received.highest() && !(self.cut_start && self.received.distinct_count() == 0);
        let odd =
            is_again.then(|| TransportIrregularity::new(IrregularityKind::Retransmission, None, Some(next)));
        let last = next.saturating_add(u32::from(count)).saturating_sub(1);
        self.window = PacketWindow::To(self.packets.map_or(last, |packets| last.min(packets)));
        self.asked = Some(next);
        // Packets missing in the capture are reported with the next packet.
        self.due = next.min(self.received.highest().saturating_add(1));
        self.lacks_offset = self.mode == TransportMode::Extended;
        self.start_timeout(TransportTimer::T2, None, now);
        TransferStep { late, odd, end: None }
    }

    /// Handles the announcement of packets `offset` + 1 to `offset` + `count`.
    pub(super) fn packet_offset(&mut self, count: u8, offset: u32, frame: &Frame, now: i64) -> TransferStep {
        self.add_frame(frame);
        let first = offset.saturating_add(1);
        if self.cut_start && self.asked.is_none() {
            self.received.renumber_packets(offset);
        }
        let other = self.asked.filter(|asked| *asked != first);
        let odd = other
            .map(|asked| TransportIrregularity::new(IrregularityKind::Unexpected, Some(first), Some(asked)));
        self.offset = offset;
        self.lacks_offset = false;
        self.due = first.min(self.received.highest().saturating_add(1));
        self.window = PacketWindow::To(offset.saturating_add(u32::from(count)));
        if self.timer != TransportTimer::T2 {
            self.start_timeout(TransportTimer::T2, None, now);
        }
        TransferStep { odd, ..TransferStep::default() }
    }

    /// Handles the end of message acknowledgement.
    pub(super) fn on_acknowledged(&mut self, size: u32, frame: &Frame, now: i64) -> TransferStep {
        let late = self.late_response(now);
        self.add_frame(frame);
        self.announced.get_or_insert(size);
        self.packets.get_or_insert(packets_of(size));
        TransferStep { late, odd: None, end: Some(TransportEnding::Last) }
    }

    /// Handles an abort of the sender or receiver.
    pub(super) fn on_aborted(&mut self, abort: TransportAbort, frame: &Frame) -> TransferStep {
        self.add_frame(frame);
        TransferStep { end: Some(TransportEnding::Abort(abort)), ..TransferStep::default() }
    }
}
