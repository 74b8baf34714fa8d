//! Messages of a bus by their senders, and silences of whole senders.

use std::collections::BTreeMap;

use super::role::is_controller;
use crate::frame::CanId;
use crate::session::{Bus, BusStream, Node, StreamService};
use crate::wire::NodeId;

/// Frames after which the period of a message is known.
const KNOWN: u32 = 6;

/// Missing elements in a row that lost frames do not explain: at 2 % of lost frames, one in six million.
const MISSED: i64 = 4;

/// Shortest time that counts as a silence, in ns: adapters deliver frames in bursts.
const SHORTEST: i64 = 500_000_000;

/// J1939 groups that sessions and requests consist of: transport protocol, extended transport protocol, requests,
/// acknowledgements, address claims, peer-to-peer messages (SAE J1939-21 §5.4, §5.10).
const NOT_PERIODIC: [u32; 8] = [0xC700, 0xC800, 0xE800, 0xEA00, 0xEB00, 0xEC00, 0xEE00, 0xEF00];

/// Whether a J1939 message belongs to a session, or is meant for one node: it ends with its receiver.
fn is_session_message(id: u32) -> bool {
    let (group, is_peer) = (id >> 8 & 0x3_FF00, id >> 16 & 0xFF < 0xF0);
    let is_for_one = is_peer && id >> 8 & 0xFF != u32::from(GLOBAL);
    NOT_PERIODIC.contains(&group) || is_for_one
}

/// Destination of messages for all nodes (SAE J1939-21 §5.2.3).
const GLOBAL: u8 = 0xFF;

/// Who sends a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Sender {
    /// The sender of SYNC and set points.
    Controller,
    Node(NodeId),
}

impl Sender {
    /// The node; `None` for the controller.
    pub(crate) fn node(self) -> Option<NodeId> {
        match self {
            Self::Controller => None,
            Self::Node(node) => Some(node),
        }
    }
}

/// A periodic message.
#[derive(Debug, Clone)]
pub(crate) struct PeriodicStream {
    pub(crate) stream: BusStream,
    /// Usual interval in ns.
    pub(crate) period: i64,
}

impl PeriodicStream {
    fn new(stream: BusStream) -> Option<Self> {
        let is_session = match stream.id {
            CanId::Extended(id) => is_session_message(id),
            CanId::Standard(_) => false,
        };
        let (usual, regular) = (stream.regularity.usual_interval(), stream.regularity.regular_count());
        // Half of the intervals at least are usual ones, or parts of a usual one.
        let usual_count = regular.saturating_add(stream.splits.0.saturating_mul(2));
        let is_known = stream.count >= KNOWN && usual_count.saturating_mul(2) >= stream.count && usual > 0;
        (is_known && !is_session).then_some(Self { stream, period: usual })
    }

    /// Time without an element after which the message is missing, in ns.
    fn limit(&self) -> i64 {
        self.period.saturating_mul(MISSED).max(self.stream.longest.saturating_mul(2)).max(SHORTEST)
    }

    /// Whether no element follows its last one up to a monotonic time, although several are due.
    pub(crate) fn is_missing_at(&self, end: i64) -> bool {
        end.saturating_sub(self.stream.times.1) > self.limit()
    }

    /// Monotonic time at which the element after the last one was due, in ns.
    pub(crate) fn due(&self) -> i64 {
        self.stream.times.1.saturating_add(self.period).saturating_add(self.period / 5)
    }
}

/// All periodic messages of a sender.
#[derive(Debug, Clone)]
pub(crate) struct SenderStreams {
    pub(crate) sender: Sender,
    pub(crate) streams: Vec<PeriodicStream>,
    /// Messages that were sent far too often for a time.
    pub(crate) bursts: Vec<BusStream>,
    /// Last frame of the sender: monotonic time in ns, and number.
    pub(crate) last: (i64, u64),
}

/// A time in which a sender sent nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct SenderSilence {
    pub(crate) sender: Sender,
    /// Last frame before it: monotonic time in ns, and number.
    pub(crate) last: (i64, u64),
    /// Time at which the sender was silent at the latest: the first element that is missing.
    pub(crate) latest: i64,
    /// First frame after it; `None` until the end of the capture.
    pub(crate) until: Option<(i64, u64)>,
    /// Number of messages that are missing.
    pub(crate) streams: usize,
    /// Shortest period of these messages, in ns.
    pub(crate) period: i64,
    /// Lost frames do not explain it.
    pub(crate) is_certain: bool,
}

/// Whether the protocol of a message is proven on its bus: else its identifier names no sender.
fn is_proven(bus: &Bus, stream: &BusStream) -> bool {
    let is_guarded = || stream.node.and_then(|node| bus.node(node)).is_some_and(Node::is_guarded);
    match stream.service {
        // Responses to guarding end with its requests.
        StreamService::ErrorControl if is_guarded() => false,
        StreamService::J1939Message => bus.protocols().is_j1939(),
        _ => bus.protocols().is_canopen() && !bus.protocols().is_canopen_presumed(),
    }
}

/// Senders of periodic messages on a bus.
pub(crate) fn observe_senders(bus: &Bus) -> Vec<SenderStreams> {
    let mut all: BTreeMap<Sender, SenderStreams> = BTreeMap::new();
    for stream in bus.streams().filter(|stream| is_proven(bus, stream)) {
        let sender = match (stream.service, stream.node) {
            (StreamService::Sync | StreamService::ReceivedPdo, _) | (_, None) => Sender::Controller,
            (_, Some(node)) if is_controller(bus, node) => Sender::Controller,
            (_, Some(node)) => Sender::Node(node),
        };
        let last = (stream.times.1, stream.last_frame);
        let entry = all.entry(sender).or_insert_with(|| SenderStreams {
            sender,
            streams: Vec::new(),
            bursts: Vec::new(),
            last,
        });
        entry.last = entry.last.max(last);
        if stream.burst.windows > 0 {
            entry.bursts.push(stream.clone());
        }
        entry.streams.extend(PeriodicStream::new(stream));
    }
    for entry in all.values_mut() {
        // A node that answers requests is not silent.
        if let Some(node) = entry.sender.node().and_then(|node| bus.node(node)) {
            let (frame, time) = node.last_seen();
            if let Some(time) = time {
                entry.last = entry.last.max((bus.monotonic(time), frame));
            }
        }
    }
    all.into_values().filter(|sender| !sender.streams.is_empty() || !sender.bursts.is_empty()).collect()
}

impl SenderStreams {
    /// Whether the sender sends a heartbeat, which depends on no other message.
    pub(crate) fn has_heartbeat(&self) -> bool {
        self.streams.iter().any(|each| each.stream.service == StreamService::ErrorControl)
    }

    /// Silences of the sender; `end` is the monotonic time of the last frame of the bus.
    pub(crate) fn silences(&self, end: i64) -> Vec<SenderSilence> {
        let mut all = self.passing_silences();
        all.extend(self.last_silence(end));
        all
    }

    /// The silence at the end of the capture.
    fn last_silence(&self, end: i64) -> Option<SenderSilence> {
        // Messages that ended long before the last frame of the sender ended for another reason.
        let active = || self.streams.iter().filter(|each| !each.is_missing_at(self.last.0));
        let is_silent = active().next().is_some() && active().all(|each| each.is_missing_at(end));
        let period = active().map(|each| each.period).min().filter(|_| is_silent)?;
        // Other frames of the sender may be rare.
        let is_over = end.saturating_sub(self.last.0) > period.saturating_mul(MISSED).max(SHORTEST);
        is_over.then(|| SenderSilence {
            sender: self.sender,
            last: self.last,
            latest: active().map(|each| next_due(each.due(), self.last.0, each.period)).min().unwrap_or(end),
            until: None,
            streams: active().count(),
            period,
            is_certain: true,
        })
    }

    /// Silences after which the sender returns, by its fastest message.
    fn passing_silences(&self) -> Vec<SenderSilence> {
        let Some(fastest) = self.streams.iter().min_by_key(|each| each.period) else { return Vec::new() };
        let mut all = Vec::new();
        for silence in &fastest.stream.silences {
            let (from, to) = silence.times;
            let mut found = SenderSilence {
                sender: self.sender,
                last: (from, silence.frames.0),
                latest: from.saturating_add(fastest.period).saturating_add(fastest.period / 5),
                until: Some((to, silence.frames.1)),
                streams: 0,
                period: fastest.period,
                is_certain: false,
            };
            if self.streams.iter().all(|each| narrow_silence(&mut found, each)) {
                found.is_certain = found.duration() > fastest.period.saturating_mul(MISSED).max(SHORTEST);
                all.push(found);
            }
        }
        all
    }
}

impl SenderSilence {
    /// Duration in ns; 0 without an end.
    pub(crate) fn duration(&self) -> i64 {
        self.until.map_or(0, |until| until.0.saturating_sub(self.last.0))
    }

    /// Whether another silence may have begun at the same moment, and ended so.
    pub(crate) fn matches(&self, other: &Self) -> bool {
        // The first element that is due may be missing in the recording.
        let begins = self.last.0 <= other.latest.saturating_add(other.period)
            && other.last.0 <= self.latest.saturating_add(self.period);
        let slack = self.period.max(other.period).saturating_mul(2);
        let ends = match (self.until, other.until) {
            (None, None) => true,
            (Some(one), Some(other)) => (one.0 - other.0).abs() <= slack,
            _ => false,
        };
        begins && (ends || self.is_certain && other.is_certain)
    }
}

/// First time after `last` at which an element is due.
fn next_due(due: i64, last: i64, period: i64) -> i64 {
    if due > last { due } else { last.saturating_add(period) }
}

/// Limits a silence to the one of another message of the sender; `false` if the message went on during it.
fn narrow_silence(silence: &mut SenderSilence, other: &PeriodicStream) -> bool {
    let Some((to, _)) = silence.until else { return false };
    let (first, last) = other.stream.times;
    let (from, middle) = (silence.last.0, i64::midpoint(silence.last.0, to));
    if first >= to || last.saturating_add(other.period.saturating_mul(2)) < from {
        return true;
    }
    let own = other.stream.silences.iter().find(|own| own.times.0 < middle && middle < own.times.1);
    let Some(own) = own else {
        // A slow message, or one that ends with the silence.
        return last <= middle || other.period.saturating_mul(4) >= to.saturating_sub(from);
    };
    let due = own.times.0.saturating_add(other.period).saturating_add(other.period / 5);
    // Messages that ended earlier than the last one of the sender ended for another reason.
    let last = silence.last.max((own.times.0, own.frames.0));
    silence.latest = match (due > last.0, silence.latest > last.0) {
        (true, true) => due.min(silence.latest),
        (true, false) => due,
        (false, true) => silence.latest,
        (false, false) => last.0.saturating_add(other.period),
    };
    silence.last = last;
    silence.until = silence.until.map(|until| until.min((own.times.1, own.frames.1)));
    silence.streams += 1;
    true
}
