//! Matches UDS responses with their requests.

use std::sync::Arc;

use super::exchange::{Exchange, Exchanges, ResponseHeader};
use super::isotp::CompleteMessage;
use super::transfer::Transfer;
use crate::event::{EventKind, EvictedState, ExchangeOutcome, FrameRange, Message, UdsExchange};
use crate::frame::Frame;
use crate::profile::device::UdsIdentifier;
use crate::profile::{self, Role, integer};
use crate::session::bus::{Bus, Link};
use crate::session::context::Context;
use crate::session::device::{Announcement, emit_announcement};
use crate::session::machine::{Machine, Timed};
use crate::session::presence::mark_alive;
use crate::session::timers::Subject;
use crate::wire::NodeId;
use crate::wire::canopen::emcy::ByteOrder;
use crate::wire::isotp;
use crate::wire::uds::{self, RESPONSE_PENDING, ServiceLayout, Uds as Parsed};

/// Tester present, repeated to keep a session open.
const TESTER_PRESENT: u8 = 0x3E;

/// A final response.
struct FinalResponse {
    /// Link of the response.
    link: Link,
    transfer: Box<Transfer>,
    service: u8,
    nrc: Option<u8>,
}

/// UDS requests of a bus and their responses.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct Uds {
    exchanges: Exchanges,
}

impl Machine for Uds {
    type Route<'a> = CompleteMessage;
    type Product = ();

    fn on_frame(&mut self, message: CompleteMessage, frame: &Frame, cx: &mut Context<'_>) {
        self.on_message(message, frame, cx);
        if self.exchanges.take_refused() {
            cx.emit_can(frame, EventKind::Evicted { what: EvictedState::UdsRequest, count: 1 });
        }
        cx.open_data.uds = self.exchanges.open_bytes();
    }

    fn on_silence(&mut self, delay: i64, _: &mut Bus) {
        self.exchanges.postpone(delay);
    }

    /// Ends requests without response as unfinished.
    fn on_end(&mut self, cx: &mut Context<'_>) {
        let frame = cx.last_frame();
        for exchange in self.exchanges.drain() {
            end_unanswered(&exchange, Some(ExchangeOutcome::Unfinished), &frame, cx);
        }
    }

    fn footprint(&self) -> usize {
        self.exchanges.footprint()
    }
}

impl Timed for Uds {
    /// Link of requests, and whether a response to one of them is being transferred.
    type Deadline = (Link, bool);

    fn on_deadline(&mut self, (link, is_answering): (Link, bool), now: i64, cx: &mut Context<'_>) {
        for (exchange, deadline) in self.exchanges.due(link, now, is_answering) {
            let mut frame = Frame { number: exchange.request.frames.last, ..Frame::EMPTY };
            frame.time = cx.bus.clock.stamp_of(deadline);
            end_unanswered(&exchange, None, &frame, cx);
        }
        cx.open_data.uds = self.exchanges.open_bytes();
        self.arm(link, cx);
    }
}

impl Uds {
    fn on_message(&mut self, message: CompleteMessage, frame: &Frame, cx: &mut Context<'_>) {
        let CompleteMessage { link, transfer } = message;
        let (service, nrc) = match uds::parse(&transfer.data) {
            Ok(Parsed::Request { service, .. }) => {
                return self.on_request(link, service, transfer, frame, cx);
            }
            Ok(Parsed::Positive { service, .. }) => (service, None),
            Ok(Parsed::Negative { service, code }) => (service, Some(code)),
            Err(error) => return cx.emit_malformed_uds(frame, error, "too short for a UDS response"),
        };
        if let Some(NodeId::Canopen(server)) = uds_node(&cx.bus, link.back()) {
            mark_alive(NodeId::Canopen(server), frame, cx);
        }
        let now = cx.bus.clock.now();
        let is_pending = nrc == Some(RESPONSE_PENDING);
        let shape = profile::uds().service(service).filter(|_| nrc.is_none());
        let shape = shape.map_or_else(ServiceLayout::default, profile::UdsService::response);
        let order = identifier_order(&cx.bus, link.back());
        let identifier = shape.identifier(transfer.data.get(1..).unwrap_or_default(), order);
        let answer = ResponseHeader { service, identifier, is_pending };
        let pairs = Arc::clone(&cx.bus.uds_pairs);
        let exchange = self.exchanges.answer(link, answer, now, &pairs);
        if is_pending && exchange.is_some() {
            return self.arm(link.back(), cx);
        }
        conclude(exchange.as_ref(), &FinalResponse { link, transfer, service, nrc }, frame, cx);
    }

    /// Whether a request of a link waits for a response.
    pub(in crate::session) fn is_waiting(&self, link: Link) -> bool {
        self.exchanges.is_waiting(link)
    }

    /// Begins an exchange with a request of one frame that was not decoded.
    pub(in crate::session) fn begin_unseen(
        &mut self,
        link: Link,
        request: &Frame,
        frame: &Frame,
        cx: &mut Context<'_>,
    ) {
        if let Ok(isotp::IsoTp::Single { data }) = isotp::parse(request.data(), request.data().len())
            && let Some(service) = data.first()
        {
            let transfer = Box::new(Transfer::single(request, None, data));
            self.on_request(link, *service, transfer, frame, cx);
        }
    }

    fn on_request(
        &mut self,
        link: Link,
        service: u8,
        transfer: Box<Transfer>,
        frame: &Frame,
        cx: &mut Context<'_>,
    ) {
        let now = cx.bus.clock.now();
        let shape =
            profile::uds().service(service).map_or_else(ServiceLayout::default, profile::UdsService::request);
        let data = transfer.data.get(1..).unwrap_or_default();
        let sub_function = shape.sub_function(data);
        let identifier = shape.identifier(data, identifier_order(&cx.bus, link));
        let mut exchange = Exchange::new(link, service, transfer, now);
        (exchange.sub_function, exchange.identifier) = (sub_function, identifier);
        for ended in self.exchanges.begin(exchange, now) {
            end_unanswered(&ended, None, frame, cx);
        }
        self.arm(link, cx);
    }

    fn arm(&mut self, link: Link, cx: &mut Context<'_>) {
        if cx.bus.clock.runs()
            && let Some(deadline) = self.exchanges.arm(link)
        {
            cx.timers.add(deadline, Subject::UdsRequest(link));
        }
    }
}

/// Emits a request without final response; `instead` replaces the outcome "no response".
fn end_unanswered(
    exchange: &Exchange,
    instead: Option<ExchangeOutcome>,
    frame: &Frame,
    cx: &mut Context<'_>,
) {
    let Some(outcome) = exchange.unanswered() else { return };
    let outcome = instead.filter(|_| outcome == ExchangeOutcome::NoAnswer).unwrap_or(outcome);
    let told = describe_exchange(&cx.bus, exchange.link, exchange.service, Some(exchange), None, outcome);
    emit_exchange(exchange.link, told, exchange.request.frames, frame, cx);
}

/// Emits a final response with its request.
fn conclude(exchange: Option<&Exchange>, answer: &FinalResponse, frame: &Frame, cx: &mut Context<'_>) {
    let outcome = match (exchange, answer.nrc) {
        (None, _) => ExchangeOutcome::Unsolicited,
        (Some(_), Some(_)) => ExchangeOutcome::Negative,
        (Some(_), None) => ExchangeOutcome::Positive,
    };
    let server = answer.link.back();
    let mut frames = answer.transfer.frames;
    if let Some(exchange) = exchange {
        cx.bus.is_uds = true;
        frames = FrameRange { first: exchange.request.frames.first, last: frames.last };
    }
    let told = describe_exchange(&cx.bus, server, answer.service, exchange, Some(answer), outcome);
    let written = node_id_written(&cx.bus, server, &told);
    emit_exchange(server, told, frames, frame, cx);
    if let Some((from, to)) = written {
        cx.bus.node_id_changes.by_uds = Some((from, to));
        let text = format!("node-ID {} from the next boot-up", to.number());
        let change = Announcement { procedure: "node-ID change", word: "IDENT", finished: false, text };
        emit_announcement(from, change, frame, cx);
    }
}

/// Present node-ID of a server, and the accepted one for its next boot-up.
fn node_id_written(bus: &Bus, server: Link, told: &UdsExchange) -> Option<(NodeId, NodeId)> {
    let is_node_id = told.meaning.as_ref().is_some_and(|meaning| meaning.role == Some(Role::NodeId));
    if !is_write(told.service) || !is_node_id || told.outcome != ExchangeOutcome::Positive {
        return None;
    }
    let from = uds_node(bus, server)?;
    let to = u8::try_from(integer(&told.decoded()?)?).ok().map(NodeId::Canopen)?;
    (matches!(from, NodeId::Canopen(_)) && to.is_valid() && from != to).then_some((from, to))
}

/// Node that receives requests of `link`. In a CANopen network, addresses below 0x80 are node-IDs.
fn uds_node(bus: &Bus, link: Link) -> Option<NodeId> {
    let address = link.server()?;
    let canopen = Some(NodeId::Canopen(address)).filter(|id| bus.is_settled(Some(*id)) && id.is_valid());
    canopen.or(Some(NodeId::J1939(address))).filter(|id| id.is_valid())
}

fn identifier_order(bus: &Bus, link: Link) -> ByteOrder {
    let node = uds_node(bus, link).and_then(|id| bus.node(id));
    node.map_or(ByteOrder::MsbFirst, |node| node.device.uds.order())
}

fn emit_exchange(link: Link, told: UdsExchange, frames: FrameRange, frame: &Frame, cx: &mut Context<'_>) {
    let routine = told.service == TESTER_PRESENT
        && matches!(told.outcome, ExchangeOutcome::Positive | ExchangeOutcome::Suppressed);
    let kind = EventKind::UdsExchange(Box::new(told));
    let mut event = cx.uds_event(frame, frames, uds_node(&cx.bus, link), kind);
    event.routine = routine;
    cx.send(&event);
}

/// Event of a request and its response; `link` is that of the request.
fn describe_exchange(
    bus: &Bus,
    link: Link,
    service: u8,
    exchange: Option<&Exchange>,
    answer: Option<&FinalResponse>,
    outcome: ExchangeOutcome,
) -> UdsExchange {
    let order = identifier_order(bus, link);
    let identifier = match exchange {
        Some(exchange) => exchange.identifier,
        None => answer.and_then(|answer| {
            let shape = profile::uds().service(service).filter(|_| answer.nrc.is_none())?.response();
            shape.identifier(answer.transfer.data.get(1..)?, order)
        }),
    };
    let sub_function = exchange.and_then(|exchange| exchange.sub_function).or_else(|| {
        let answer = answer.filter(|answer| answer.nrc.is_none())?;
        let shape = profile::uds().service(service)?.response();
        shape.sub_function(answer.transfer.data.get(1..)?)
    });
    let node = uds_node(bus, link).and_then(|id| bus.node(id));
    let known = identifier.and_then(|id| node?.device.uds.identifier(id));
    let asked = exchange.map(|exchange| &exchange.request);
    let answered = answer.map(|answer| &answer.transfer);
    let between = |from: Option<i64>, to: Option<i64>| Some(to?.saturating_sub(from?));
    UdsExchange {
        ends: bus.uds_pairs.ends(link),
        service,
        sub_function,
        identifier,
        meaning: known.map(|known| Arc::new(known.meaning())),
        effect: known.filter(|_| outcome == ExchangeOutcome::Positive && is_write(service)).and_then(effect),
        order,
        request: asked.map(|transfer| message(transfer)),
        outcome,
        nrc: answer.and_then(|answer| answer.nrc),
        pending: exchange.map_or(0, |exchange| exchange.pending),
        latency: between(
            asked.and_then(|asked| asked.last_time),
            answered.and_then(|answered| answered.first_time),
        ),
        duration: between(
            asked.and_then(|asked| asked.first_time),
            answered.and_then(|answered| answered.last_time),
        ),
        response: answered.map(|transfer| message(transfer)),
    }
}

/// Whether a service writes the value of an identifier.
fn is_write(service: u8) -> bool {
    let service = profile::uds().service(service);
    service.and_then(profile::UdsService::value_in) == Some(profile::ValueIn::Request)
}

/// Effect of a write, if the profile defines it.
fn effect(known: &UdsIdentifier) -> Option<profile::Effect> {
    Some(known.effect).filter(|effect| *effect != profile::Effect::Unknown)
}

fn message(transfer: &Transfer) -> Message {
    Message {
        id: transfer.id,
        data: transfer.data.clone(),
        size: transfer.size(),
        truncated: transfer.truncated,
        frames: transfer.frames,
    }
}
