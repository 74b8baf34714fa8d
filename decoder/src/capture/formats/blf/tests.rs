//! Tests with captures built byte by byte.

use super::*;
use crate::capture::testing::{read_capture, read_in_pieces};
use crate::capture::{CaptureReader, ReadOptions};
use crate::frame::{CanId, Timestamp};
use crate::words::UNKNOWN_ZONE;

fn header(start: [u16; 8]) -> Vec<u8> {
    let mut header = vec![0; HEADER];
    header[..4].copy_from_slice(MAGIC);
    header[4..8].copy_from_slice(&144_u32.to_le_bytes());
    for (field, bytes) in start.iter().zip(header[START..].chunks_mut(2)) {
        bytes.copy_from_slice(&field.to_le_bytes());
    }
    header
}

/// An object of header version 1 with a time in nanoseconds, and with fill bytes as Vector writes them.
fn object(kind: u32, time: u64, body: &[u8]) -> Vec<u8> {
    let size = u32::try_from(32 + body.len()).unwrap();
    let mut object = b"LOBJ\x20\0\x01\0".to_vec();
    object.extend([size, kind, 2, 0].iter().flat_map(|n| n.to_le_bytes()));
    object.extend(time.to_le_bytes());
    object.extend(body);
    object.resize(object.len() + object.len() % 4, 0);
    object
}

/// A classic frame of three bytes with this identifier on channel 1.
fn message(id: u16, time: u64) -> Vec<u8> {
    let [low, high] = id.to_le_bytes();
    object(1, time, &[1, 0, 0, 3, low, high, 0, 0, low, 2, 3, 0, 0, 0, 0, 0])
}

fn container(method: u16, size: usize, content: &[u8]) -> Vec<u8> {
    let mut container = b"LOBJ\x10\0\x01\0".to_vec();
    container.extend(u32::try_from(32 + content.len()).unwrap().to_le_bytes());
    container.extend(10_u32.to_le_bytes());
    container.extend(method.to_le_bytes());
    container.extend([0; 6]);
    container.extend(u32::try_from(size).unwrap().to_le_bytes());
    container.extend([0; 4]);
    container.extend(content);
    container.resize(container.len() + container.len() % 4, 0);
    container
}

fn stored(content: &[u8]) -> Vec<u8> {
    container(0, content.len(), content)
}

#[cfg(feature = "gzip")]
fn zlib(content: &[u8]) -> Vec<u8> {
    use std::io::Write as _;
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(content).unwrap();
    container(2, content.len(), &encoder.finish().unwrap())
}

fn capture(parts: &[&[u8]]) -> Vec<u8> {
    [&header([0; 8])[..], &parts.concat()].concat()
}

/// Messages 0, 1, 2 …, one millisecond apart.
fn messages(count: u16) -> Vec<u8> {
    (0..count).flat_map(|n| message(n % 0x800, u64::from(n) * 1_000_000)).collect()
}

fn ids(capture: &[u8]) -> Vec<u32> {
    read_capture(capture).frames.iter().map(|frame| frame.id.number()).collect()
}

fn notices(capture: &[u8]) -> Vec<String> {
    read_capture(capture).items.into_iter().filter(|item| !item.starts_with('{')).collect()
}

#[test]
fn a_frame_has_a_time_from_the_start_of_the_recording() {
    // Friday the 10th of July 2015, 08:17:32.250: `date -u -d '2015-07-10 08:17:32' +%s` is 1436516252
    let start = header([2015, 7, 5, 10, 8, 17, 32, 250]);
    let content = read_capture(&[&start[..], &stored(&message(0x181, 1_500_000_001))].concat());
    let [frame] = content.frames.as_slice() else { panic!("{content:?}") };
    assert_eq!((frame.id, frame.data()), (CanId::Standard(0x181), &[0x81, 2, 3][..]));
    assert_eq!(frame.time, Some(Timestamp(1_436_516_253_750_000_001)));
    assert_eq!(content.buses, ["1"]);
    assert_eq!(content.items[0], UNKNOWN_ZONE);
}

#[test]
fn an_invalid_date_is_reported_and_an_empty_one_is_not() {
    let start = header([2015, 13, 5, 10, 8, 17, 32, 250]);
    let capture = [&start[..], &stored(&message(1, 7))].concat();
    assert_eq!(read_capture(&capture).frames[0].time, Some(Timestamp(7)));
    assert_eq!(notices(&capture), ["byte 40: invalid start date: times count from 1970"]);
    assert_eq!(notices(&self::capture(&[&stored(&message(1, 7))])), [""; 0]);
}

#[test]
fn times_have_a_unit_of_their_own_and_headers_a_version() {
    let mut ten_microseconds = message(1, 12_345);
    ten_microseconds[16] = 1;
    // Version 2 has eight more bytes before the body.
    let mut later = message(2, 9);
    (later[4], later[6], later[8]) = (40, 2, 56);
    later.splice(32..32, [0xEE; 8]);
    let content = read_capture(&capture(&[&stored(&[ten_microseconds, later].concat())]));
    assert_eq!(content.frames[0].time, Some(Timestamp(123_450_000)));
    assert_eq!((content.frames[1].time, content.frames[1].data()), (Some(Timestamp(9)), &[2, 2, 3][..]));
}

#[test]
fn objects_span_containers_however_they_are_cut() {
    let content = messages(20);
    for size in [1, 7, 15, 16, 17, 31, 47, 48, 49, 100, 5_000] {
        let containers: Vec<u8> = content.chunks(size).flat_map(stored).collect();
        let capture = capture(&[&containers]);
        assert_eq!(ids(&capture), (0..20).collect::<Vec<_>>(), "{size}");
        assert_eq!(notices(&capture), [""; 0], "{size}");
    }
}

#[test]
fn objects_outside_of_containers_and_others_between() {
    let text = object(65, 0, &[b'x'; 6_001]);
    let lone = [message(1, 0), text.clone(), message(2, 0)].concat();
    let inside = stored(&[message(3, 0), text, message(4, 0)].concat());
    let capture = capture(&[&lone, &inside, &message(5, 0)]);
    assert_eq!(ids(&capture), [1, 2, 3, 4, 5]);
    assert_eq!(notices(&capture), [""; 0]);
}

#[test]
fn a_capture_that_comes_in_pieces_reads_the_same() {
    let content = messages(700);
    let containers: Vec<u8> = content.chunks(1_000).flat_map(stored).collect();
    let capture = capture(&[&containers, b"rubbish", &message(1, 0)]);
    let whole = read_capture(&capture);
    assert_eq!(whole.frames.len(), 701);
    for sizes in [&[1][..], &[3, 997], &[4_096]] {
        assert_eq!(read_in_pieces(&capture, sizes), whole);
    }
}

/// Resumes at each position and compares the result with an uninterrupted read.
fn resumes_from_any_position(capture: &[u8]) {
    let mut reader = CaptureReader::open(capture, &ReadOptions::default()).unwrap();
    let mut batch = Batch::new();
    let (mut taken, whole) = (0, ids(capture));
    while reader.read(&mut batch).unwrap() {
        taken += batch.frames().len();
        let position = reader.position();
        let rest = &capture[usize::try_from(position.offset).unwrap()..];
        let mut resumed = CaptureReader::resume(rest, &position);
        let (mut found, mut own) = (Vec::new(), Batch::new());
        while resumed.read(&mut own).unwrap() {
            found.extend(own.frames().iter().map(|frame| frame.id.number()));
        }
        assert_eq!(found, whole[taken..], "after {taken} frames");
    }
}

#[test]
fn reading_resumes_inside_a_container() {
    let content = messages(2_000);
    resumes_from_any_position(&capture(&[&stored(&content)]));
    let containers: Vec<u8> = content.chunks(30_011).flat_map(stored).collect();
    resumes_from_any_position(&capture(&[&containers]));
}

#[test]
fn what_the_recorder_lost() {
    let overrun = object(91, 0, &[1, 0, 0, 0, 2, 0, 0, 0]);
    let on_lin = object(91, 0, &[5, 0, 0, 0, 2, 0, 0, 0]);
    let begin = object(125, 0, &[0; 4]);
    let end = object(126, 0, &[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 17, 0, 0, 0]);
    let capture = capture(&[&stored(&[message(1, 0), overrun, on_lin, begin.clone(), end, begin].concat())]);
    assert_eq!(
        notices(&capture),
        ["byte 144: frames lost", "byte 144: 17 frames lost", "byte 144: frames lost"]
    );
    assert_eq!(read_capture(&capture).buses, ["1", "2"]);
}

#[test]
fn errors_are_frames_and_other_buses_are_reported() {
    let errors = [object(2, 0, &[1, 0, 0, 0]), object(3, 0, &[1, 0, 0, 0, 0, 0, 0, 0])].concat();
    let capture = capture(&[&stored(
        &[errors, object(11, 0, &[0; 20]), object(31, 0, &[1, 0, 9, 8, 0, 0, 0, 0])].concat(),
    )]);
    let content = read_capture(&capture);
    let ids: Vec<u32> = content.frames.iter().map(|frame| frame.id.number()).collect();
    assert_eq!(ids, [0x088, 0x008, 0x200]);
    assert_eq!(notices(&capture), ["1 message of LIN skipped"]);
}

#[test]
fn wrong_sizes_are_reported_and_the_next_objects_are_read() {
    let content = messages(3);
    let mut long = content.clone();
    long[48 + 8] = 200;
    assert_eq!(ids(&capture(&[&stored(&long), &stored(&content)])), [0, 1, 2, 0, 1, 2]);
    let mut short = content.clone();
    short[48 + 8] = 40;
    let short = capture(&[&stored(&short)]);
    assert_eq!(ids(&short), [0, 2]);
    let texts = notices(&short);
    assert_eq!(texts[0], "byte 144: object type 1: 40 bytes are too short for the type");
    assert_eq!(texts[1], "byte 144: 32 bytes outside of objects skipped");
    // A container whose declared size includes the next one.
    let mut both = [stored(&content), stored(&content)].concat();
    both[8] = 0xFF;
    let both = capture(&[&both]);
    assert_eq!(ids(&both), [0, 1, 2, 0, 1, 2]);
    assert_eq!(
        notices(&both),
        ["byte 144: container of 255 bytes: another container begins after 176 bytes"]
    );
}

#[test]
fn unknown_compression_is_reported_and_the_next_object_is_read() {
    let capture = capture(&[&container(1, 9, b"something"), &stored(&messages(2))]);
    assert_eq!(ids(&capture), [0, 1]);
    assert_eq!(notices(&capture), ["byte 144: container compression 1; expected 0 or 2 (zlib)"]);
}

#[test]
fn a_capture_cut_off_anywhere_gives_what_was_whole() {
    let capture = capture(&[&stored(&messages(3)), &message(9, 0), &stored(&messages(2))]);
    let ends: Vec<usize> = [224, 272, 320].into_iter().chain([368]).chain([448, 496]).collect();
    for length in 4..capture.len() {
        let content = read_capture(&capture[..length]);
        let expected = ends.iter().filter(|end| **end <= length).count();
        assert_eq!(content.frames.len(), expected, "{length}");
        let is_between = [144, 320, 368].contains(&length);
        assert_eq!(content.items.len() == expected, is_between, "{length}: {:?}", content.items);
    }
}

#[cfg(feature = "gzip")]
mod compressed {
    use super::*;

    #[test]
    fn compressed_containers_read_as_stored_ones() {
        let content = messages(3_000);
        for size in [33, 1_000, 40_000, 1 << 20] {
            let containers: Vec<u8> = content.chunks(size).flat_map(zlib).collect();
            assert_eq!(
                read_capture(&capture(&[&containers])).frames,
                read_capture(&capture(&[&stored(&content)])).frames
            );
        }
        let containers: Vec<u8> = content.chunks(20_011).flat_map(zlib).collect();
        resumes_from_any_position(&capture(&[&containers]));
        resumes_from_any_position(&capture(&[&zlib(&content)]));
    }

    #[test]
    fn a_container_whose_size_lies_loses_nothing_behind_it() {
        let content = messages(5);
        for size in [0x7FFF_u32, 0x00FF_FFFF, 0x7FFF_FFFF] {
            let mut containers = [zlib(&content), zlib(&content)].concat();
            containers[8..12].copy_from_slice(&size.to_le_bytes());
            let capture = capture(&[&containers]);
            let found = ids(&capture);
            assert!(found.ends_with(&[0, 1, 2, 3, 4]), "{found:?}");
            assert_eq!(notices(&capture).len(), 1, "{:?}", notices(&capture));
        }
    }

    #[test]
    fn a_damaged_container_is_reported_and_the_next_is_read() {
        let content = messages(200);
        let mut containers: Vec<u8> = content.chunks(3_000).flat_map(zlib).collect();
        let middle = containers.len() / 2;
        containers[middle] ^= 0x10;
        let capture = capture(&[&containers]);
        let found = ids(&capture);
        assert_eq!((found.first(), found.last()), (Some(&0), Some(&199)));
        assert!(notices(&capture).iter().any(|notice| notice.contains("damaged")), "{:?}", notices(&capture));
    }

    #[test]
    fn a_bomb_is_reported() {
        let bomb = zlib(&vec![0; LARGEST_CONTAINER * 2 + 5_000]);
        let texts = notices(&capture(&[&bomb, &stored(&message(1, 0))]));
        assert!(texts[0].contains("rest skipped"), "{texts:?}");
        assert_eq!(ids(&capture(&[&bomb, &stored(&message(1, 0))])), [1]);
    }
}

#[cfg(not(feature = "gzip"))]
#[test]
fn a_build_without_an_inflater_says_so() {
    let capture = capture(&[&stored(&message(1, 0)), &container(2, 9, b"whatever")]);
    let mut reader = CaptureReader::open(&capture[..], &ReadOptions::default()).unwrap();
    let mut batch = Batch::new();
    assert!(reader.read(&mut batch).unwrap());
    let error = reader.read(&mut batch).unwrap_err().to_string();
    assert!(error.contains("lacks the feature `gzip`"), "{error}");
}

/// CAN_DRIVER_ERROR (31) and its extension (74) state both counters in bytes 2 and 3; a repetition is no news.
#[test]
fn counters_of_a_controller_are_a_state_that_is_reported_when_it_changes() {
    let state = |kind: u32, channel: u8, transmit: u8, receive: u8| {
        object(kind, 0, &[channel, 0, transmit, receive, 0, 0, 0, 0])
    };
    let objects = [
        state(31, 1, 0, 0),
        state(31, 1, 0, 0),
        state(31, 2, 0, 0),
        state(74, 1, 8, 130),
        state(31, 1, 8, 130),
        state(31, 1, 0, 0),
    ];
    let content = read_capture(&capture(&[&objects.concat()]));
    let found: Vec<_> = content
        .frames
        .iter()
        .map(|frame| (frame.bus.0, frame.id.number(), frame.data()[6], frame.data()[7]))
        .collect();
    assert_eq!(found, [(0, 0x200, 0, 0), (1, 0x200, 0, 0), (0, 0x200, 8, 130), (0, 0x200, 0, 0)]);
}
