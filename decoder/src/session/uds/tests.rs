//! Tests with frames on a bus.

use std::sync::Arc;

use crate::bus_file::BusFile;
use crate::event::{
    Event, EventKind, EventProtocol, ExchangeOutcome, FrameRange, MessageOutcome, UdsExchange,
};
use crate::frame::{BusIndex, CanId, Frame, FrameFlags, Timestamp};
use crate::session::BusDecoder;
use crate::session::bus::Bus;
use crate::session::options::SessionOptions;
use crate::wire::NodeId;

const MS: i64 = 1_000_000;

/// A bus, its events, and the time.
struct Scene {
    bus: BusDecoder,
    events: Vec<Event>,
    number: u64,
}

impl Scene {
    fn new(bus_file: &str) -> Self {
        let bus_file = BusFile::parse(bus_file).unwrap();
        let options = SessionOptions { bus_file, ..SessionOptions::default() };
        let bus = BusDecoder::new(BusIndex(0), "can0", Arc::new(options));
        Self { bus, events: Vec::new(), number: 0 }
    }

    /// Sends a frame at a time in ms.
    fn at(&mut self, ms: i64, id: CanId, data: &[u8]) {
        self.push(ms, Frame::data_frame(id, data));
    }

    fn push(&mut self, ms: i64, mut frame: Frame) {
        self.number += 1;
        frame.number = self.number;
        frame.time = Some(Timestamp(ms * MS));
        let events = &mut self.events;
        self.bus.push(&frame, &mut |event: &Event, _: &Bus| events.push(event.clone()));
    }

    fn finish(&mut self) {
        let events = &mut self.events;
        self.bus.finish_bus(&mut |event: &Event, _: &Bus| events.push(event.clone()));
    }

    fn exchanges(&self) -> Vec<&UdsExchange> {
        self.events
            .iter()
            .filter_map(|event| match &event.kind {
                EventKind::UdsExchange(exchange) => Some(&**exchange),
                _ => None,
            })
            .collect()
    }

    fn outcomes(&self) -> Vec<ExchangeOutcome> {
        self.exchanges().iter().map(|exchange| exchange.outcome).collect()
    }

    fn kinds(&self) -> Vec<&'static str> {
        self.events.iter().map(|event| event.kind.name()).collect()
    }
}

fn there(data: &[u8]) -> (CanId, Vec<u8>) {
    (CanId::from_extended(0x18DA_20F1), data.into())
}

fn back(data: &[u8]) -> (CanId, Vec<u8>) {
    (CanId::from_extended(0x18DA_F120), data.into())
}

#[test]
fn a_request_and_its_answer_with_their_times() {
    let mut scene = Scene::new("");
    let frames = [
        (0, there(&[3, 0x22, 0xF1, 0x90, 0, 0, 0, 0])),
        (8, back(&[0x10, 8, 0x62, 0xF1, 0x90, b'A', b'B', b'C'])),
        (9, there(&[0x30, 0, 0])),
        (12, back(&[0x21, b'D', b'E'])),
    ];
    for (ms, (id, data)) in frames {
        scene.at(ms, id, &data);
    }
    assert_eq!(scene.kinds(), ["isotp-transfer", "isotp-transfer", "uds-exchange"]);
    let exchange = scene.exchanges()[0];
    assert_eq!((exchange.service, exchange.identifier), (0x22, Some(0xF190)));
    assert_eq!((exchange.latency, exchange.duration), (Some(8 * MS), Some(12 * MS)));
    assert_eq!(exchange.value(), Some(&b"ABCDE"[..]));
    let event = scene.events.last().unwrap();
    assert_eq!((event.frames, event.node), (FrameRange { first: 1, last: 4 }, Some(NodeId::J1939(0x20))));
}

#[test]
fn silence_ends_a_request_after_five_seconds_and_pending_puts_that_off() {
    let mut scene = Scene::new("");
    let (request, pending) = (there(&[2, 0x11, 1]), back(&[3, 0x7F, 0x11, 0x78]));
    scene.at(0, request.0, &request.1);
    scene.at(4_000, pending.0, &pending.1);
    scene.at(8_999, CanId::from_standard(1), &[]);
    assert!(scene.exchanges().is_empty());
    scene.at(9_001, CanId::from_standard(1), &[]);
    let exchange = scene.exchanges()[0];
    assert_eq!((exchange.outcome, exchange.pending), (ExchangeOutcome::NoAnswer, 1));
}

#[test]
fn an_unanswered_request_that_wants_no_answer_is_suppressed() {
    let mut scene = Scene::new("");
    scene.at(0, CanId::from_extended(0x18DB_33F1), &[2, 0x3E, 0x80]);
    scene.at(2_000, CanId::from_extended(0x18DB_33F1), &[2, 0x3E, 0x80]);
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Suppressed]);
    scene.finish();
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Suppressed; 2]);
    assert!(scene.events.iter().filter(|it| it.protocol == EventProtocol::Uds).all(|event| event.routine));
}

#[test]
fn answers_without_a_request() {
    let mut scene = Scene::new("");
    let (id, data) = back(&[3, 0x7F, 0x22, 0x31]);
    scene.at(0, id, &data);
    let exchange = scene.exchanges()[0];
    assert_eq!((exchange.outcome, exchange.nrc), (ExchangeOutcome::Unsolicited, Some(0x31)));
}

#[test]
fn standard_identifiers_are_uds_only_where_they_are_named() {
    // Not identifiers of OBD (7DF, 7E0 to 7EF: ISO 15765-4), which need no name.
    let named = "[[uds]]\nrequest = 0x6E4\nresponse = 0x6EC\nname = \"ECU\"";
    for (bus_file, expected) in [("", 0), (named, 1)] {
        let mut scene = Scene::new(bus_file);
        scene.at(0, CanId::from_standard(0x6E4), &[2, 0x10, 3, 0, 0, 0, 0, 0]);
        scene.at(5, CanId::from_standard(0x6EC), &[2, 0x50, 3, 0, 0, 0, 0, 0]);
        assert_eq!(scene.exchanges().len(), expected, "{bus_file}");
        if let Some(exchange) = scene.exchanges().first() {
            assert_eq!(exchange.ends.server.as_deref(), Some("ECU"));
            assert_eq!(exchange.sub_function.map(|it| it.value), Some(3));
        }
    }
}

#[test]
fn an_address_before_the_payload_is_taken_off() {
    let mut scene = Scene::new("[[uds]]\nrequest = 0x6F1\nresponse = 0x612\nextended_addressing = true");
    scene.at(0, CanId::from_standard(0x6F1), &[0x12, 2, 0x3E, 0]);
    scene.at(1, CanId::from_standard(0x612), &[0xF1, 2, 0x7E, 0]);
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Positive]);
    let EventKind::IsoTpTransfer(message) = &scene.events[0].kind else { panic!("expected a message") };
    assert_eq!((message.address_byte, &message.data[..]), (Some(0x12), &[0x3E, 0][..]));
}

#[test]
fn edp_and_dp_need_a_service_that_exists() {
    let mut scene = Scene::new("");
    let id = CanId::from_extended(0x1BC7_8820);
    // 4D is not a service, then a consecutive frame, then 22 01 10.
    scene.at(0, id, &[1, 0x4D]);
    scene.at(1, id, &[0x21, 1, 2]);
    assert_eq!(scene.kinds(), ["frame", "frame"]);
    scene.at(2, id, &[3, 0x22, 1, 0x10]);
    scene.at(3, CanId::from_extended(0x1BC1_00F1), &[3, 0x7F, 0x22, 0x31]);
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Negative]);
}

#[test]
fn can_fd_carries_messages_of_a_frame() {
    let mut scene = Scene::new("[[uds]]\nrequest = 0x7E0\nresponse = 0x7E8");
    let mut data = vec![0, 20, 0x2E, 0xF1, 0x90];
    data.resize(24, 0x41);
    let mut frame = Frame::data_frame(CanId::from_standard(0x7E0), &data);
    frame.flags = frame.flags.with(FrameFlags::FD);
    scene.push(0, frame);
    let EventKind::IsoTpTransfer(message) = &scene.events[0].kind else { panic!("expected a message") };
    assert_eq!((message.size, message.is_single), (20, true));
    scene.finish();
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Unfinished]);
}

#[test]
fn an_incomplete_message_times_out() {
    let mut scene = Scene::new("");
    let (id, data) = there(&[0x10, 0, 0xFF, 0xFF, 0xFF, 0xFF, 0x36, 1]);
    scene.at(0, id, &data);
    assert!(scene.bus.footprint() < 64 * 1024);
    scene.at(1_001, CanId::from_standard(1), &[]);
    let EventKind::IsoTpTransfer(message) = &scene.events[0].kind else { panic!("expected a message") };
    assert_eq!((message.outcome, message.announced), (MessageOutcome::NoFlowControl, u32::MAX));
    assert_eq!(scene.events[0].time, Some(Timestamp(1_000 * MS)));
    assert!(!scene.events[0].routine);
}
