//! UDS requests that wait for their response.
//!
//! A client sends one request at a time (ISO 14229-2 §9). Requests overlap while one is pending, if one is
//! sent to a group, or if a client does not wait. So each link has a short list of requests.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use super::transfer::MessageTransfer;
use crate::event::ExchangeOutcome;
use crate::session::bus::{UdsLink, UdsPairs};
use crate::session::limits::EXCHANGE_LIMIT;
use crate::wire::uds::UdsSubFunction;

/// Time in ns without a response after which a request ends; it starts again with each response-pending
/// message (P2*server_max by default, ISO 14229-2 §7.2).
pub(super) const SILENCE: i64 = 5_000_000_000;

/// Default response time of a server in ns (P2server_max); after it, a client that repeats the request has
/// ended the first one.
const ANSWER_TIME: i64 = 50_000_000;

/// Time in ns after which a request with suppressed response ends: four times the time for a negative or
/// response-pending message.
const REFUSAL_TIME: i64 = 4 * ANSWER_TIME;

/// Max waiting requests per link.
const LINK_LIMIT: usize = 8;

/// A waiting request.
#[derive(Debug, Clone)]
pub(super) struct WaitingRequest {
    /// Link of the request.
    pub(super) link: UdsLink,
    pub(super) service: u8,
    pub(super) sub_function: Option<UdsSubFunction>,
    pub(super) identifier: Option<u16>,
    pub(super) request: Box<MessageTransfer>,
    /// Number of response-pending messages.
    pub(super) pending: u32,
    /// A server responded to a request to a group.
    pub(super) is_answered: bool,
    /// Monotonic time of the request, or of its last response-pending message.
    pub(super) last: i64,
    deadline: i64,
}

impl WaitingRequest {
    /// Creates a request whose last frame arrived at monotonic time `now`.
    pub(super) fn new(link: UdsLink, service: u8, request: Box<MessageTransfer>, now: i64) -> Self {
        Self {
            link,
            service,
            sub_function: None,
            identifier: None,
            request,
            pending: 0,
            is_answered: false,
            last: now,
            deadline: now.saturating_add(SILENCE),
        }
    }

    /// Outcome without a further response; `None` if there was a response.
    pub(super) fn unanswered_outcome(&self) -> Option<ExchangeOutcome> {
        match (self.is_answered, self.is_suppressed() && self.pending == 0) {
            (true, _) => None,
            (false, true) => Some(ExchangeOutcome::Suppressed),
            (false, false) => Some(ExchangeOutcome::NoAnswer),
        }
    }

    /// Whether the positive response is suppressed (suppressPosRspMsgIndicationBit).
    fn is_suppressed(&self) -> bool {
        self.sub_function.is_some_and(|it| it.suppress_response)
    }

    fn take_pending(&mut self, now: i64) {
        self.pending = self.pending.saturating_add(1);
        self.last = now;
        self.deadline = now.saturating_add(SILENCE);
    }
}

/// Requests of one link, oldest first.
#[derive(Debug, Clone, Default)]
struct PendingRequests {
    exchanges: Vec<WaitingRequest>,
    /// Monotonic time of the first entry in the timer queue.
    queued: Option<i64>,
}

/// Contents of a response.
#[derive(Debug, Clone, Copy)]
pub(super) struct ResponseHeader {
    pub(super) service: u8,
    /// Identifier repeated in the response.
    pub(super) identifier: Option<u16>,
    /// Response pending (NRC 78).
    pub(super) is_pending: bool,
}

/// All waiting requests of a bus.
#[derive(Debug, Clone, Default)]
pub(super) struct WaitingRequests {
    waiting: HashMap<UdsLink, PendingRequests, FixedState>,
    count: usize,
    open_bytes: usize,
    refused: bool,
}

impl WaitingRequests {
    /// Adds a request; returns the requests that it ends.
    pub(super) fn begin_request(&mut self, mut exchange: WaitingRequest, now: i64) -> Vec<WaitingRequest> {
        if exchange.is_suppressed() {
            exchange.deadline = now.saturating_add(REFUSAL_TIME);
        }
        let mut ended = Vec::new();
        let link = exchange.link;
        let given_up = |old: &WaitingRequest| {
            old.service == exchange.service
                && old.pending == 0
                && (now.saturating_sub(old.last) >= ANSWER_TIME || old.identifier == exchange.identifier)
        };
        while let Some(old) = self.take_request(link, given_up) {
            ended.push(old);
        }
        if self.waiting.get(&link).is_some_and(|waiting| waiting.exchanges.len() >= LINK_LIMIT) {
            ended.extend(self.take_request(link, |_| true));
        }
        if self.count >= EXCHANGE_LIMIT {
            self.refused = true;
            return ended;
        }
        self.add_request(exchange);
        ended
    }

    fn add_request(&mut self, exchange: WaitingRequest) {
        self.count += 1;
        self.open_bytes += exchange.request.data.len();
        self.waiting.entry(exchange.link).or_default().exchanges.push(exchange);
    }

    /// Removes and returns the oldest request of a link for which `fits` is true.
    fn take_request(
        &mut self,
        link: UdsLink,
        fits: impl Fn(&WaitingRequest) -> bool,
    ) -> Option<WaitingRequest> {
        let waiting = self.waiting.get_mut(&link)?;
        let place = waiting.exchanges.iter().position(fits)?;
        let exchange = waiting.exchanges.remove(place);
        self.forget_request(&exchange);
        self.remove_idle_link(link);
        Some(exchange)
    }

    fn forget_request(&mut self, exchange: &WaitingRequest) {
        self.count = self.count.saturating_sub(1);
        self.open_bytes = self.open_bytes.saturating_sub(exchange.request.data.len());
    }

    /// Removes a link without requests and without an entry in the timer queue.
    fn remove_idle_link(&mut self, link: UdsLink) {
        if self
            .waiting
            .get(&link)
            .is_some_and(|waiting| waiting.exchanges.is_empty() && waiting.queued.is_none())
        {
            self.waiting.remove(&link);
        }
    }

    /// Request for a response on `link`. A pending request remains; a request to a group remains for the
    /// responses of other servers.
    pub(super) fn on_response(
        &mut self,
        link: UdsLink,
        answer: ResponseHeader,
        now: i64,
        pairs: &UdsPairs,
    ) -> Option<WaitingRequest> {
        let own = self.find_request(link.opposite_link(), answer);
        let (at, place) = own.map(|place| (link.opposite_link(), place)).or_else(|| {
            let mut groups: Vec<UdsLink> =
                self.waiting.keys().copied().filter(|it| pairs.reaches_server(*it, link)).collect();
            groups.sort_unstable();
            groups.into_iter().find_map(|group| Some((group, self.find_request(group, answer)?)))
        })?;
        let exchange = self.waiting.get_mut(&at)?.exchanges.get_mut(place)?;
        if at == link.opposite_link() {
            if answer.is_pending {
                exchange.take_pending(now);
                return Some(exchange.clone());
            }
            let exchange = self.waiting.get_mut(&at)?.exchanges.remove(place);
            self.forget_request(&exchange);
            self.remove_idle_link(at);
            return Some(exchange);
        }
        exchange.is_answered = true;
        let mut single = exchange.clone();
        (single.link, single.is_answered) = (link.opposite_link(), false);
        if answer.is_pending {
            single.take_pending(now);
            if self.count < EXCHANGE_LIMIT {
                self.add_request(single.clone());
            } else {
                self.refused = true;
            }
        }
        Some(single)
    }

    /// Index of the request for a response: with equal identifier, otherwise the oldest with equal service and without
    /// another identifier.
    fn find_request(&self, link: UdsLink, answer: ResponseHeader) -> Option<usize> {
        let exchanges = &self.waiting.get(&link)?.exchanges;
        // A response echoes the identifier of its request (ISO 14229-1 §11.2.3): another one answers another request.
        let is_other = |it: &WaitingRequest| matches!((it.identifier, answer.identifier), (Some(asked), Some(echoed)) if asked != echoed);
        let same = |it: &WaitingRequest| it.service == answer.service && !is_other(it);
        let exact = |it: &WaitingRequest| same(it) && it.identifier == answer.identifier;
        let exact = answer.identifier.and_then(|_| exchanges.iter().position(exact));
        exact.or_else(|| exchanges.iter().position(same))
    }

    /// Deadline of a link that must be added to the timer queue; `None` if queued already.
    pub(super) fn arm_timer(&mut self, link: UdsLink) -> Option<i64> {
        let waiting = self.waiting.get_mut(&link)?;
        let deadline = waiting.exchanges.iter().map(|exchange| exchange.deadline).min()?;
        let is_first = waiting.queued.is_none_or(|queued| deadline < queued);
        is_first.then(|| *waiting.queued.insert(deadline))
    }

    /// Removes the requests that timed out when the timer entry of a link is due; returns them with their
    /// deadlines. While a response is being transferred (`is_answering`), requests continue to wait.
    pub(super) fn take_expired(
        &mut self,
        link: UdsLink,
        now: i64,
        is_answering: bool,
    ) -> Vec<(WaitingRequest, i64)> {
        let Some(waiting) = self.waiting.get_mut(&link) else { return Vec::new() };
        waiting.queued = waiting.queued.filter(|queued| *queued > now);
        if is_answering {
            for exchange in &mut waiting.exchanges {
                exchange.deadline = exchange.deadline.max(now.saturating_add(SILENCE));
            }
        }
        let mut over = Vec::new();
        while let Some(exchange) = self.take_request(link, |exchange| exchange.deadline < now) {
            let deadline = exchange.deadline;
            over.push((exchange, deadline));
        }
        self.remove_idle_link(link);
        over
    }

    /// Postpones all deadlines by `delay` ns.
    pub(super) fn postpone_deadlines(&mut self, delay: i64) {
        for exchange in self.waiting.values_mut().flat_map(|waiting| &mut waiting.exchanges) {
            exchange.deadline = exchange.deadline.saturating_add(delay);
            exchange.last = exchange.last.saturating_add(delay);
        }
    }

    /// Removes and returns all requests in the order of their start.
    pub(super) fn drain_requests(&mut self) -> Vec<WaitingRequest> {
        (self.count, self.open_bytes) = (0, 0);
        let mut all: Vec<_> = self.waiting.drain().flat_map(|(_, waiting)| waiting.exchanges).collect();
        all.sort_by_key(|exchange| exchange.request.frames.first);
        all
    }

    /// Whether a request of a link waits for a response.
    pub(super) fn is_waiting(&self, link: UdsLink) -> bool {
        self.waiting.get(&link).is_some_and(|waiting| !waiting.exchanges.is_empty())
    }

    /// Bytes of all waiting requests.
    pub(super) fn open_bytes(&self) -> usize {
        self.open_bytes
    }

    /// Whether a request was rejected, because the table is full, since the last call.
    pub(super) fn take_refused(&mut self) -> bool {
        std::mem::take(&mut self.refused)
    }

    /// Bytes held by the table.
    pub(super) fn footprint(&self) -> usize {
        let exchanges = self.waiting.values().flat_map(|waiting| &waiting.exchanges);
        self.waiting.capacity() * size_of::<(UdsLink, PendingRequests)>()
            + exchanges.map(|it| size_of::<WaitingRequest>() + it.request.footprint()).sum::<usize>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{CanId, Frame};

    const MS: i64 = 1_000_000;

    fn link(id: u32) -> UdsLink {
        UdsLink::link_of(CanId::from_extended(id)).unwrap()
    }

    fn request(id: u32, service: u8, identifier: Option<u16>, now: i64) -> WaitingRequest {
        let frame = Frame::data_frame(CanId::from_extended(id), &[]);
        let transfer = Box::new(MessageTransfer::from_single_frame(&frame, None, &[service]));
        WaitingRequest { identifier, ..WaitingRequest::new(link(id), service, transfer, now) }
    }

    fn on_response(service: u8, identifier: Option<u16>) -> ResponseHeader {
        ResponseHeader { service, identifier, is_pending: false }
    }

    const THERE: u32 = 0x18DA_20F1;
    const BACK: u32 = 0x18DA_F120;
    const GROUP: u32 = 0x18DB_33F1;

    #[test]
    fn an_answer_finds_its_identifier() {
        let (mut all, pairs) = (WaitingRequests::default(), UdsPairs::default());
        assert!(all.begin_request(request(THERE, 0x22, Some(1), 0), 0).is_empty());
        assert!(all.begin_request(request(THERE, 0x22, Some(2), MS), MS).is_empty());
        let found = all.on_response(link(BACK), on_response(0x22, Some(2)), MS, &pairs).unwrap();
        assert_eq!(found.identifier, Some(2));
        // A negative response does not contain the identifier.
        let found = all.on_response(link(BACK), on_response(0x22, None), MS, &pairs).unwrap();
        assert_eq!(found.identifier, Some(1));
        assert!(all.on_response(link(BACK), on_response(0x22, None), MS, &pairs).is_none());
        assert!(all.on_response(link(THERE), on_response(0x22, None), MS, &pairs).is_none());
        assert_eq!((all.count, all.open_bytes), (0, 0));
    }

    #[test]
    fn a_client_that_asks_again_has_given_up() {
        let mut all = WaitingRequests::default();
        all.begin_request(request(THERE, 0x22, Some(1), 0), 0);
        assert_eq!(all.begin_request(request(THERE, 0x22, Some(1), MS), MS).len(), 1, "the same again");
        assert_eq!(all.begin_request(request(THERE, 0x22, Some(2), 60 * MS), 60 * MS).len(), 1, "P2 is over");
        assert!(
            all.begin_request(request(THERE, 0x3E, None, 120 * MS), 120 * MS).is_empty(),
            "another service"
        );
    }

    #[test]
    fn a_pending_request_waits_again() {
        let (mut all, pairs) = (WaitingRequests::default(), UdsPairs::default());
        all.begin_request(request(THERE, 0x31, None, 0), 0);
        assert_eq!(all.arm_timer(link(THERE)), Some(SILENCE));
        let pending = ResponseHeader { is_pending: true, ..on_response(0x31, None) };
        all.on_response(link(BACK), pending, 4_000 * MS, &pairs);
        assert!(all.take_expired(link(THERE), SILENCE + 1, false).is_empty());
        assert_eq!(all.arm_timer(link(THERE)), Some(4_000 * MS + SILENCE));
        let over = all.take_expired(link(THERE), 10_000 * MS, false);
        assert_eq!((over[0].0.pending, over[0].1), (1, 4_000 * MS + SILENCE));
        assert_eq!(over[0].0.unanswered_outcome(), Some(ExchangeOutcome::NoAnswer));
        assert!(all.waiting.is_empty());
    }

    #[test]
    fn several_servers_answer_a_request_to_all() {
        let (mut all, pairs) = (WaitingRequests::default(), UdsPairs::default());
        all.begin_request(request(GROUP, 0x3E, None, 0), 0);
        for server in [0x20_u32, 0x21] {
            let found =
                all.on_response(link(0x18DA_F100 | server), on_response(0x3E, None), MS, &pairs).unwrap();
            assert_eq!(found.link.server_address(), u8::try_from(server).ok());
        }
        assert!(
            all.on_response(link(0x18DA_F220), on_response(0x3E, None), MS, &pairs).is_none(),
            "another client's"
        );
        let pending = ResponseHeader { is_pending: true, ..on_response(0x3E, None) };
        all.on_response(link(0x18DA_F122), pending, MS, &pairs);
        let found = all.on_response(link(0x18DA_F122), on_response(0x3E, None), 2 * MS, &pairs).unwrap();
        assert_eq!(found.pending, 1);
        let over = all.take_expired(link(GROUP), SILENCE + 1, false);
        assert_eq!(over[0].0.unanswered_outcome(), None, "it was answered");
    }

    #[test]
    fn as_many_wait_as_the_limits_allow() {
        let mut all = WaitingRequests::default();
        for identifier in 0..u16::try_from(LINK_LIMIT).unwrap() {
            assert!(all.begin_request(request(THERE, 0x22, Some(identifier), 0), 0).is_empty());
        }
        let ended = all.begin_request(request(THERE, 0x22, Some(99), 0), 0);
        assert_eq!((ended.len(), ended[0].identifier), (1, Some(0)), "the oldest goes");
        let mut number = 0;
        while !all.take_refused() {
            number += 1;
            all.begin_request(request(0x18DA_0000 | number, 0x3E, None, 0), 0);
        }
        assert_eq!(all.drain_requests().len(), EXCHANGE_LIMIT);
    }
}
