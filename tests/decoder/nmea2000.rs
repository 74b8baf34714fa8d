//! Fast packets of NMEA 2000: captures of other projects compared with a script, and interleaved packets.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::process::Command;

use cobscope_decoder::capture::BusNames;
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind, J1939Transfer, SdoOutcome, TransportMode};
use cobscope_decoder::frame::{CanId, Frame, Timestamp};
use cobscope_decoder::session::{Bus, SessionOptions};
use proptest::prelude::*;

use crate::corpus::decode;
use crate::support;

/// `source pgn hex` of a complete fast packet.
fn line(transfer: &J1939Transfer) -> Option<String> {
    let is_complete =
        transfer.mode == Some(TransportMode::FastPacket) && transfer.outcome == SdoOutcome::Complete;
    let data = transfer.data.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02X}").unwrap();
        text
    });
    is_complete.then(|| format!("{} {} {data}\n", transfer.source, transfer.pgn.unwrap_or_default().number()))
}

#[test]
fn a_script_puts_the_same_packets_together() {
    let Some(python) = support::python() else { return support::skip("python", "no Python for oracles") };
    let script = support::workspace().join("tests/oracles/fast_packets.py");
    let groups = support::workspace().join("decoder/profiles/lookups/nmea2000.toml");
    // Packets, counted by the script on the day that the test was written.
    let captures = [
        ("candump-fast.txt", 5),
        ("candump-fast-cr.txt", 5),
        ("candumpSample2.txt", 10),
        ("candumpSample3.txt", 264),
        ("actisense-522.candump.log", 14),
    ];
    for (name, count) in captures {
        let name = format!("nmea2000/canboat__{name}");
        let mut ours = String::new();
        let decoder = decode(&name, |event, _| {
            if let EventKind::J1939Transfer(transfer) = &event.kind {
                ours.extend(line(transfer));
            }
        });
        if decoder.is_none() {
            return;
        }
        let path = support::corpus().join(&name);
        let output = Command::new(&python).args([&script, &path, &groups]).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let theirs = String::from_utf8(output.stdout).unwrap();
        assert_eq!(theirs.lines().count(), count, "{name}");
        assert!(ours == theirs, "{name}");
    }
}

/// Three boats: packets and their bytes as counted by a script, which reads the same formats by other code. The only
/// incomplete packets are those that the capture begins in, and one whose frame 0 is not in the capture.
#[test]
fn boats_with_every_packet_accounted_for() {
    let boats = [("can0-1.pcap", 4_788, 189_291, 2), ("sample3_PCAN-View.trc", 1_195, 53_296, 0)];
    for (name, packets, bytes, cut) in boats {
        let mut found = (0, 0, 0);
        let decoder = decode(&format!("nmea2000/canboat__{name}"), |event, _| match &event.kind {
            EventKind::J1939Transfer(transfer) if transfer.outcome == SdoOutcome::Complete => {
                found.0 += 1;
                found.1 += transfer.data.len();
            }
            EventKind::J1939Transfer(transfer) => {
                assert!(transfer.cut_start, "{transfer:?}");
                found.2 += 1;
            }
            EventKind::Frame(frame) => panic!("{frame:?}"),
            _ => {}
        });
        if decoder.is_none() {
            return;
        }
        assert_eq!(found, (packets, bytes, cut), "{name}");
    }
}

/// Frames of a packet.
fn parts((source, sequence, length): (u8, u8, u8)) -> Vec<Vec<u8>> {
    let payload: Vec<u8> = (0..length).map(|at| at.wrapping_mul(3) ^ source ^ sequence << 4).collect();
    let (first, rest) = payload.split_at(payload.len().min(6));
    let mut parts = vec![[&[sequence << 5, length], first].concat()];
    parts.extend(rest.chunks(7).zip(1_u8..).map(|(data, number)| [&[sequence << 5 | number], data].concat()));
    parts
}

/// Outcome and length of each packet, by sender and counter.
fn decoded(frames: &[(u8, Vec<u8>)]) -> BTreeMap<(u8, u8), Vec<(SdoOutcome, usize)>> {
    let mut names = BusNames::default();
    names.index_of(b"can0");
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut found: BTreeMap<_, Vec<_>> = BTreeMap::new();
    let mut observer = |event: &Event, _: &Bus| {
        if let EventKind::J1939Transfer(transfer) = &event.kind {
            let first = usize::try_from(event.frames.first).unwrap() - 1;
            let (source, data) = &frames[first];
            assert_eq!(transfer.source, *source);
            found.entry((*source, data[0] >> 5)).or_default().push((transfer.outcome, transfer.data.len()));
        }
    };
    for ((source, data), number) in frames.iter().zip(1..) {
        // 127489 of each source.
        let id = CanId::from_extended(0x09F2_0100 | u32::from(*source));
        let time = Some(Timestamp(number * 1_000_000 + number % 7));
        let frame = Frame { number: number.unsigned_abs(), time, ..Frame::data_frame(id, data) };
        decoder.push(&frame, &names, &mut observer);
    }
    decoder.finish_capture(&names, &mut observer);
    found
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any interleaving of packets of different senders and counters gives all of them. Without one frame, exactly that
    /// packet is not complete.
    #[test]
    fn interleaved_packets_are_complete_unless_a_frame_is_missing(
        packets in prop::collection::btree_map((0_u8..4, 0_u8..8), 0_u8..=223, 1..10),
        order in prop::collection::vec(any::<prop::sample::Index>(), 400),
        missing in any::<prop::sample::Index>(),
    ) {
        let mut queues: Vec<_> = packets
            .iter()
            .map(|((source, sequence), length)| (*source, parts((*source, *sequence, *length)).into_iter()))
            .collect();
        let mut frames = Vec::new();
        let mut order = order.iter().cycle();
        while !queues.is_empty() {
            let at = order.next().unwrap().index(queues.len());
            match queues[at].1.next() {
                Some(data) => frames.push((queues[at].0, data)),
                None => drop(queues.remove(at)),
            }
        }
        let whole = decoded(&frames);
        prop_assert_eq!(whole.len(), packets.len());
        for (key, length) in &packets {
            prop_assert_eq!(&whole[key], &[(SdoOutcome::Complete, usize::from(*length))]);
        }
        let (source, data) = frames.remove(missing.index(frames.len()));
        let lost = (source, data[0] >> 5);
        let rest = decoded(&frames);
        for (key, length) in &packets {
            if *key == lost {
                let complete = rest.get(key).into_iter().flatten().any(|(outcome, _)| *outcome == SdoOutcome::Complete);
                prop_assert!(!complete);
            } else {
                prop_assert_eq!(&rest[key], &[(SdoOutcome::Complete, usize::from(*length))]);
            }
        }
    }
}
