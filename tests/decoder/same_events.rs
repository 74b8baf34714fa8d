//! The same frames give the same events in every capture format.

use std::fmt::Write as _;
use std::fs;

use cobscope_decoder::capture::{Batch, CaptureReader, ReadOptions};
use cobscope_decoder::decoder::Decoder;
use cobscope_decoder::event::{Event, EventKind, EventProtocol};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags};
use cobscope_decoder::session::{Bus, SessionOptions};
use cobscope_decoder::sink::EventSink as _;
use cobscope_decoder::sink::jsonl::JsonlSink;

use crate::support::workspace;

/// Captures without error frames, which TRC and ASC store incompletely.
const CAPTURES: &[&str] =
    &["guarding", "lss", "mid_run", "pdo_mapping", "sdo_block_upload", "sdo_segmented", "emcy"];

fn frames(bytes: &[u8]) -> Vec<Frame> {
    let mut reader = CaptureReader::open(bytes, &ReadOptions::default()).unwrap();
    let mut batch = Batch::new();
    let mut frames = Vec::new();
    while reader.read(&mut batch).unwrap() {
        frames.extend_from_slice(batch.frames());
    }
    frames
}

/// Events as JSON lines without their bus and with times since the first frame.
fn events(bytes: &[u8]) -> Vec<String> {
    let mut reader = CaptureReader::open(bytes, &ReadOptions::default()).unwrap();
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut batch = Batch::new();
    let mut lines = Vec::new();
    let mut first = None;
    let mut see = |event: &Event, bus: &Bus| {
        // Remarks about a format ("times read as UTC") are not events of the bus.
        if event.protocol == EventProtocol::Capture || matches!(event.kind, EventKind::Note { .. }) {
            return;
        }
        let start = *first.get_or_insert(event.time.unwrap());
        let mut event = event.clone();
        event.time = event.time.map(|time| cobscope_decoder::frame::Timestamp(time.since(start)));
        let mut line = Vec::new();
        JsonlSink::new(&mut line).write_event(&event, bus);
        let line = String::from_utf8(line).unwrap();
        let bus = format!("\"bus\":\"{}\",", bus.name());
        lines.push(line.replace(&bus, ""));
    };
    while reader.read(&mut batch).unwrap() {
        for frame in batch.frames() {
            decoder.push(frame, reader.buses(), &mut see);
        }
    }
    decoder.finish_capture(reader.buses(), &mut see);
    lines
}

fn micros(frame: &Frame, first: &Frame) -> i64 {
    frame.time.unwrap().since(first.time.unwrap()) / 1_000
}

fn hex(frame: &Frame, separator: &str) -> String {
    frame.data().iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(separator)
}

fn is_remote(frame: &Frame) -> bool {
    frame.flags.contains(FrameFlags::REMOTE)
}

fn id(frame: &Frame) -> u16 {
    assert!(matches!(frame.id, CanId::Standard(_)), "these captures have 11-bit identifiers only");
    u16::try_from(frame.id.number()).unwrap()
}

fn screen(frames: &[Frame]) -> Vec<u8> {
    let mut text = String::new();
    for frame in frames {
        let time = micros(frame, &frames[0]);
        let data =
            if is_remote(frame) { " remote request".to_owned() } else { format!(" {}", hex(frame, " ")) };
        let (seconds, fraction) = (time / 1_000_000, time % 1_000_000);
        writeln!(text, " ({seconds:03}.{fraction:06})  can0  {}   [{}] {data}", frame.id, frame.length)
            .unwrap();
    }
    text.into_bytes()
}

fn asc(frames: &[Frame]) -> Vec<u8> {
    let mut text = String::from("date Sam Sep 30 15:06:13.191 2017\nbase hex  timestamps absolute\n");
    for frame in frames {
        let time = micros(frame, &frames[0]);
        let kind = if is_remote(frame) { 'r' } else { 'd' };
        let (seconds, fraction) = (time / 1_000_000, time % 1_000_000);
        let (length, data) = (frame.length, hex(frame, " "));
        writeln!(text, "   {seconds}.{fraction:06} 1  {:X}  Rx   {kind} {length} {data}", id(frame)).unwrap();
    }
    text.into_bytes()
}

fn trc(frames: &[Frame]) -> Vec<u8> {
    let mut text = String::from(";$FILEVERSION=2.1\n;$STARTTIME=44548.5\n;$COLUMNS=N,O,T,B,I,d,R,L,D\n");
    for frame in frames {
        let time = micros(frame, &frames[0]);
        let kind = if is_remote(frame) { "RR" } else { "DT" };
        let (number, id, length, data) = (frame.number, id(frame), frame.length, hex(frame, " "));
        writeln!(
            text,
            "{number:>7} {}.{:03} {kind} 1 {id:04X} Rx - {length} {data}",
            time / 1000,
            time % 1000
        )
        .unwrap();
    }
    text.into_bytes()
}

/// The 227 link layer: identifier with its flags big-endian, length, three bytes, data.
fn socketcan(frame: &Frame) -> Vec<u8> {
    let flags = if is_remote(frame) { 0x4000_0000 } else { 0 };
    let mut bytes = (u32::from(id(frame)) | flags).to_be_bytes().to_vec();
    bytes.extend([frame.length, 0, 0, 0]);
    bytes.extend(frame.data());
    bytes
}

fn pcap(frames: &[Frame]) -> Vec<u8> {
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let mut bytes = words(&[0xA1B2_C3D4, 0x0004_0002, 0, 0, 65_535, 227]);
    for frame in frames {
        let packet = socketcan(frame);
        let time = u64::try_from(frame.time.unwrap().0 / 1_000).unwrap();
        let (seconds, fraction) = (time / 1_000_000, time % 1_000_000);
        let length = u32::try_from(packet.len()).unwrap();
        bytes.extend(words(&[
            u32::try_from(seconds).unwrap(),
            u32::try_from(fraction).unwrap(),
            length,
            length,
        ]));
        bytes.extend(packet);
    }
    bytes
}

fn pcapng(frames: &[Frame]) -> Vec<u8> {
    let block = |kind: u32, body: &[u8]| {
        let padded = body.len().div_ceil(4) * 4;
        let length = u32::try_from(padded + 12).unwrap().to_le_bytes();
        let padding = vec![0; padded - body.len()];
        [&kind.to_le_bytes()[..], &length[..], body, &padding[..], &length[..]].concat()
    };
    let mut section = 0x1A2B_3C4D_u32.to_le_bytes().to_vec();
    section.extend([1, 0, 0, 0]);
    section.extend([0xFF; 8]);
    let mut bytes = block(0x0A0D_0D0A, &section);
    bytes.extend(block(1, &[227, 0, 0, 0, 0, 0, 0, 0]));
    for frame in frames {
        let packet = socketcan(frame);
        let time = u64::try_from(frame.time.unwrap().0 / 1_000).unwrap();
        let length = u32::try_from(packet.len()).unwrap();
        let halves = [u32::try_from(time >> 32).unwrap(), u32::try_from(time & 0xFFFF_FFFF).unwrap()];
        let header = [0, halves[0], halves[1], length, length];
        let mut body: Vec<u8> = header.iter().flat_map(|word: &u32| word.to_le_bytes()).collect();
        body.extend(packet);
        bytes.extend(block(6, &body));
    }
    bytes
}

#[test]
fn one_traffic_in_every_format() {
    for name in CAPTURES {
        let path = workspace().join("fixtures/canopen").join(name).with_extension("log");
        let log = fs::read(path).unwrap();
        let (frames, expected) = (frames(&log), events(&log));
        assert!(expected.len() > 10, "{name}");
        for (format, bytes) in [
            ("screen", screen(&frames)),
            ("asc", asc(&frames)),
            ("trc", trc(&frames)),
            ("pcap", pcap(&frames)),
            ("pcapng", pcapng(&frames)),
        ] {
            let found = events(&bytes);
            for (found, expected) in found.iter().zip(&expected) {
                assert_eq!(found, expected, "{name} as {format}");
            }
            assert_eq!(found.len(), expected.len(), "{name} as {format}");
        }
    }
}

/// cangen's default: random identifiers, lengths and data.
#[test]
fn random_traffic_is_no_canopen_network() {
    let mut state = 0x2545_F491_4F6C_DD1D_u64;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut log = String::new();
    for number in 0..20_000_u32 {
        let length = usize::try_from(next() % 9).unwrap();
        let data: String = (0..length).map(|_| format!("{:02X}", next() & 0xFF)).collect::<Vec<_>>().concat();
        let id = next() & 0x7FF;
        let (seconds, fraction) = (1_700_000_000 + number / 5, number % 5 * 200_000);
        writeln!(log, "({seconds}.{fraction:06}) can0 {id:03X}#{data}").unwrap();
    }
    let mut claimed = 0;
    let mut reader = CaptureReader::open(log.as_bytes(), &ReadOptions::default()).unwrap();
    let mut decoder = Decoder::new(SessionOptions::default());
    let mut batch = Batch::new();
    while reader.read(&mut batch).unwrap() {
        for frame in batch.frames() {
            decoder.push(frame, reader.buses(), &mut |event: &Event, _: &Bus| {
                claimed += u32::from(event.protocol == EventProtocol::Canopen && !event.presumed);
            });
        }
    }
    assert!(!decoder.buses().first().unwrap().protocols().is_canopen());
    assert_eq!(claimed, 0);
}
