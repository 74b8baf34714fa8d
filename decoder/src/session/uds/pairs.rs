//! Pairs of 29-bit identifiers that answer each other as UDS client and server (ISO 15765-2), without a bus file.
//!
//! One frame of the form of ISO-TP proves nothing: by chance, a part of all frames has it. So frames that may start a
//! message are held, and a pair is decided by its exchange: a response that repeats the identifier of its request, or that
//! comes back between mirrored addresses, or the second exchange with other data. Then the held frames of both
//! identifiers are decoded in their order, once, as if the pair had been known before.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::bus_file::UdsPair;
use crate::frame::{CanId, Frame, FrameFlags, Timestamp};
use crate::profile;
use crate::session::bus::UdsLink;
use crate::session::context::MachineContext;
use crate::session::options::ProtocolChoice;
use crate::wire::NodeId;
use crate::wire::canopen::emcy::EmcyByteOrder;
use crate::wire::isotp::{self, IsoTpFrame};
use crate::wire::j1939::{J1939Id, Pgn};
use crate::wire::uds::ServiceLayout;

/// Frames that are held for a decision.
const HELD_FRAMES: usize = 64;

/// Time in ns after which a response no longer belongs to a request, and a frame is no longer held (P2*server_max,
/// ISO 14229-2 §7.2).
const HELD_TIME: i64 = 5_000_000_000;

/// Pairs with one exchange, of which a second one would be the proof.
const SUSPECTED_PAIRS: usize = 16;

/// Offset from request to response SID, and SID of a negative response (ISO 14229-1 §8.3, §8.7).
const ANSWER: u8 = 0x40;
const NEGATIVE: u8 = 0x7F;

/// A held frame.
#[derive(Debug, Clone)]
struct HeldFrame {
    frame: Frame,
    /// The frame was emitted undecoded and counted.
    is_counted: bool,
    /// The frame may be a message of J1939 instead, and no event of it was emitted: slot and identifier.
    withheld: Option<(usize, J1939Id)>,
}

/// A pair with one exchange that does not prove it alone.
#[derive(Debug, Clone)]
struct SuspectedPair {
    request: CanId,
    response: CanId,
    /// Payload of the request and of the response.
    data: (Vec<u8>, Vec<u8>),
}

/// Frames of undecided identifiers.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct PairSearch {
    held: VecDeque<HeldFrame>,
    /// Withheld frames that are no longer held, until they are decoded.
    evicted: VecDeque<((usize, J1939Id), Frame)>,
    suspects: Vec<SuspectedPair>,
}

impl HeldFrame {
    /// Whether a response at `now` no longer belongs to the frame.
    fn is_old(&self, now: Option<Timestamp>) -> bool {
        match (now, self.frame.time) {
            (Some(now), Some(then)) => !(0..=HELD_TIME).contains(&now.since(then)),
            _ => false,
        }
    }
}

/// What a frame decides.
pub(in crate::session) enum PairDecision {
    /// Nothing: the frame is decoded without this search.
    Open,
    /// The frame waits for a response; no event of it is emitted yet.
    Withheld,
    /// The frame proves a pair.
    Proven(ProvenPair),
}

/// A pair that its exchange proved.
pub(in crate::session) struct ProvenPair {
    /// Frames of both identifiers in their order, each with its link; the last one is the present frame.
    pub(in crate::session) frames: Vec<(UdsLink, Frame)>,
}

impl PairSearch {
    /// Evaluates a data frame of an undecided identifier; `is_counted` if it becomes an undecoded frame, `withheld` the slot
    /// and identifier of J1939 if it would become a presumed message of J1939.
    /// The identifiers of a proven pair belong to ISO-TP from now on.
    #[cold]
    pub(in crate::session) fn take_frame(
        &mut self,
        (frame, withheld): (&Frame, Option<(usize, J1939Id)>),
        is_counted: bool,
        cx: &mut MachineContext<'_>,
    ) -> PairDecision {
        if frame.flags.contains(FrameFlags::REMOTE) || cx.bus.protocols.choice == ProtocolChoice::None {
            return PairDecision::Open;
        }
        let before = self.held.back().map(|held| held.frame.number);
        if let Some(pair) = self.prove_pair(frame, is_counted, cx) {
            return PairDecision::Proven(pair);
        }
        match self.held.back_mut().filter(|held| before != Some(held.frame.number)) {
            Some(held) if withheld.is_some() => {
                held.withheld = withheld;
                PairDecision::Withheld
            }
            _ => PairDecision::Open,
        }
    }

    /// Whether frames wait without any event.
    pub(in crate::session) fn withholds_frames(&self) -> bool {
        !self.evicted.is_empty() || self.held.iter().any(|held| held.withheld.is_some())
    }

    /// Takes the oldest withheld frame that is no longer held at `time`; without a time, the oldest one.
    pub(in crate::session) fn take_withheld(
        &mut self,
        time: Option<Timestamp>,
    ) -> Option<((usize, J1939Id), Frame)> {
        if let Some(evicted) = self.evicted.pop_front() {
            return Some(evicted);
        }
        let held = self.held.iter_mut().find(|held| held.withheld.is_some())?;
        let is_due = time.is_none_or(|now| held.is_old(Some(now)));
        held.withheld.take_if(|_| is_due).map(|group| (group, held.frame))
    }

    fn prove_pair(
        &mut self,
        frame: &Frame,
        is_counted: bool,
        cx: &mut MachineContext<'_>,
    ) -> Option<ProvenPair> {
        let (request, response) = self.find_exchange(frame, is_counted)?;
        if cx.bus.routes.is_given(request) || cx.bus.routes.is_given(response) {
            return None;
        }
        let forth = assign_pair(request, response, cx);
        let mut frames = Vec::new();
        for held in std::mem::take(&mut self.held) {
            match held.frame.id {
                id if id == request => frames.push((forth, held.frame)),
                id if id == response => frames.push((forth.opposite_link(), held.frame)),
                _ => {
                    self.held.push_back(held);
                    continue;
                }
            }
            if held.is_counted && held.frame.number != frame.number {
                let (count, extended) = &mut cx.bus.protocols.undecoded;
                (*count, *extended) = (count.saturating_sub(1), extended.saturating_sub(1));
            }
        }
        self.suspects.retain(|pair| pair.request != request && pair.response != response);
        let first = frames.first().map_or(frame.number, |(_, first)| first.number);
        let text = format!(
            "{response} responds to {request}: decoded as UDS over ISO-TP (ISO 15765-2) from frame {first} on"
        );
        cx.emit_note(frame, text);
        Some(ProvenPair { frames })
    }

    /// Holds a frame that may belong to a message; returns the identifiers of request and response if it is the response
    /// that proves a pair.
    fn find_exchange(&mut self, frame: &Frame, is_counted: bool) -> Option<(CanId, CanId)> {
        let data = message_bytes(frame)?;
        let start = match isotp::parse(data, frame.data().len()) {
            Ok(IsoTpFrame::Single { data } | IsoTpFrame::First { data, .. }) => Some(data),
            Ok(IsoTpFrame::Consecutive { .. } | IsoTpFrame::FlowControl(_)) => None,
            Ok(IsoTpFrame::Unknown { .. }) | Err(_) => return None,
        };
        let is_part = start.is_none() && self.held.iter().any(|held| held.frame.id == frame.id);
        if !is_part && !start.is_some_and(is_service) {
            return None;
        }
        self.hold_frame(frame, is_counted);
        let answer = start.filter(|data| data.first().is_some_and(|service| service & ANSWER != 0))?;
        let request = self.held.iter().rev().skip(1).find_map(|held| {
            let asked = started_message(&held.frame)?;
            (held.frame.id != frame.id && answers_service(answer, asked))
                .then_some((held.frame.id, asked.to_vec()))
        });
        let (request, asked) = request?;
        let is_proven = repeats_identifier(answer, &asked) || are_mirrored(request, frame.id);
        (is_proven || self.is_second_exchange((request, &asked), (frame.id, answer)))
            .then_some((request, frame.id))
    }

    fn hold_frame(&mut self, frame: &Frame, is_counted: bool) {
        let is_over = |oldest: &HeldFrame, count: usize| count >= HELD_FRAMES || oldest.is_old(frame.time);
        while self.held.front().is_some_and(|oldest| is_over(oldest, self.held.len())) {
            let Some(oldest) = self.held.pop_front() else { break };
            self.evicted.extend(oldest.withheld.map(|group| (group, oldest.frame)));
        }
        self.held.push_back(HeldFrame { frame: *frame, is_counted, withheld: None });
    }

    /// Whether a pair had an exchange with other data before; the present one is stored.
    fn is_second_exchange(&mut self, request: (CanId, &[u8]), response: (CanId, &[u8])) -> bool {
        let of_pair = |pair: &&SuspectedPair| (pair.request, pair.response) == (request.0, response.0);
        if let Some(known) = self.suspects.iter().find(of_pair) {
            return known.data.0 != request.1 || known.data.1 != response.1;
        }
        if self.suspects.len() >= SUSPECTED_PAIRS {
            self.suspects.remove(0);
        }
        let data = (request.1.to_vec(), response.1.to_vec());
        self.suspects.push(SuspectedPair { request: request.0, response: response.0, data });
        false
    }

    /// Bytes held.
    pub(in crate::session) fn memory_size(&self) -> usize {
        self.held.capacity() * size_of::<HeldFrame>()
            + self.evicted.capacity() * size_of::<((usize, J1939Id), Frame)>()
            + self.suspects.capacity() * size_of::<SuspectedPair>()
    }
}

/// Whether the user named the device at one end of a link, or one end sends on a known link: the other end is a further
/// server, or has changed its address.
pub(in crate::session) fn has_known_end(link: UdsLink, cx: &MachineContext<'_>) -> bool {
    if cx.bus.routes.has_sender_of(link) {
        return true;
    }
    let ends = [link.server_address(), link.opposite_link().server_address()];
    ends.into_iter().flatten().any(|address| {
        let named = &cx.bus.protocols.named;
        named.contains(NodeId::Canopen(address)) || named.contains(NodeId::J1939(address))
    })
}

/// Makes two identifiers a pair; returns the link of the requests.
fn assign_pair(request: CanId, response: CanId, cx: &mut MachineContext<'_>) -> UdsLink {
    let forth = UdsLink::link_of(request).filter(|_| are_mirrored(request, response));
    let links = match forth {
        Some(forth) => vec![(request, forth), (response, forth.opposite_link())],
        None => Arc::make_mut(&mut cx.bus.uds_pairs).add_pair(UdsPair {
            request,
            response,
            functional: None,
            name: Some(format!("UDS {response}")),
            extended_addressing: is_mixed(request),
        }),
    };
    for &(id, link) in &links {
        cx.bus.routes.assign_link(id, link);
    }
    links.first().map_or(UdsLink::Group(0), |(_, link)| *link)
}

/// Whether sender and receiver of one identifier are receiver and sender of the other, in a form of ISO-TP.
fn are_mirrored(request: CanId, response: CanId) -> bool {
    let links = UdsLink::link_of(request).zip(UdsLink::link_of(response));
    let group = |id: CanId| match id {
        CanId::Extended(id) => J1939Id::from_identifier(id).filter(|id| id.pgn.is_addressed()),
        CanId::Standard(_) => None,
    };
    let is_opposite = |one: J1939Id, other: J1939Id| {
        one.pgn == other.pgn && (one.source, one.destination) == (other.destination, other.source)
    };
    match links {
        Some((forth, back)) => forth.opposite_link() == back,
        None => {
            is_mixed(request)
                && group(request).zip(group(response)).is_some_and(|(one, other)| is_opposite(one, other))
        }
    }
}

/// Whether an identifier has the form of mixed addressing: an address byte precedes each message (ISO 15765-2 §10.3.5).
fn is_mixed(id: CanId) -> bool {
    let CanId::Extended(id) = id else { return false };
    J1939Id::from_identifier(id).is_some_and(|id| matches!(id.pgn, Pgn::MIXED_ADDRESSING | Pgn::MIXED_GROUP))
}

/// Bytes of an ISO-TP frame, without its address byte.
fn message_bytes(frame: &Frame) -> Option<&[u8]> {
    if is_mixed(frame.id) { frame.data().get(1..) } else { Some(frame.data()) }
}

/// Bytes of the message that a frame starts.
fn started_message(frame: &Frame) -> Option<&[u8]> {
    match isotp::parse(message_bytes(frame)?, frame.data().len()) {
        Ok(IsoTpFrame::Single { data } | IsoTpFrame::First { data, .. }) => Some(data),
        _ => None,
    }
}

/// Whether a message starts with a service identifier that is defined, as request or response.
fn is_service(data: &[u8]) -> bool {
    let is_known = |service: u8| {
        profile::uds_names().service_by_id(service & !ANSWER).is_some_and(|service| !service.is_obd())
    };
    match data {
        [NEGATIVE, service, _, ..] => service & ANSWER == 0 && is_known(*service),
        [service, ..] => is_known(*service),
        [] => false,
    }
}

/// Whether a message is the positive or negative response to a request.
fn answers_service(answer: &[u8], asked: &[u8]) -> bool {
    let Some(service) = asked.first().filter(|service| *service & ANSWER == 0) else { return false };
    match answer {
        [NEGATIVE, refused, _, ..] => refused == service,
        [positive, ..] => *positive == service | ANSWER,
        [] => false,
    }
}

/// Whether a positive response repeats the data or routine identifier of its request.
fn repeats_identifier(answer: &[u8], asked: &[u8]) -> bool {
    let Some(service) = asked.first().and_then(|service| profile::uds_names().service_by_id(*service)) else {
        return false;
    };
    let identifier =
        |shape: ServiceLayout, data: &[u8]| shape.identifier(data.get(1..)?, EmcyByteOrder::MsbFirst);
    let asked = identifier(service.request(), asked);
    asked.is_some() && answer.first() != Some(&NEGATIVE) && identifier(service.response(), answer) == asked
}
