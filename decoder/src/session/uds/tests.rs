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
fn mirrored_addresses_are_a_pair_after_one_exchange() {
    let mut scene = Scene::new("");
    let id = CanId::from_extended(0x1BC7_8820);
    // 4D is not a service, then a consecutive frame, then 22 01 10: no frame of one identifier proves a pair.
    scene.at(0, id, &[1, 0x4D]);
    scene.at(1, id, &[0x21, 1, 2]);
    scene.at(2, id, &[3, 0x22, 1, 0x10]);
    assert_eq!(scene.kinds(), ["frame"; 3]);
    scene.at(3, CanId::from_extended(0x1BC1_00F1), &[3, 0x7F, 0x22, 0x31]);
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Negative]);
    let [exchange] = scene.exchanges()[..] else { panic!("expected one exchange") };
    assert_eq!((exchange.ends.source, exchange.ends.target), (Some(0xF1), Some(0x20)));
    // The decoded request is not counted as unknown any more.
    assert_eq!(scene.bus.bus().protocols.undecoded, (2, 2));
}

/// Frames of a tester that reads identifiers and starts a session, on other identifiers than the standard ones.
fn talk(request: u32, response: u32) -> Vec<(i64, CanId, Vec<u8>)> {
    let (request, response) = (CanId::from_extended(request), CanId::from_extended(response));
    let frames: [(i64, CanId, &[u8]); 7] = [
        (0, request, &[2, 0x10, 3, 0, 0, 0, 0, 0]),
        (3, response, &[6, 0x50, 3, 0, 0x32, 1, 0xF4, 0]),
        (10, request, &[3, 0x22, 0x18, 0x59, 0, 0, 0, 0]),
        (14, response, &[0x10, 10, 0x62, 0x18, 0x59, 1, 2, 3]),
        (15, request, &[0x30, 0, 0, 0, 0, 0, 0, 0]),
        (17, response, &[0x21, 4, 5, 6, 7, 0xAA, 0xAA, 0xAA]),
        (30, request, &[3, 0x22, 0x18, 0x60, 0, 0, 0, 0]),
    ];
    frames.into_iter().map(|(time, id, data)| (time, id, data.to_vec())).collect()
}

/// Exchanges of frames as text: service, outcome, and the numbers of their frames in `frames`.
fn talked(bus_file: &str, frames: &[(i64, CanId, Vec<u8>)], own: &[CanId]) -> Vec<String> {
    let mut scene = Scene::new(bus_file);
    let mut numbers = vec![0];
    for (time, id, data) in frames {
        scene.at(*time, *id, data);
        numbers.push(numbers.last().unwrap() + u64::from(own.contains(id)));
    }
    scene.finish();
    let number = |frame: u64| numbers[usize::try_from(frame).unwrap()];
    let events = scene.events.iter().filter_map(|event| match &event.kind {
        EventKind::UdsExchange(exchange) => Some(format!(
            "{:02X} {:?} {}-{}",
            exchange.service,
            exchange.outcome,
            number(event.frames.first),
            number(event.frames.last)
        )),
        _ => None,
    });
    events.collect()
}

/// A pair that its exchange proves is decoded as if the bus file named it, whatever precedes the proof and lies between.
#[test]
fn a_proven_pair_is_decoded_as_a_named_one() {
    for (request, response) in [(0x17FC_007B, 0x17FE_007B), (0x6CE, 0x7CE)] {
        let own = [CanId::from_extended(request), CanId::from_extended(response)];
        let named = format!("[[uds]]\nrequest = \"{}\"\nresponse = \"{}\"", own[0], own[1]);
        let frames = talk(request, response);
        let expected = talked(&named, &frames, &own);
        assert_eq!(expected, ["10 Positive 1-2", "22 Positive 3-6", "22 Unfinished 7-7"]);
        assert_eq!(talked("", &frames, &own), expected);
        // Foreign frames of the form of ISO-TP before, between and after.
        let other = CanId::from_extended(0x1BFF_DAFF);
        let foreign: [&[u8]; 4] = [
            &[3, 0x10, 0x80, 0x24, 0, 2, 7, 0],
            &[0x85, 0xA6, 0x67, 1, 0x60, 0x14, 0, 0],
            &[2, 0xEF, 0xB1, 0x1D, 0x22, 0xEA, 5, 0],
            &[0x21, 0x8E, 1, 0x7D, 0x3E, 0x3E, 0x3E, 0xFF],
        ];
        for place in 0..=frames.len() {
            for data in foreign {
                let mut mixed = frames.clone();
                let time = frames.get(place).map_or(40, |frame| frame.0);
                mixed.insert(place, (time, other, data.to_vec()));
                assert_eq!(talked("", &mixed, &own), expected, "{data:02X?} before {place}");
            }
        }
    }
}

/// Numbers of the frames that became messages of J1939.
fn messages(scene: &Scene) -> Vec<u64> {
    let messages = scene.events.iter().filter_map(|event| match &event.kind {
        EventKind::J1939Message(_) => Some(event.frames.first),
        _ => None,
    });
    messages.collect()
}

/// Frames before the proof do not become messages of J1939, although their identifiers have the form of TSC1 (PGN 0).
#[test]
fn frames_that_wait_for_a_response_are_not_printed_as_j1939() {
    let mut scene = Scene::new("");
    for (time, id, data) in talk(0x6CE, 0x7CE) {
        scene.at(time, id, &data);
    }
    scene.finish();
    assert_eq!((messages(&scene), scene.exchanges().len()), (vec![], 3));
}

/// Frames of the form of a request without a response: each becomes one message of J1939 in its order, after the time of a
/// response at the latest.
#[test]
fn frames_without_a_response_become_messages_once() {
    // TSC1 of 03 to 00 and EEC1 of 00, with contents that may be a request; a proof by an address claim, or none.
    let ids = [0x0C00_0003, 0x0CF0_0400].map(CanId::from_extended);
    let claim = (CanId::from_extended(0x18EE_FF00), [0x10, 0x21, 0xC3, 0x84, 0, 0, 0, 0x80]);
    for (count, proof) in [(1, None), (5, None), (70, None), (300, None), (5, Some(3)), (70, Some(66))] {
        let mut scene = Scene::new("");
        for number in 0..count {
            let id = ids[usize::try_from(number).unwrap() % 2];
            scene.at(number * 10, id, &[3, 0x22, 0xF1, 0x90, 0, 0, 0, number.to_le_bytes()[0]]);
            if proof == Some(number) {
                scene.at(number * 10 + 1, claim.0, &claim.1);
            }
        }
        scene.finish();
        let found = messages(&scene);
        let claim_frame = proof.map(|number| u64::try_from(number + 2).unwrap());
        let expected = (1..=scene.number).filter(|frame| Some(*frame) != claim_frame);
        assert!(found.iter().copied().eq(expected), "{count} {proof:?}: {found:?}");
    }
    // Live: the next frame after 5 s releases the first one.
    let mut scene = Scene::new("");
    scene.at(0, ids[0], &[3, 0x22, 0xF1, 0x90, 0, 0, 0, 0]);
    scene.at(4_999, ids[1], &[0; 8]);
    assert_eq!(messages(&scene).len(), 1);
    scene.at(5_001, ids[1], &[0; 8]);
    assert_eq!(messages(&scene), [2, 1, 3]);
}

#[test]
fn frames_that_only_fit_prove_nothing() {
    let mut scene = Scene::new("");
    // One exchange without an identifier, repeated with the same data: constant messages of two senders fit by chance.
    for round in 0..50 {
        scene.at(round * 100, CanId::from_extended(0x17FC_007B), &[2, 0x3E, 0, 0, 0, 0, 0, 0]);
        scene.at(round * 100 + 1, CanId::from_extended(0x17FE_007B), &[2, 0x7E, 0, 0, 0, 0, 0, 0]);
    }
    assert!(scene.kinds().iter().all(|kind| *kind == "frame"), "{:?}", scene.kinds());
    // Many other identifiers do not make the search larger.
    for number in 0..20_000_u32 {
        let id = CanId::from_extended(0x1BC0_0000 | (number % 4_000));
        scene.at(5_000 + i64::from(number / 10), id, &[3, 0x22, 0xF1, number.to_le_bytes()[0]]);
    }
    let held = scene.bus.footprint();
    assert!(held < 1536 * 1024, "{held}");
}

#[test]
fn mixed_addresses_have_an_address_byte() {
    let mut scene = Scene::new("");
    scene.at(0, CanId::from_extended(0x18CE_20F1), &[0x55, 3, 0x22, 0xF1, 0x90, 0, 0, 0]);
    scene.at(5, CanId::from_extended(0x18CE_F120), &[0x55, 5, 0x62, 0xF1, 0x90, 0x31, 0x32, 0]);
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Positive]);
    let [exchange] = scene.exchanges()[..] else { panic!("expected one exchange") };
    assert_eq!(exchange.identifier, Some(0xF190));
}

#[test]
fn identifiers_of_lss_are_those_of_a_server_where_it_answers() {
    let mut scene = Scene::new("");
    scene.at(0, CanId::from_standard(0x7E4), &[3, 0x22, 0xF1, 0x90, 0, 0, 0, 0]);
    assert_eq!(scene.kinds(), ["frame"]);
    scene.at(4, CanId::from_standard(0x7EC), &[4, 0x62, 0xF1, 0x90, 0x31, 0, 0, 0]);
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Positive]);
}

/// ISO 14229-1 §11.2.3: a response echoes the identifier of its request.
#[test]
fn a_response_with_another_identifier_answers_another_request() {
    let mut scene = Scene::new("");
    let (id, data) = there(&[3, 0x22, 0xF1, 0x87]);
    scene.at(0, id, &data);
    let (id, data) = back(&[5, 0x62, 0xF1, 0x88, 0x31, 0x32]);
    scene.at(4, id, &data);
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Unsolicited]);
    scene.finish();
    assert_eq!(scene.outcomes(), [ExchangeOutcome::Unsolicited, ExchangeOutcome::Unfinished]);
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
