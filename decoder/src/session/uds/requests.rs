//! Matches UDS responses with their requests.

use std::sync::Arc;

use super::exchange::{ResponseHeader, WaitingRequest, WaitingRequests};
use super::isotp::CompleteMessage;
use super::transfer::MessageTransfer;
use crate::event::{EventKind, EvictedState, ExchangeOutcome, FrameRange, UdsExchange, UdsMessage};
use crate::frame::Frame;
use crate::profile::device::UdsIdentifier;
use crate::profile::{self, ObjectRole, as_integer};
use crate::session::bus::{Bus, UdsLink};
use crate::session::context::MachineContext;
use crate::session::device::{SettingAnnouncement, emit_announcement};
use crate::session::machine::{ProtocolMachine, TimedMachine};
use crate::session::presence::mark_alive;
use crate::session::timers::DeadlineSubject;
use crate::wire::NodeId;
use crate::wire::canopen::emcy::EmcyByteOrder;
use crate::wire::isotp;
use crate::wire::uds::{self, RESPONSE_PENDING, ServiceLayout, UdsPdu as Parsed};

/// Tester present, repeated to keep a session open.
const TESTER_PRESENT: u8 = 0x3E;

/// A final response.
struct FinalResponse {
    /// Link of the response.
    link: UdsLink,
    transfer: Box<MessageTransfer>,
    service: u8,
    nrc: Option<u8>,
}

/// UDS requests of a bus and their responses.
#[derive(Debug, Clone, Default)]
pub(in crate::session) struct UdsMachine {
    exchanges: WaitingRequests,
}

impl ProtocolMachine for UdsMachine {
    type Route<'a> = CompleteMessage;
    type Product = ();

    fn on_frame(&mut self, message: CompleteMessage, frame: &Frame, cx: &mut MachineContext<'_>) {
        self.on_message(message, frame, cx);
        if self.exchanges.take_refused() {
            cx.emit_can(frame, EventKind::Evicted { what: EvictedState::UdsRequest, count: 1 });
        }
        cx.open_data.uds = self.exchanges.open_bytes();
    }

    fn on_silence(&mut self, delay: i64, _: &mut Bus) {
        self.exchanges.postpone_deadlines(delay);
    }

    /// Ends requests without response as unfinished.
    fn on_end(&mut self, cx: &mut MachineContext<'_>) {
        let frame = cx.last_frame();
        for exchange in self.exchanges.drain_requests() {
            end_unanswered(&exchange, Some(ExchangeOutcome::Unfinished), &frame, cx);
        }
    }

    fn memory_size(&self) -> usize {
        self.exchanges.footprint()
    }
}

impl TimedMachine for UdsMachine {
    /// Link of requests, and whether a response to one of them is being transferred.
    type Deadline = (UdsLink, bool);

    fn on_deadline(&mut self, (link, is_answering): (UdsLink, bool), now: i64, cx: &mut MachineContext<'_>) {
        for (exchange, deadline) in self.exchanges.take_expired(link, now, is_answering) {
            let mut frame = Frame { number: exchange.request.frames.last, ..Frame::EMPTY };
            frame.time = cx.bus.clock.stamp_of(deadline);
            end_unanswered(&exchange, None, &frame, cx);
        }
        cx.open_data.uds = self.exchanges.open_bytes();
        self.arm_timer(link, cx);
    }
}

impl UdsMachine {
    fn on_message(&mut self, message: CompleteMessage, frame: &Frame, cx: &mut MachineContext<'_>) {
        let CompleteMessage { link, transfer } = message;
        let (service, nrc) = match uds::parse(&transfer.data) {
            Ok(Parsed::Request { service, .. }) => {
                return self.on_request(link, service, transfer, frame, cx);
            }
            Ok(Parsed::Positive { service, .. }) => (service, None),
            Ok(Parsed::Negative { service, code }) => (service, Some(code)),
            Err(error) => return cx.emit_malformed_uds(frame, error, "too short for a UDS response"),
        };
        if let Some(NodeId::Canopen(server)) = uds_node(&cx.bus, link.opposite_link()) {
            mark_alive(NodeId::Canopen(server), frame, cx);
        }
        let now = cx.bus.clock.now();
        let is_pending = nrc == Some(RESPONSE_PENDING);
        let shape = profile::uds_names().service_by_id(service).filter(|_| nrc.is_none());
        let shape = shape.map_or_else(ServiceLayout::default, profile::UdsService::response);
        let order = identifier_order(&cx.bus, link.opposite_link());
        let identifier = shape.identifier(transfer.data.get(1..).unwrap_or_default(), order);
        let answer = ResponseHeader { service, identifier, is_pending };
        let pairs = Arc::clone(&cx.bus.uds_pairs);
        let exchange = self.exchanges.on_response(link, answer, now, &pairs);
        if is_pending && exchange.is_some() {
            return self.arm_timer(link.opposite_link(), cx);
        }
        emit_response(exchange.as_ref(), &FinalResponse { link, transfer, service, nrc }, frame, cx);
    }

    /// Whether a request of a link waits for a response.
    pub(in crate::session) fn is_waiting(&self, link: UdsLink) -> bool {
        self.exchanges.is_waiting(link)
    }

    /// Begins an exchange with a request of one frame that was not decoded.
    pub(in crate::session) fn begin_unseen(
        &mut self,
        link: UdsLink,
        request: &Frame,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) {
        if let Ok(isotp::IsoTpFrame::Single { data }) = isotp::parse(request.data(), request.data().len())
            && let Some(service) = data.first()
        {
            let transfer = Box::new(MessageTransfer::from_single_frame(request, None, data));
            self.on_request(link, *service, transfer, frame, cx);
        }
    }

    fn on_request(
        &mut self,
        link: UdsLink,
        service: u8,
        transfer: Box<MessageTransfer>,
        frame: &Frame,
        cx: &mut MachineContext<'_>,
    ) {
        let now = cx.bus.clock.now();
        let shape = profile::uds_names()
            .service_by_id(service)
            .map_or_else(ServiceLayout::default, profile::UdsService::request);
        let data = transfer.data.get(1..).unwrap_or_default();
        let sub_function = shape.sub_function(data);
        let identifier = shape.identifier(data, identifier_order(&cx.bus, link));
        let mut exchange = WaitingRequest::new(link, service, transfer, now);
        (exchange.sub_function, exchange.identifier) = (sub_function, identifier);
        for ended in self.exchanges.begin_request(exchange, now) {
            end_unanswered(&ended, None, frame, cx);
        }
        self.arm_timer(link, cx);
    }

    fn arm_timer(&mut self, link: UdsLink, cx: &mut MachineContext<'_>) {
        if cx.bus.clock.has_timestamps()
            && let Some(deadline) = self.exchanges.arm_timer(link)
        {
            cx.timers.add_deadline(deadline, DeadlineSubject::UdsRequest(link));
        }
    }
}

/// Emits a request without final response; `instead` replaces the outcome "no response".
fn end_unanswered(
    exchange: &WaitingRequest,
    instead: Option<ExchangeOutcome>,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let Some(outcome) = exchange.unanswered_outcome() else { return };
    let outcome = instead.filter(|_| outcome == ExchangeOutcome::NoAnswer).unwrap_or(outcome);
    let reported = describe_exchange(&cx.bus, exchange.link, exchange.service, Some(exchange), None, outcome);
    emit_exchange(exchange.link, reported, exchange.request.frames, frame, cx);
}

/// Emits a final response with its request.
fn emit_response(
    exchange: Option<&WaitingRequest>,
    answer: &FinalResponse,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let outcome = match (exchange, answer.nrc) {
        (None, _) => ExchangeOutcome::Unsolicited,
        (Some(_), Some(_)) => ExchangeOutcome::Negative,
        (Some(_), None) => ExchangeOutcome::Positive,
    };
    let server = answer.link.opposite_link();
    let mut frames = answer.transfer.frames;
    if let Some(exchange) = exchange {
        cx.bus.protocols.has_uds = true;
        frames = FrameRange { first: exchange.request.frames.first, last: frames.last };
    }
    let reported = describe_exchange(&cx.bus, server, answer.service, exchange, Some(answer), outcome);
    let written = node_id_written(&cx.bus, server, &reported);
    emit_exchange(server, reported, frames, frame, cx);
    if let Some((from, to)) = written {
        cx.bus.node_id_changes.by_uds = Some((from, to));
        let text = format!("node-ID {} from the next boot-up", to.number());
        let change =
            SettingAnnouncement { procedure: "node-ID change", word: "IDENT", finished: false, text };
        emit_announcement(from, change, frame, cx);
    }
}

/// Present node-ID of a server, and the accepted one for its next boot-up.
fn node_id_written(bus: &Bus, server: UdsLink, reported: &UdsExchange) -> Option<(NodeId, NodeId)> {
    let is_node_id =
        reported.meaning.as_ref().is_some_and(|meaning| meaning.role == Some(ObjectRole::NodeId));
    if !is_write(reported.service) || !is_node_id || reported.outcome != ExchangeOutcome::Positive {
        return None;
    }
    let from = uds_node(bus, server)?;
    let to = u8::try_from(as_integer(&reported.decoded_value()?)?).ok().map(NodeId::Canopen)?;
    (matches!(from, NodeId::Canopen(_)) && to.is_valid() && from != to).then_some((from, to))
}

/// Node that receives requests of `link`. In a CANopen network, addresses below 0x80 are node-IDs.
fn uds_node(bus: &Bus, link: UdsLink) -> Option<NodeId> {
    let address = link.server_address()?;
    let canopen =
        Some(NodeId::Canopen(address)).filter(|id| bus.protocols.is_settled(Some(*id)) && id.is_valid());
    canopen.or(Some(NodeId::J1939(address))).filter(|id| id.is_valid())
}

fn identifier_order(bus: &Bus, link: UdsLink) -> EmcyByteOrder {
    let node = uds_node(bus, link).and_then(|id| bus.node(id));
    node.map_or(EmcyByteOrder::MsbFirst, |node| node.device.uds.order())
}

fn emit_exchange(
    link: UdsLink,
    reported: UdsExchange,
    frames: FrameRange,
    frame: &Frame,
    cx: &mut MachineContext<'_>,
) {
    let routine = reported.service == TESTER_PRESENT
        && matches!(reported.outcome, ExchangeOutcome::Positive | ExchangeOutcome::Suppressed);
    let kind = EventKind::UdsExchange(Box::new(reported));
    let mut event = cx.uds_event(frame, frames, uds_node(&cx.bus, link), kind);
    event.routine = routine;
    cx.send_event(&event);
}

/// Event of a request and its response; `link` is that of the request.
fn describe_exchange(
    bus: &Bus,
    link: UdsLink,
    service: u8,
    exchange: Option<&WaitingRequest>,
    answer: Option<&FinalResponse>,
    outcome: ExchangeOutcome,
) -> UdsExchange {
    let order = identifier_order(bus, link);
    let identifier = match exchange {
        Some(exchange) => exchange.identifier,
        None => answer.and_then(|answer| {
            let shape =
                profile::uds_names().service_by_id(service).filter(|_| answer.nrc.is_none())?.response();
            shape.identifier(answer.transfer.data.get(1..)?, order)
        }),
    };
    let sub_function = exchange.and_then(|exchange| exchange.sub_function).or_else(|| {
        let answer = answer.filter(|answer| answer.nrc.is_none())?;
        let shape = profile::uds_names().service_by_id(service)?.response();
        shape.sub_function(answer.transfer.data.get(1..)?)
    });
    let node = uds_node(bus, link).and_then(|id| bus.node(id));
    let known = identifier.and_then(|id| node?.device.uds.identifier(id));
    let asked = exchange.map(|exchange| &exchange.request);
    let answered = answer.map(|answer| &answer.transfer);
    let between = |from: Option<i64>, to: Option<i64>| Some(to?.saturating_sub(from?));
    UdsExchange {
        ends: bus.uds_pairs.link_endpoints(link),
        service,
        sub_function,
        identifier,
        meaning: known.map(|known| Arc::new(known.meaning())),
        effect: known
            .filter(|_| outcome == ExchangeOutcome::Positive && is_write(service))
            .and_then(write_effect),
        order,
        request: asked.map(|transfer| to_message(transfer)),
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
        response: answered.map(|transfer| to_message(transfer)),
    }
}

/// Whether a service writes the value of an identifier.
fn is_write(service: u8) -> bool {
    let service = profile::uds_names().service_by_id(service);
    service.and_then(profile::UdsService::value_in) == Some(profile::ValueIn::Request)
}

/// Effect of a write, if the profile defines it.
fn write_effect(known: &UdsIdentifier) -> Option<profile::WriteEffect> {
    Some(known.effect).filter(|effect| *effect != profile::WriteEffect::Unknown)
}

fn to_message(transfer: &MessageTransfer) -> UdsMessage {
    UdsMessage {
        id: transfer.id,
        data: transfer.data.clone(),
        size: transfer.received_size(),
        truncated: transfer.truncated,
        frames: transfer.frames,
    }
}
