//! The user's statements against the evidence of the traffic, over all machines.

use std::sync::Arc;

use crate::bus_file::{BusFile, ProtocolChoice};
use crate::event::{Event, EventKind};
use crate::frame::{BusIndex, CanId, Frame, FrameFlags, Timestamp};
use crate::profile::Catalogue;
use crate::profile::dbc::{Database, parse_database};
use crate::session::{AssignedBy, Assignment, Bus, BusDecoder, SessionOptions};
use crate::wire::NodeId;

const MS: i64 = 1_000_000;

fn decoder(options: SessionOptions) -> BusDecoder {
    BusDecoder::new(BusIndex(0), "can0", Arc::new(options))
}

fn of_file(text: &str) -> BusDecoder {
    decoder(SessionOptions { bus_file: BusFile::parse(text).unwrap(), ..SessionOptions::default() })
}

/// Options of `--node 9=PROFILE`, or of `--node BUS:9=PROFILE`.
fn with_device(bus: Option<&str>, profile: &str) -> SessionOptions {
    let device = Catalogue::default().device(profile).unwrap();
    let node = NodeId::Canopen(9);
    let assignment = Assignment { bus: bus.map(Into::into), node, device, by: AssignedBy::Option };
    SessionOptions { assignments: vec![assignment], ..SessionOptions::default() }
}

/// Frames of identifier, data and time in ms.
fn push(bus: &mut BusDecoder, frames: impl IntoIterator<Item = (u16, Vec<u8>, i64)>) -> Vec<Event> {
    let mut events = Vec::new();
    for (id, data, time) in frames {
        let mut frame = Frame::data_frame(CanId::from_standard(id), &data);
        frame.number = bus.bus().last_frame() + 1;
        frame.time = Some(Timestamp(time * MS));
        bus.push(&frame, &mut |event: &Event, _: &Bus| events.push(event.clone()));
    }
    events
}

/// `count` TPDO1 of a node, 100 ms apart, each with other data.
fn tpdos(node: u16, count: i64) -> impl Iterator<Item = (u16, Vec<u8>, i64)> {
    (0..count).map(move |place| (0x180 + node, vec![place.to_le_bytes()[0], 1], place * 100))
}

fn pdos(events: &[Event]) -> usize {
    events.iter().filter(|event| matches!(event.kind, EventKind::Pdo(_)) && !event.presumed).count()
}

fn notes(events: &[Event]) -> Vec<&str> {
    let mut notes = Vec::new();
    for event in events {
        if let EventKind::Note { text } = &event.kind {
            notes.push(text.as_str());
        }
    }
    notes
}

#[test]
fn only_tpdos_of_a_named_node_are_decoded_to_the_end() {
    // 200 TPDOs over 20 s without any other service: without a name, CANopen is rejected after 5 s and 50 frames.
    let mut unnamed = decoder(SessionOptions::default());
    let events = push(&mut unnamed, tpdos(9, 200));
    assert_eq!(pdos(&events), 0);
    let limits = unnamed.bus().protocols.limit_texts();
    assert_eq!(limits.len(), 1);
    // Frames 1 to 50 precede the rejection at frame 51, whose count is 5.0 s after the first.
    assert!(limits[0].starts_with("150 frames on CANopen identifiers not decoded: "), "{limits:?}");
    assert!(limits[0].contains("--protocol canopen"), "{limits:?}");
    for options in [
        with_device(None, "wandfluh-md2"),
        with_device(Some("can0"), "wandfluh-md2"),
        SessionOptions { named: vec![(None, NodeId::Canopen(9))], ..SessionOptions::default() },
        SessionOptions { protocol: ProtocolChoice::Canopen, ..SessionOptions::default() },
    ] {
        let mut named = decoder(options);
        let events = push(&mut named, tpdos(9, 200));
        assert_eq!((pdos(&events), notes(&events).len()), (200, 0), "{:?}", notes(&events));
        assert!(
            named.bus().protocols.is_canopen()
                && named.bus().protocols.detection_doubt().is_none()
                && named.bus().protocols.limit_texts().is_empty()
        );
    }
}

#[test]
fn each_entry_of_the_bus_file_names_its_node() {
    for text in [
        "[node.9]\nname = 'pump'",
        "[bus.can0.node.9]",
        "[[id]]\nid = 0x189\nservice = 'tpdo1'\nnode = 9",
        "[bus.can0]\nprotocol = 'canopen'",
    ] {
        let events = push(&mut of_file(text), tpdos(9, 200));
        assert_eq!((pdos(&events), notes(&events).len()), (200, 0), "{text}");
    }
    // Another node, another bus.
    for text in ["[node.8]\nname = 'pump'", "[bus.can1.node.9]", "[bus.can1]\nprotocol = 'canopen'"] {
        assert_eq!(pdos(&push(&mut of_file(text), tpdos(9, 200))), 0, "{text}");
    }
}

#[test]
fn the_bus_file_states_the_protocol_and_the_option_overrides_it() {
    let none = "[bus.can0]\nprotocol = 'none'\n[node.9]\nname = 'pump'";
    let events = push(&mut of_file(none), [(0x709, vec![5], 0), (0x189, vec![1, 2], 1)]);
    assert!(events.iter().all(|event| matches!(event.kind, EventKind::Frame(_))), "{events:?}");
    let bus_file = BusFile::parse(none).unwrap();
    let options = SessionOptions { bus_file, protocol: ProtocolChoice::Canopen, ..SessionOptions::default() };
    assert_eq!(pdos(&push(&mut decoder(options), tpdos(9, 2))), 2);
    let error = BusFile::parse("[bus.can0]\nprotocol = 'canopne'").unwrap_err();
    assert_eq!((error.line, error.column), (2, 12), "{error}");
}

#[test]
fn other_nodes_of_the_bus_are_still_judged_by_evidence() {
    // A car: 30 identifiers in the range of TPDO1. Node 9 is named, all others are rejected.
    let mut bus = decoder(with_device(None, "wandfluh-md2"));
    let car = (0..600).map(|place: i64| {
        let node = u16::try_from(place % 30).unwrap() + 1;
        (0x180 + node, vec![place.to_le_bytes()[0]; 8], place * 10)
    });
    let events = push(&mut bus, car);
    let of_others = events.iter().filter(|event| {
        matches!(event.kind, EventKind::Pdo(_)) && event.node != Some(NodeId::Canopen(9)) && !event.presumed
    });
    assert_eq!((pdos(&events), of_others.count()), (20, 0));
    let rejections: Vec<_> =
        notes(&events).into_iter().filter(|text| text.contains("not detected")).collect();
    assert_eq!(rejections.len(), 1, "reported once");
    assert!(rejections[0].contains("only identifiers of named nodes (9) are decoded"), "{rejections:?}");
    assert!(bus.bus().protocols.limit_texts()[0].contains("frames on CANopen identifiers not decoded"));
    assert!(
        bus.bus().protocols.is_withdrawn(Some(NodeId::Canopen(8)))
            && !bus.bus().protocols.is_withdrawn(Some(NodeId::Canopen(9)))
    );
}

#[test]
fn a_contradiction_to_the_name_is_reported_once() {
    // Error control has one byte (CiA 301 §7.2.8.3.2.2); a heartbeat of eight bytes is not CANopen.
    let mut bus = decoder(with_device(None, "wandfluh-md2"));
    let events = push(&mut bus, (0..10).map(|place| (0x709, vec![0; 8], place * 100)));
    let contradictions = notes(&events).into_iter().filter(|text| text.contains("709 has 8 bytes"));
    assert_eq!(contradictions.count(), 1, "{:?}", notes(&events));
}

#[test]
fn a_sync_before_the_first_frame_of_a_named_node_needs_no_note() {
    let mut bus = decoder(with_device(None, "rexroth-sydfec"));
    let events = push(&mut bus, [(0x080, vec![], 0), (0x189, vec![0; 5], 1), (0x080, vec![], 10)]);
    assert!(notes(&events).is_empty(), "{:?}", notes(&events));
    let syncs: Vec<bool> = events
        .iter()
        .filter(|event| matches!(event.kind, EventKind::Sync { .. }))
        .map(|event| event.presumed)
        .collect();
    assert_eq!(syncs, [true, false], "settled once the bus carries the node");
}

#[test]
fn a_database_with_canopen_messages_names_their_nodes() {
    // BO_ 393 = 189h.
    let text = "BO_ 393 TPDO1_Sensor: 2 N\n SG_ A : 0|8@1+ (1,0) [0|0] \"\" N\n";
    let mut database = Database::default();
    database.add_file(parse_database(text.as_bytes()).unwrap());
    let options = SessionOptions { database: Arc::new(database), ..SessionOptions::default() };
    assert_eq!(pdos(&push(&mut decoder(options), tpdos(9, 200))), 200);
}

#[test]
fn a_named_address_is_j1939_at_its_first_frame() {
    let bus_file = BusFile::parse("[node.\"sa:0x0B\"]\nname = \"valve\"").unwrap();
    let mut bus = decoder(SessionOptions { bus_file, ..SessionOptions::default() });
    let mut events = Vec::new();
    // Proprietary B messages of 0B, and of 60 other addresses without any management message.
    for address in (0..60).chain([0x0B]) {
        let mut frame = Frame::data_frame(CanId::from_extended(0x18FF_0000 | address), &[0; 8]);
        frame.number = u64::from(address) + 1;
        bus.push(&frame, &mut |event: &Event, _: &Bus| events.push(event.clone()));
    }
    let settled: Vec<_> = events
        .iter()
        .filter(|event| matches!(event.kind, EventKind::J1939Message(_)) && !event.presumed)
        .map(|event| event.node)
        .collect();
    assert_eq!(settled, [Some(NodeId::J1939(0x0B)); 2]);
    // The 48th address rejects J1939: it and the 12 later ones are not decoded.
    assert!(
        bus.bus().protocols.limit_texts()[0].starts_with("13 frames with 29-bit identifier"),
        "{:?}",
        bus.bus().protocols.limit_texts()
    );
}

#[test]
fn identifiers_of_emcy_and_time_in_a_car_cause_no_canopen_events() {
    let mut bus = decoder(SessionOptions::default());
    // 100h every ms with a rolling counter; 0A5h with eight bytes of measured values; 091h with zeros.
    let car = (0..3_000_i64).flat_map(|place| {
        let [low, high, ..] = place.to_le_bytes();
        [
            (0x100, vec![low, high, 0, 0, 1, 0, 0, 0], place),
            (0x0A5, vec![low, high, low, 2, 3, 4, 5, 6], place),
            (0x091, vec![0; 8], place),
        ]
    });
    let events = push(&mut bus, car);
    let is_canopen = |event: &&Event| {
        let is_emcy = matches!(&event.kind, EventKind::Emcy(_)) && event.node == Some(NodeId::Canopen(0x11));
        is_emcy || matches!(event.kind, EventKind::Time { .. })
    };
    let found = events.iter().find(is_canopen).map(|event| &event.kind);
    assert!(found.is_none(), "{found:?}");
}

#[test]
fn time_of_day_in_eight_bytes_is_a_time() {
    let mut bus = decoder(SessionOptions::default());
    let mut frames = vec![(0x705, vec![5], 0)];
    // 43,200,000 ms = noon = 0x0293_2E00, 14,610 days = 0x3912; one message per second.
    frames.extend((0..5_u32).map(|second| {
        let mut data = (43_200_000 + 1_000 * second).to_le_bytes().to_vec();
        data.extend([0x12, 0x39, 0, 0]);
        (0x100, data, 1_000 * i64::from(second) + 10)
    }));
    let events = push(&mut bus, frames);
    let times = events.iter().filter(|event| matches!(event.kind, EventKind::Time { days: 14_610, .. }));
    assert_eq!(times.count(), 5);
    assert!(!bus.bus().protocols.is_time_withdrawn());
}

#[test]
fn fast_traffic_on_the_identifier_of_time_is_given_up_on_a_canopen_bus() {
    let mut bus = decoder(SessionOptions::default());
    let frames = (0..1_000_i64).map(|place| (0x100, vec![place.to_le_bytes()[0], 0, 0, 0, 1, 0], place));
    let events = push(&mut bus, std::iter::once((0x705, vec![5], 0)).chain(frames));
    assert!(bus.bus().protocols.is_time_withdrawn());
    let time_notes =
        notes(&events).into_iter().filter(|text| text.contains("100 is not TIME: period below 10 ms"));
    assert_eq!(time_notes.count(), 1);
    // Ten intervals below 10 ms follow the first message.
    assert!(
        bus.bus().protocols.limit_texts()[0].starts_with("990 frames on the identifier of TIME"),
        "{:?}",
        bus.bus().protocols.limit_texts()
    );
}

#[test]
fn remote_frames_of_a_named_node_are_requests() {
    let mut bus = decoder(with_device(None, "rexroth-sydfec"));
    let mut frame = Frame::data_frame(CanId::from_standard(0x709), &[]);
    frame.flags = FrameFlags::REMOTE;
    let mut events = Vec::new();
    bus.push(&frame, &mut |event: &Event, _: &Bus| events.push(event.clone()));
    assert!(matches!(events[0].kind, EventKind::GuardRequest) && !events[0].presumed, "{events:?}");
}

/// Code and certainty of the EMCY events, and the place of the first one among all events.
fn emergencies(events: &[Event]) -> (Vec<(Option<u16>, bool)>, Option<usize>) {
    let code = |event: &Event| match &event.kind {
        EventKind::Emcy(emergency) => Some((emergency.code, event.presumed)),
        _ => None,
    };
    (events.iter().filter_map(code).collect(), events.iter().position(|event| code(event).is_some()))
}

const EMCY: [u8; 8] = [0x20, 0x81, 0, 6, 0x28, 0, 0, 0];

/// An EMCY whose register has bit 0 clear is no evidence; the heartbeat after it is.
#[test]
fn an_emcy_before_the_proof_is_decoded_as_after_it() {
    let emcy = |time: i64| (0x083, EMCY.to_vec(), time);
    let proofs = [(0x703, vec![0x7F]), (0x704, vec![0]), (0x000, vec![1, 3])];
    for (id, data) in proofs {
        let proof = |time: i64| (id, data.clone(), time);
        let foreign = (0x790, vec![1, 2], 5);
        for before in [vec![emcy(0)], vec![emcy(0), foreign.clone()], vec![foreign.clone(), emcy(6)]] {
            let count = before.len();
            let mut held = of_file("");
            let events = push(&mut held, before.into_iter().chain([proof(20)]));
            let (found, place) = emergencies(&events);
            let mut plain = of_file("");
            let expected = emergencies(&push(&mut plain, [proof(20), emcy(21)])).0;
            assert_eq!((found, expected.len()), (expected.clone(), 1), "{id:03X}");
            // In the order of the frames: before the events of the proof.
            let first = place.unwrap();
            assert!(events[first + 1..].iter().any(|event| event.frames.first == count as u64 + 1));
            assert_eq!(held.bus().protocols().unknown_frames(), u64::from(count == 2));
            // Once: a further proof decodes nothing again.
            assert_eq!(emergencies(&push(&mut held, [proof(30)])).0, []);
        }
    }
}

#[test]
fn few_frames_are_held_and_not_for_long() {
    let mut bus = of_file("");
    let mut events = push(&mut bus, (0..100).map(|place| (0x083, EMCY.to_vec(), place)));
    events.extend(push(&mut bus, [(0x703, vec![0x7F], 200)]));
    assert_eq!(emergencies(&events).0.len(), 16);
    let mut bus = of_file("");
    push(&mut bus, [(0x083, EMCY.to_vec(), 0)]);
    assert_eq!(emergencies(&push(&mut bus, [(0x703, vec![0x7F], 10_001)])).0, []);
}

/// Frames of a car on SDO identifiers: undefined commands without a response.
#[test]
fn a_car_does_not_become_canopen_by_its_identifiers() {
    let mut bus = of_file("");
    let frames: [(u16, [u8; 8]); 4] = [
        (0x597, [0x85, 0, 0, 0, 0, 0, 0, 0]),
        (0x5F1, [0x9C, 0x13, 0x72, 0x0D, 0, 0, 0x3A, 2]),
        (0x670, [0x3C, 0x0F, 0x30, 0x11, 0xE6, 0x39, 0, 1]),
        (0x671, [0x23, 0, 0xB3, 0xB3, 1, 0, 0x72, 0x0D]),
    ];
    let rounds = (0..20).flat_map(|round| frames.map(|(id, data)| (id, data.to_vec(), round * 500)));
    let mut events = push(&mut bus, rounds);
    bus.finish_bus(&mut |event: &Event, _: &Bus| events.push(event.clone()));
    let is_foreign = |event: &&Event| {
        matches!(event.kind, EventKind::SdoTransfer(_) | EventKind::Malformed { .. } | EventKind::Pdo(_))
    };
    assert_eq!(events.iter().filter(is_foreign).count(), 0);
    assert!(bus.bus().protocols().is_canopen_rejected());
    let doubt = bus.bus().protocols().detection_doubt().unwrap();
    assert!(doubt.contains("3 frames on SDO identifiers"), "{doubt}");
}
