//! J1939 transport: captures in `fixtures/j1939/` (except `nm_*`) compared with the hand-written events next
//! to them, and interleaved transfers.
//!
//! The notation is described in `fixtures/README.md`.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use cobscope_decoder::capture::{Batch, BatchItem, BusNames, CaptureReader, ReadOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind, EventProtocol, SdoOutcome};
use cobscope_decoder::frame::{CanId, Frame, Timestamp};
use cobscope_decoder::session::{Bus, SessionOptions};
use proptest::prelude::*;

use crate::scene::{Expected, captures, events, keys};

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

/// Frames of a capture with times relative to its first one, numbered from `first` on.
fn frames(path: &Path, first: u64) -> Vec<Frame> {
    let bytes = fs::read(path.with_extension("log")).unwrap();
    let mut reader = CaptureReader::open(&bytes[..], &ReadOptions::default()).unwrap();
    let (mut batch, mut frames) = (Batch::new(), Vec::new());
    while reader.read(&mut batch).unwrap() {
        frames.extend(batch.items().filter_map(|item| match item {
            BatchItem::Frame(frame) => Some(*frame),
            BatchItem::Notice(_) => None,
        }));
    }
    let start = frames[0].time.unwrap();
    for frame in &mut frames {
        frame.time = Some(Timestamp(frame.time.unwrap().since(start)));
        frame.number += first;
    }
    frames
}

/// All keys of the events of one protocol, without the events emitted at the end of the capture.
fn event_keys(frames: &[Frame], of: fn(EventProtocol) -> bool) -> Vec<String> {
    let mut names = BusNames::default();
    names.index_of(b"can0");
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut reported = Vec::new();
    for frame in frames {
        decoder.push(frame, &names, &mut |event: &Event, bus: &Bus| {
            if of(event.protocol) {
                reported.push(format!("{:?}", keys(event, bus)));
            }
        });
    }
    reported
}

#[test]
fn canopen_and_j1939_on_one_bus_are_decoded_as_each_alone() {
    let (mut canopen_events, mut j1939_events) = (0, 0);
    let ours = captures("canopen");
    for (theirs, own) in captures("j1939").iter().zip(ours.iter().cycle().skip(3)) {
        if theirs.ends_with("mixed") {
            continue;
        }
        let (canopen, j1939) = (frames(own, 0), frames(theirs, 1_000_000));
        let mut both = [canopen.clone(), j1939.clone()].concat();
        both.sort_by_key(|frame| frame.time);
        let is_canopen = |protocol| protocol == EventProtocol::Canopen;
        let is_j1939 = |protocol| protocol == EventProtocol::J1939;
        for (frames, of, sum) in [
            (&canopen, is_canopen as fn(EventProtocol) -> bool, &mut canopen_events),
            (&j1939, is_j1939, &mut j1939_events),
        ] {
            let (alone, together) = (event_keys(frames, of), event_keys(&both, of));
            // The frames of the other protocol continue after the last one, so further time-outs may follow.
            let differs = alone.iter().zip(&together).find(|(alone, together)| alone != together);
            assert_eq!(differs, None, "{} with {}", own.display(), theirs.display());
            assert!(together.len() >= alone.len(), "{} with {}", own.display(), theirs.display());
            *sum += alone.len();
        }
    }
    assert!(canopen_events > 500 && j1939_events > 150, "{canopen_events} {j1939_events}");
}

/// A frame of a transport protocol, as identifier and payload.
type RawFrame = (u32, Vec<u8>);

/// A message of the proprietary group EF00 from one address to another, or to all.
#[derive(Debug, Clone)]
struct Message {
    source: u8,
    destination: u8,
    payload: Vec<u8>,
    /// Number of packets per clear to send.
    window: usize,
}

fn identifier(group: u8, source: u8, destination: u8) -> u32 {
    u32::from_be_bytes([0x1C, group, destination, source])
}

impl Message {
    fn managed(&self, is_answer: bool, head: [u8; 5]) -> RawFrame {
        let (from, to) =
            if is_answer { (self.destination, self.source) } else { (self.source, self.destination) };
        (identifier(0xEC, from, to), [&head[..], &[0x00, 0xEF, 0x00]].concat())
    }

    /// Frames of the message in the format of J1939-21 §5.10.3.
    fn frames(&self) -> Vec<RawFrame> {
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

/// Messages with different pairs of sender and destination.
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

/// Interleaves the frames of the messages on one bus in the order of `turns`; returns the transfers.
fn reassembled(messages: &[Message], turns: &[usize]) -> Vec<(u8, u8, SdoOutcome, Vec<u8>)> {
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
        let mut frame = Frame::data_frame(CanId::from_extended(id), &data);
        frame.number = number;
        frame.time = Some(Timestamp(i64::try_from(number).unwrap() * 100_000));
        decoder.push(&frame, &names, &mut observer);
    }
    decoder.finish_capture(&names, &mut observer);
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
            .map(|it| (it.source, it.destination, SdoOutcome::Complete, it.payload.clone()))
            .collect();
        prop_assert_eq!(reassembled(&messages, &turns), wanted);
    }
}
