//! Requests meet their answers: what a whole UDS message does.

use std::sync::Arc;

use super::exchange::{Answer, Exchange};
use super::link::Link;
use super::transfer::Transfer;
use crate::event::{EventKind, ExchangeOutcome, FrameRange, Message, UdsExchange};
use crate::frame::Frame;
use crate::profile::device::UdsIdentifier;
use crate::profile::{self, Role, integer};
use crate::session::device::Announcement;
use crate::session::timers::Subject;
use crate::session::{Bus, Observer};
use crate::wire::NodeId;
use crate::wire::canopen::emcy::ByteOrder;
use crate::wire::uds::{self, RESPONSE_PENDING, Shape, Uds};

/// Tester present: a repetition that keeps a session alive.
const TESTER_PRESENT: u8 = 0x3E;

/// A final answer.
struct Final {
    /// The way it came.
    link: Link,
    transfer: Box<Transfer>,
    service: u8,
    nrc: Option<u8>,
}

impl Bus {
    /// A whole message.
    pub(super) fn on_uds(
        &mut self,
        link: Link,
        transfer: Box<Transfer>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let (service, nrc) = match uds::parse(&transfer.data) {
            Ok(Uds::Request { service, .. }) => return self.on_request(link, service, transfer, frame, out),
            Ok(Uds::Positive { service, .. }) => (service, None),
            Ok(Uds::Negative { service, code }) => (service, Some(code)),
            Err(error) => return self.uds_malformed(frame, error, "too short for a UDS response", out),
        };
        if let Some(NodeId::Canopen(server)) = self.uds_node(link.back()) {
            self.heard(NodeId::Canopen(server), frame, out);
        }
        let now = self.clock.now();
        let is_pending = nrc == Some(RESPONSE_PENDING);
        let shape = profile::uds().service(service).filter(|_| nrc.is_none());
        let shape = shape.map_or_else(Shape::default, profile::UdsService::response);
        let order = self.identifier_order(link.back());
        let identifier = shape.identifier(transfer.data.get(1..).unwrap_or_default(), order);
        let answer = Answer { service, identifier, is_pending };
        let pairs = Arc::clone(&self.uds.pairs);
        let exchange = self.uds.exchanges.answer(link, answer, now, &pairs);
        if is_pending && exchange.is_some() {
            return self.arm_exchanges(link.back());
        }
        self.conclude(exchange.as_ref(), &Final { link, transfer, service, nrc }, frame, out);
    }

    fn on_request(
        &mut self,
        link: Link,
        service: u8,
        transfer: Box<Transfer>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let now = self.clock.now();
        let shape = profile::uds().service(service).map_or_else(Shape::default, profile::UdsService::request);
        let data = transfer.data.get(1..).unwrap_or_default();
        let sub_function = shape.sub_function(data);
        let identifier = shape.identifier(data, self.identifier_order(link));
        let mut exchange = Exchange::new(link, service, transfer, now);
        (exchange.sub_function, exchange.identifier) = (sub_function, identifier);
        for ended in self.uds.exchanges.begin(exchange, now) {
            self.unanswered(&ended, None, frame, out);
        }
        self.arm_exchanges(link);
    }

    fn arm_exchanges(&mut self, link: Link) {
        if self.clock.runs()
            && let Some(deadline) = self.uds.exchanges.arm(link)
        {
            self.timers.add(deadline, Subject::UdsRequest(link));
        }
    }

    /// The timer entry of a link's requests came due.
    pub(in crate::session) fn uds_deadline(&mut self, link: Link, now: i64, out: &mut dyn Observer) {
        let is_answering = !link.is_functional() && self.uds.reassembly.is_open(link.back());
        for (exchange, deadline) in self.uds.exchanges.due(link, now, is_answering) {
            let mut frame = Frame { number: exchange.request.frames.last, ..Frame::EMPTY };
            frame.time = self.clock.stamp_of(deadline);
            self.unanswered(&exchange, None, &frame, out);
        }
        self.arm_exchanges(link);
    }

    /// The capture ends before the answer.
    pub(super) fn finish_exchanges(&mut self, frame: &Frame, out: &mut dyn Observer) {
        for exchange in self.uds.exchanges.drain() {
            self.unanswered(&exchange, Some(ExchangeOutcome::Unfinished), frame, out);
        }
    }

    /// A request ends without a final answer; `instead`: of no answer.
    fn unanswered(
        &self,
        exchange: &Exchange,
        instead: Option<ExchangeOutcome>,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let Some(outcome) = exchange.unanswered() else { return };
        let outcome = instead.filter(|_| outcome == ExchangeOutcome::NoAnswer).unwrap_or(outcome);
        let told = self.describe_exchange(exchange.link, exchange.service, Some(exchange), None, outcome);
        self.emit_exchange(exchange.link, told, exchange.request.frames, frame, out);
    }

    /// A final answer came.
    fn conclude(
        &mut self,
        exchange: Option<&Exchange>,
        answer: &Final,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let outcome = match (exchange, answer.nrc) {
            (None, _) => ExchangeOutcome::Unsolicited,
            (Some(_), Some(_)) => ExchangeOutcome::Negative,
            (Some(_), None) => ExchangeOutcome::Positive,
        };
        let server = answer.link.back();
        let mut frames = answer.transfer.frames;
        if let Some(exchange) = exchange {
            self.uds.is_spoken = true;
            frames = FrameRange { first: exchange.request.frames.first, last: frames.last };
        }
        let told = self.describe_exchange(server, answer.service, exchange, Some(answer), outcome);
        let written = self.node_id_written(server, &told);
        self.emit_exchange(server, told, frames, frame, out);
        if let Some((from, to)) = written {
            self.uds.accepted = Some((from, to));
            let text = format!("node-ID {} after its next start", to.number());
            let change = Announcement { procedure: "node-ID change", word: "IDENT", finished: false, text };
            self.announce(from, change, frame, out);
        }
    }

    /// The node-ID a server took over for its next start, and the one it has.
    fn node_id_written(&self, server: Link, told: &UdsExchange) -> Option<(NodeId, NodeId)> {
        let is_node_id = told.meaning.as_ref().is_some_and(|meaning| meaning.role == Some(Role::NodeId));
        if !is_write(told.service) || !is_node_id || told.outcome != ExchangeOutcome::Positive {
            return None;
        }
        let from = self.uds_node(server)?;
        let to = u8::try_from(integer(&told.decoded()?)?).ok().map(NodeId::Canopen)?;
        (matches!(from, NodeId::Canopen(_)) && to.is_valid() && from != to).then_some((from, to))
    }

    /// The node a request of `link` is for. Below 0x80 the addresses of a CANopen network are its node-IDs.
    fn uds_node(&self, link: Link) -> Option<NodeId> {
        let address = link.server()?;
        let canopen = Some(NodeId::Canopen(address)).filter(|id| self.belief.is_believed() && id.is_valid());
        canopen.or(Some(NodeId::J1939(address))).filter(|id| id.is_valid())
    }

    fn identifier_order(&self, link: Link) -> ByteOrder {
        let node = self.uds_node(link).and_then(|id| self.node(id));
        node.map_or(ByteOrder::MsbFirst, |node| node.device.uds.order())
    }

    fn emit_exchange(
        &self,
        link: Link,
        told: UdsExchange,
        frames: FrameRange,
        frame: &Frame,
        out: &mut dyn Observer,
    ) {
        let routine = told.service == TESTER_PRESENT
            && matches!(told.outcome, ExchangeOutcome::Positive | ExchangeOutcome::Suppressed);
        let kind = EventKind::UdsExchange(Box::new(told));
        let mut event = self.uds_event(frame, frames, self.uds_node(link), kind);
        event.routine = routine;
        out.event(&event, self);
    }

    /// A request and its answer as an event; `link` is that of the request.
    fn describe_exchange(
        &self,
        link: Link,
        service: u8,
        exchange: Option<&Exchange>,
        answer: Option<&Final>,
        outcome: ExchangeOutcome,
    ) -> UdsExchange {
        let order = self.identifier_order(link);
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
        let node = self.uds_node(link).and_then(|id| self.node(id));
        let known = identifier.and_then(|id| node?.device.uds.identifier(id));
        let asked = exchange.map(|exchange| &exchange.request);
        let answered = answer.map(|answer| &answer.transfer);
        let between = |from: Option<i64>, to: Option<i64>| Some(to?.saturating_sub(from?));
        UdsExchange {
            ends: self.uds.pairs.ends(link),
            service,
            sub_function,
            identifier,
            meaning: known.map(|known| Arc::new(known.meaning())),
            effect: known
                .filter(|_| outcome == ExchangeOutcome::Positive && is_write(service))
                .and_then(effect),
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
}

/// Whether a service writes the value of an identifier.
fn is_write(service: u8) -> bool {
    let service = profile::uds().service(service);
    service.and_then(profile::UdsService::value_in) == Some(profile::ValueIn::Request)
}

/// When a write acts, where the profile says so.
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
