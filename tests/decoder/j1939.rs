//! J1939 transport: captures in `fixtures/j1939/` (those that are not `nm_*`) against the events written beside
//! them by hand, and any interleaving of transfers.
//!
//! The notation is described in `fixtures/README.md`.

use std::collections::BTreeMap;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind, Outcome};
use cobscope_decoder::frame::{CanId, Frame, Timestamp};
use cobscope_decoder::session::{Bus, SessionOptions};
use proptest::prelude::*;

use crate::scene::{Expected, captures, events};

#[test]
fn every_capture_gives_the_events_written_beside_it() {
    let mut names = captures("j1939");
    names.retain(|name| !name.file_name().unwrap().to_string_lossy().starts_with("nm_"));
    assert!(names.len() >= 7);
    let mut report = String::new();
    for name in &names {
        let expected = Expected::read(&name.with_extension("expected.txt"));
        let found = events(&name.with_extension("log"), SessionOptions::default(), 1);
        expected.compare(&name.file_name().unwrap().to_string_lossy(), &found, &mut report);
    }
    assert!(report.is_empty(), "\n{report}");
}

/// A frame of a transport protocol, as identifier and payload.
type Part = (u32, Vec<u8>);

/// A message of the proprietary group EF00 from one address to another, or to all.
#[derive(Debug, Clone)]
struct Message {
    source: u8,
    destination: u8,
    payload: Vec<u8>,
    /// Packets a clear to send asks for.
    window: usize,
}

fn identifier(group: u8, source: u8, destination: u8) -> u32 {
    u32::from_be_bytes([0x1C, group, destination, source])
}

impl Message {
    fn managed(&self, is_answer: bool, head: [u8; 5]) -> Part {
        let (from, to) =
            if is_answer { (self.destination, self.source) } else { (self.source, self.destination) };
        (identifier(0xEC, from, to), [&head[..], &[0x00, 0xEF, 0x00]].concat())
    }

    /// Its frames, as J1939-21 §5.10.3 shapes them.
    fn frames(&self) -> Vec<Part> {
        let [low, high] = u16::try_from(self.payload.len()).unwrap().to_le_bytes();
        let packets: Vec<&[u8]> = self.payload.chunks(7).collect();
        let count = u8::try_from(packets.len()).unwrap();
        let is_broadcast = self.destination == 255;
        let control = if is_broadcast { 32 } else { 16 };
        let mut frames = vec![self.managed(false, [control, low, high, count, 255])];
        for (number, packet) in (1_u8..).zip(packets) {
            if !is_broadcast && usize::from(number - 1).is_multiple_of(self.window) {
                let asked = u8::try_from(self.window.min(usize::from(count - number + 1))).unwrap();
                frames.push(self.managed(true, [17, asked, number, 255, 255]));
            }
            let mut data = vec![255; 8];
            data[0] = number;
            data[1..=packet.len()].copy_from_slice(packet);
            frames.push((identifier(0xEB, self.source, self.destination), data));
        }
        if !is_broadcast {
            frames.push(self.managed(true, [19, low, high, count, 255]));
        }
        frames
    }
}

/// Messages of which no two have the same sender and destination.
fn messages() -> impl Strategy<Value = Vec<Message>> {
    let bytes = prop::collection::vec(any::<u8>(), 9..200);
    let destination = prop_oneof![1 => Just(255_u8), 3 => 0..6_u8];
    let message = (0..6_u8, destination, bytes, 1..9_usize)
        .prop_map(|(source, destination, payload, window)| Message { source, destination, payload, window });
    prop::collection::vec(message, 1..12).prop_map(|messages| {
        let mut by_key = BTreeMap::new();
        for message in messages {
            by_key.insert((message.source, message.destination), message);
        }
        by_key.into_values().collect()
    })
}

/// Puts the messages on one bus, a frame of any of them at a time as `turns` say; gives the transfers.
fn reassembled(messages: &[Message], turns: &[usize]) -> Vec<(u8, u8, Outcome, Vec<u8>)> {
    let mut names = BusNames::default();
    names.index_of(b"can0");
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut found = Vec::new();
    let mut observer = |event: &Event, _: &Bus| match &event.kind {
        EventKind::J1939Transfer(it) => {
            found.push((it.source, it.destination, it.outcome, it.data.clone()));
        }
        other => assert_eq!(other.name(), "none", "{other:?}"),
    };
    let mut open: Vec<_> = messages.iter().map(|message| message.frames().into_iter()).collect();
    let mut turns = turns.iter().cycle();
    let mut number = 0;
    while !open.is_empty() {
        let place = turns.next().unwrap() % open.len();
        let Some((id, data)) = open[place].next() else {
            open.remove(place);
            continue;
        };
        number += 1;
        let mut frame = Frame::data_frame(CanId::extended(id), &data);
        frame.number = number;
        frame.time = Some(Timestamp(i64::try_from(number).unwrap() * 100_000));
        decoder.push(&frame, &names, &mut observer);
    }
    decoder.finish(&names, &mut observer);
    found.sort_by_key(|(source, destination, ..)| (*source, *destination));
    found
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_interleaving_of_transfers_gives_the_same_payloads(
        messages in messages(),
        turns in prop::collection::vec(0..97_usize, 1..300),
    ) {
        let wanted: Vec<_> = messages
            .iter()
            .map(|it| (it.source, it.destination, Outcome::Complete, it.payload.clone()))
            .collect();
        prop_assert_eq!(reassembled(&messages, &turns), wanted);
    }
}
