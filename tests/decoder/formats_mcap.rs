//! MCAP: truncated, damaged and hostile captures, and those of ROS 1 and ROS 2.
#![cfg(feature = "mcap")]

use std::fs;

use cobscope_decoder::capture::{CaptureCompression, CapturePlace, Notice, WRITABLE, WriteOptions};
use cobscope_decoder::frame::{CanId, Frame, FrameFlags, Timestamp};

use crate::damaged::Shared;
use crate::formats_text::{Content, read};
use crate::harness::reader::holds_its_contract;
use crate::support::workspace;

const START: i64 = 1_700_000_000_000_000_000;
const PACKINGS: [CaptureCompression; 3] =
    [CaptureCompression::None, CaptureCompression::Lz4, CaptureCompression::Zstd];
const UNFINISHED: &str = "the capture was not finished: read up to its end";

/// A capture with 24 frames in three chunks, including FD frames.
struct Made {
    bytes: Vec<u8>,
    /// End of each chunk, and the number of frames before it.
    chunks: Vec<(usize, usize)>,
}

fn made(packing: CaptureCompression) -> Made {
    let format = WRITABLE.iter().find(|format| format.name == "mcap").unwrap();
    let output = Shared::default();
    let mut writer =
        (format.writer)(Box::new(output.clone()), &WriteOptions { packing, ..WriteOptions::default() });
    let mut chunks = Vec::new();
    for number in 0..24_u8 {
        let mut frame = Frame::data_frame(CanId::from_standard(0x180 + u16::from(number)), &[number; 5]);
        if number % 6 == 5 {
            frame = Frame::data_frame(CanId::from_extended(0x18FE_CA80), &[number; 32]);
            frame.flags = FrameFlags::FD.with(FrameFlags::BIT_RATE_SWITCH);
        }
        frame.time = Some(Timestamp(START + i64::from(number) * 1_000_001));
        writer.write(&frame, if number % 2 == 0 { "can0" } else { "can1" }).unwrap();
        if number % 8 == 7 {
            writer.flush().unwrap();
            chunks.push((output.0.lock().unwrap().len(), usize::from(number) + 1));
        }
    }
    writer.finish().unwrap();
    let bytes = output.0.lock().unwrap().clone();
    Made { bytes, chunks }
}

fn texts(content: &Content) -> Vec<String> {
    content.notices.iter().map(ToString::to_string).collect()
}

/// Records of a file: start, kind and length.
fn records(bytes: &[u8]) -> Vec<(usize, u8, usize)> {
    let (mut at, mut records) = (8, Vec::new());
    while let Some(head) = bytes.get(at..at + 9) {
        let length = usize::try_from(u64::from_le_bytes(head[1..].try_into().unwrap())).unwrap();
        records.push((at, head[0], length));
        at += 9 + length;
    }
    records
}

#[test]
fn a_recording_cut_off_anywhere_gives_what_is_whole_and_says_so() {
    for packing in PACKINGS {
        let Made { bytes, chunks } = made(packing);
        let whole = read(&bytes[..]).unwrap();
        assert_eq!((whole.frames.len(), texts(&whole)), (24, vec![]));
        let ends: Vec<usize> = records(&bytes).iter().map(|(at, ..)| *at).collect();
        let mut before = 0;
        for cut in 8..bytes.len() {
            let content = read(&bytes[..cut]).unwrap();
            assert!(whole.frames.starts_with(&content.frames), "{packing:?}: {cut} bytes");
            let known = chunks.iter().rev().find(|(end, _)| *end <= cut).map_or(0, |(_, frames)| *frames);
            assert!(content.frames.len() >= known.max(before), "{packing:?}: {cut} bytes");
            before = content.frames.len();
            let notices = texts(&content);
            let is_reported = match &content.notices[..] {
                [Notice::Assumption(text)] => text == UNFINISHED,
                notices => notices.iter().all(|notice| {
                    let within = |at: u64| usize::try_from(at).unwrap() <= cut;
                    matches!(
                        notice,
                        Notice::Unreadable { place: CapturePlace::Offset(at), .. }
                        | Notice::CutOff { place: CapturePlace::Offset(at), .. } if within(*at)
                    )
                }),
            };
            assert!(is_reported && !notices.is_empty(), "{packing:?}: {cut} bytes: {notices:?}");
            // Between two records, the only notice is that the file is unfinished.
            assert_eq!(notices == [UNFINISHED], ends.contains(&cut), "{packing:?}: {cut} bytes: {notices:?}");
        }
        assert_eq!(before, 24);
    }
}

#[test]
fn what_is_not_packed_gives_each_frame_before_the_cut() {
    let Made { bytes, .. } = made(CaptureCompression::None);
    // The identifier of each frame is in its message, before the data.
    for number in 0..24_usize {
        if number % 6 == 5 {
            continue;
        }
        let payload = [u8::try_from(number).unwrap(); 5];
        let end = bytes.windows(5).position(|window| window == payload && number > 0).map_or(0, |at| at + 8);
        let content = read(&bytes[..end.max(8)]).unwrap();
        assert!(number == 0 || content.frames.len() == number + 1, "{number}: {}", content.frames.len());
    }
}

#[test]
fn a_recorder_that_crashed_leaves_all_that_it_flushed() {
    for packing in PACKINGS {
        let Made { bytes, chunks } = made(packing);
        for (end, frames) in chunks {
            let content = read(&bytes[..end]).unwrap();
            assert_eq!((content.frames.len(), texts(&content)), (frames, vec![UNFINISHED.to_owned()]));
        }
    }
}

#[test]
fn a_wrong_bit_anywhere_never_changes_frames_unsaid() {
    for packing in PACKINGS {
        let Made { bytes, chunks } = made(packing);
        let whole = read(&bytes[..]).unwrap();
        let mut silent = Vec::new();
        for at in 8..bytes.len() {
            for bit in [at % 8, (at + 3) % 8] {
                let mut damaged = bytes.clone();
                damaged[at] ^= 1 << bit;
                let content = read(&damaged[..]).unwrap();
                let known = chunks.iter().rev().find(|(end, _)| *end <= at).map_or(0, |(_, frames)| *frames);
                assert_eq!(content.frames[..known], whole.frames[..known], "{packing:?}: byte {at}");
                if content.frames != whole.frames && content.notices.is_empty() {
                    silent.push((at, bit));
                }
            }
        }
        assert_eq!(silent, [], "{packing:?}: frames are others and nothing is said");
    }
}

#[test]
fn a_changed_chunk_is_reported_with_its_place() {
    let Made { mut bytes, chunks } = made(CaptureCompression::None);
    let (second, ..) = *records(&bytes).iter().filter(|(_, kind, _)| *kind == 6).nth(1).unwrap();
    // The last byte of the last message: a byte of data.
    let (at, _, length) = *records(&bytes).iter().filter(|(_, kind, _)| *kind == 6).nth(1).unwrap();
    bytes[at + 9 + length - 4] ^= 0x10;
    let content = read(&bytes[..]).unwrap();
    assert_eq!(content.frames.len(), chunks[2].1);
    let expected = format!("byte {second}: chunk: checksum mismatch, its frames may be wrong");
    assert_eq!(texts(&content), [expected]);
}

#[test]
fn lengths_that_lie_are_bounded_by_what_is_there() {
    for packing in PACKINGS {
        let Made { bytes, chunks } = made(packing);
        let whole = read(&bytes[..]).unwrap();
        for size in [4, 8] {
            for lie in [0xFF, 0x7F, 0x00] {
                let step = if packing == CaptureCompression::None { 4 } else { 19 };
                for at in (8..bytes.len() - size).step_by(step) {
                    let mut lying = bytes.clone();
                    lying[at..at + size].fill(lie);
                    let content = read(&lying[..]).unwrap();
                    let known =
                        chunks.iter().rev().find(|(end, _)| *end <= at).map_or(0, |(_, frames)| *frames);
                    assert_eq!(content.frames[..known], whole.frames[..known], "{packing:?}: byte {at}");
                    assert!(content.notices.len() < 100, "{packing:?}: byte {at}");
                }
            }
        }
    }
}

/// Wrong sizes of each record and chunk.
#[test]
fn records_and_chunks_without_end_are_reported() {
    let Made { bytes, .. } = made(CaptureCompression::Zstd);
    for (number, (at, kind, _)) in records(&bytes).into_iter().enumerate() {
        let mut lying = bytes.clone();
        lying[at + 1..at + 9].fill(0xFF);
        let content = read(&lying[..]).unwrap();
        let notices = texts(&content);
        assert!(!notices.is_empty(), "record {number} of kind {kind}");
        assert!(notices.iter().all(|text| text.starts_with("byte ")), "{notices:?}");
        holds_its_contract("mcap", &lying);
    }
    let chunk = records(&bytes).iter().find(|(_, kind, _)| *kind == 6).unwrap().0 + 9;
    // Unpacked size; packed size after the checksum and the name of the compression, "zstd".
    for (place, says) in
        [(16, "expected 18446744073709551615"), (16 + 8 + 4 + 4 + 4, "expected 18446744073709551615")]
    {
        let mut lying = bytes.clone();
        lying[chunk + place..chunk + place + 8].fill(0xFF);
        let content = read(&lying[..]).unwrap();
        assert_eq!(content.frames.len(), 24, "{place}");
        assert!(texts(&content)[0].ends_with(says), "{:?}", texts(&content));
    }
}

fn fixture(name: &str) -> Content {
    read(&fs::read(workspace().join("fixtures/recorders").join(name)).unwrap()[..]).unwrap()
}

/// Compares a frame with frame `number` of `make_mcap.py`: identifier and time.
fn assert_made(number: u32, frame: &Frame) {
    let id = number * 0x111;
    let expected =
        if number >= 8 { CanId::from_extended(id) } else { CanId::from_standard(u16::try_from(id).unwrap()) };
    assert_eq!(frame.id, expected);
    assert_eq!(frame.time, Some(Timestamp(START + i64::from(number) * 125_000_000)));
}

#[test]
fn a_recording_of_ros_1() {
    let content = fixture("ros1.mcap");
    assert_eq!(
        (content.frames.len(), texts(&content), &content.buses[..]),
        (20, vec![], &["can0".to_owned()][..])
    );
    for (number, frame) in (0..).zip(&content.frames) {
        assert_made(number, frame);
        let length = usize::try_from(number % 9).unwrap();
        let direction = if number % 2 == 0 { FrameFlags::RECEIVED } else { FrameFlags::TRANSMITTED };
        if number == 5 {
            assert_eq!(
                (frame.flags, usize::from(frame.length)),
                (direction.with(FrameFlags::REMOTE), length)
            );
        } else {
            assert_eq!(
                (frame.flags, frame.data()),
                (direction, &vec![u8::try_from(number).unwrap(); length][..])
            );
        }
    }
}

#[test]
fn a_recording_of_ros_2() {
    let content = fixture("ros2.mcap");
    assert_eq!(content.buses, ["can0", "can1"]);
    assert_eq!(texts(&content), ["2 messages of topics without CAN frames skipped"]);
    assert_eq!(content.frames.len(), 20);
    for (number, frame) in (0..).zip(&content.frames) {
        assert_made(number, frame);
        let (bus, flags, length) = match number % 4 {
            3 => (1, FrameFlags::RECEIVED.with(FrameFlags::FD), 12),
            2 => (0, FrameFlags::TRANSMITTED, number % 9),
            _ => (0, FrameFlags::RECEIVED, number % 9),
        };
        assert_eq!((frame.bus.0, u32::from(frame.length)), (bus, length), "{number}");
        if number != 5 {
            assert_eq!(frame.flags, flags, "{number}");
            assert!(frame.data().iter().all(|byte| u32::from(*byte) == number), "{number}");
        }
    }
}
