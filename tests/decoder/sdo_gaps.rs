//! Block transfers of which the capture lacks frames (CiA 301 §7.2.4.3.9 to §7.2.4.3.16): bytes that were not captured
//! are gaps, and no byte is at a wrong position.

use std::fmt::Write as _;

use cobscope_decoder::event::{CrcCheck, Event, EventKind, SdoOutcome, SdoTransfer};
use cobscope_decoder::finding::CaptureFindings;
use cobscope_decoder::sink::EventSink;
use cobscope_decoder::sink::jsonl::JsonlSink;
use cobscope_decoder::sink::text::{TextOptions, TextSink};
use cobscope_decoder::{Bus, Reading};
use proptest::prelude::*;

/// Segments per block in all transfers of this file.
const BLOCK: usize = 5;

/// A value whose bytes depend on their position.
fn value(length: usize) -> Vec<u8> {
    (0..length).map(|place| u8::try_from(place * 7 % 251).unwrap()).collect()
}

fn crc(data: &[u8]) -> u16 {
    data.iter().fold(0, |crc, byte| {
        (0..8).fold(
            crc ^ u16::from(*byte) << 8,
            |crc: u16, _| {
                if crc & 0x8000 == 0 { crc << 1 } else { crc << 1 ^ 0x1021 }
            },
        )
    })
}

/// A frame of an upload: from the server?, and data.
type UploadStep = (bool, [u8; 8]);

/// Block upload of 2010:00 from node 5, byte by byte after CiA 301 figures 40 to 45.
fn upload(data: &[u8]) -> Vec<UploadStep> {
    let size = u32::try_from(data.len()).unwrap().to_le_bytes();
    let mut steps = vec![
        (false, [0xA4, 0x10, 0x20, 0, u8::try_from(BLOCK).unwrap(), 0, 0, 0]),
        (true, [0xC6, 0x10, 0x20, 0, size[0], size[1], size[2], size[3]]),
        (false, [0xA3, 0, 0, 0, 0, 0, 0, 0]),
    ];
    let segments: Vec<&[u8]> = data.chunks(7).collect();
    for (number, block) in segments.chunks(BLOCK).enumerate() {
        for (place, segment) in block.iter().enumerate() {
            let is_last = number * BLOCK + place + 1 == segments.len();
            let mut bytes = [0; 8];
            bytes[0] = u8::try_from(place + 1).unwrap() | if is_last { 0x80 } else { 0 };
            bytes[1..=segment.len()].copy_from_slice(segment);
            steps.push((true, bytes));
        }
        let count = u8::try_from(block.len()).unwrap();
        steps.push((false, [0xA2, count, u8::try_from(BLOCK).unwrap(), 0, 0, 0, 0, 0]));
    }
    let unused = u8::try_from((7 - data.len() % 7) % 7).unwrap();
    let [low, high] = crc(data).to_le_bytes();
    steps.push((true, [0xC1 | unused << 2, low, high, 0, 0, 0, 0, 0]));
    steps.push((false, [0xA1, 0, 0, 0, 0, 0, 0, 0]));
    steps
}

/// A capture with a heartbeat before the steps.
fn capture(steps: impl Iterator<Item = UploadStep>) -> String {
    let mut text = String::from("(1.000000) can0 705#05\n");
    for (place, (from_server, data)) in steps.enumerate() {
        let id = if from_server { 0x585 } else { 0x605 };
        write!(text, "(1.{:06}) can0 {id:03X}#", 1_000 + place * 700 + place % 3).unwrap();
        for byte in data {
            write!(text, "{byte:02X}").unwrap();
        }
        text.push('\n');
    }
    text
}

fn decode(text: &str) -> (Vec<SdoTransfer>, CaptureFindings) {
    let mut transfers = Vec::new();
    let mut reading = Reading::new(|event: &Event, _: &Bus| {
        if let EventKind::SdoTransfer(transfer) = &event.kind {
            transfers.push((**transfer).clone());
        }
    });
    reading.run(text.as_bytes()).unwrap();
    let findings = reading.finish().findings;
    (transfers, findings)
}

/// Lines of a capture in text or JSON Lines.
fn printed(text: &str, as_json: bool) -> String {
    let mut out = Vec::new();
    let mut sink: Box<dyn EventSink + '_> = if as_json {
        Box::new(JsonlSink::new(&mut out))
    } else {
        Box::new(TextSink::new(&mut out, TextOptions::default()))
    };
    let mut reading = Reading::new(|event: &Event, bus: &Bus| {
        sink.write_event(event, bus);
    });
    reading.run(text.as_bytes()).unwrap();
    drop(reading);
    sink.finish_output().unwrap();
    drop(sink);
    String::from_utf8(out).unwrap()
}

fn without(steps: &[UploadStep], dropped: &[usize]) -> String {
    let kept = steps.iter().enumerate().filter(|(place, _)| !dropped.contains(place));
    capture(kept.map(|(_, step)| *step))
}

/// All captured bytes are those of the value at their offset.
fn check(transfer: &SdoTransfer, whole: &[u8]) {
    let mut seen = 0;
    for (offset, data) in transfer.ranges() {
        let offset = usize::try_from(offset).unwrap();
        let wanted = whole.get(offset..offset + data.len());
        assert_eq!(wanted, Some(data), "at {offset}");
        seen += data.len();
    }
    assert_eq!(seen as u64, transfer.captured_bytes());
}

#[test]
fn a_complete_transfer_has_no_gap() {
    let whole = value(100);
    let (transfers, findings) = decode(&capture(upload(&whole).into_iter()));
    let [transfer] = transfers.as_slice() else { panic!("{transfers:?}") };
    assert_eq!((transfer.outcome, transfer.crc), (SdoOutcome::Complete, Some(CrcCheck::Correct)));
    assert_eq!((&transfer.data, transfer.unseen, transfer.truncated), (&whole, 0, false));
    assert!(findings.quality.is_empty(), "{:?}", findings.quality);
}

/// 12,000 bytes are announced, and the capture ends after 35 segments of 7 bytes.
#[test]
fn text_counts_the_bytes_seen() {
    let steps = upload(&value(12_000));
    // 3 frames of the start, then 7 blocks of 5 segments and an acknowledgement.
    let text = printed(&capture(steps.into_iter().take(3 + 7 * 6)), false);
    assert!(text.contains("245 of 12,000 bytes seen"), "{text}");
}

/// 100 bytes are 15 segments: 3 blocks of 5. Segment 2 of block 2 (bytes 42 to 48) is not captured.
#[test]
fn an_acknowledged_segment_is_missing_in_the_capture() {
    let whole = value(100);
    let text = without(&upload(&whole), &[3 + 6 + 1]);
    let (transfers, findings) = decode(&text);
    let [transfer] = transfers.as_slice() else { panic!("{transfers:?}") };
    assert_eq!((transfer.size, transfer.unseen, transfer.missing_segments), (100, 7, 1));
    assert_eq!(
        (transfer.losses, transfer.crc, transfer.outcome),
        (0, Some(CrcCheck::Unchecked), SdoOutcome::Complete)
    );
    let ranges: Vec<_> = transfer.ranges().map(|(offset, data)| (offset, data.len())).collect();
    assert_eq!(ranges, [(0, 42), (49, 51)]);
    check(transfer, &whole);
    let quality = "1 segment of SDO transfers not captured (the other side received them)";
    assert_eq!(findings.quality, [quality]);
    assert_eq!(findings.reported_groups().count(), 0, "a property of the capture is not a finding");
    let json = printed(&text, true);
    let line = json.lines().find(|line| line.contains("sdo-transfer")).unwrap();
    for wanted in [
        "\"size\":100,",
        "\"seen\":93,",
        "\"data_ranges\":[{\"offset\":0,\"data\":\"",
        "{\"offset\":49,\"data\":\"",
        "\"missing_segments\":1,",
    ] {
        assert!(line.contains(wanted), "{wanted} in {line}");
    }
    assert!(printed(&text, false).contains("93 of 100 bytes seen"));
}

/// A channel with a gap in every block, and with every acknowledgement, the end or the start missing.
#[test]
fn each_kind_of_frame_may_be_missing() {
    let whole = value(200);
    let steps = upload(&whole);
    let is_ack = |(from_server, data): &UploadStep| !from_server && data[0] == 0xA2;
    let second = |(from_server, data): &UploadStep| *from_server && data[0] & 0x7F == 2;
    let places = |test: &dyn Fn(&UploadStep) -> bool| {
        (0..steps.len()).filter(|place| test(&steps[*place])).collect::<Vec<_>>()
    };
    let count = steps.len();
    let cases = [
        (places(&second), 6, "every second segment"),
        (places(&is_ack), 0, "every acknowledgement"),
        (vec![count - 2], 0, "the end message"),
        (vec![count - 3], 0, "the last acknowledgement"),
        (vec![count - 4], 1, "the final segment"),
        (vec![1], 0, "the response to the initiate message"),
        (vec![2], 0, "the start message"),
        (vec![3], 1, "the first segment"),
    ];
    for (dropped, missing, what) in cases {
        let (transfers, findings) = decode(&without(&steps, &dropped));
        let [transfer] = transfers.as_slice() else { panic!("{what}: {transfers:?}") };
        assert_eq!(transfer.outcome, SdoOutcome::Complete, "{what}");
        assert_eq!((transfer.missing_segments, transfer.size), (missing, 200), "{what}");
        assert_eq!(transfer.frame_count, (count - dropped.len()) as u64, "{what}: frames are counted once");
        assert_eq!(findings.reported_groups().count(), 0, "{what}: {:?}", findings.reported_groups().next());
        check(transfer, &whole);
    }
}

/// Download of 9 bytes: the server acknowledges 1 of 2 segments, so the client repeats the second as number 1.
#[test]
fn repeated_segments_are_neither_missing_nor_double() {
    let [low, high] = crc(b"123456789").to_le_bytes();
    let frame = |from_server: bool, command: u8, data: &[u8]| {
        let mut bytes = [0; 8];
        bytes[0] = command;
        bytes[1..=data.len()].copy_from_slice(data);
        (from_server, bytes)
    };
    let steps = [
        frame(false, 0xC6, &[0x10, 0x20, 0, 9]),
        frame(true, 0xA4, &[0x10, 0x20, 0, 127]),
        frame(false, 0x01, b"1234567"),
        frame(false, 0x82, b"89"),
        frame(true, 0xA2, &[1, 127]),
        frame(false, 0x81, b"89"),
        frame(true, 0xA2, &[1, 127]),
        frame(false, 0xD5, &[low, high]),
        frame(true, 0xA1, &[]),
    ];
    // Also with the repeated segment missing in the capture: it was captured before.
    for (dropped, frames) in [(vec![], 9), (vec![5], 8)] {
        let (transfers, findings) = decode(&without(&steps, &dropped));
        let [transfer] = transfers.as_slice() else { panic!("{transfers:?}") };
        assert_eq!((transfer.data.as_slice(), transfer.size), (&b"123456789"[..], 9));
        assert_eq!((transfer.crc, transfer.missing_segments), (Some(CrcCheck::Correct), 0));
        assert_eq!(
            (transfer.losses, transfer.first_loss, transfer.frame_count),
            (1, Some((2, Some(6))), frames)
        );
        let rules: Vec<_> = findings.reported_groups().map(|group| group.rule.to_string()).collect();
        assert_eq!(rules, ["sdo-block-loss"]);
    }
}

/// A block and its acknowledgement are missing: nothing shows where, but 35 of 200 bytes are missing in the capture, so
/// the CRC shows no defect.
#[test]
fn a_missing_block_is_no_crc_error() {
    let whole = value(200);
    let (transfers, findings) = decode(&without(&upload(&whole), &[3, 4, 5, 6, 7, 8]));
    let [transfer] = transfers.as_slice() else { panic!("{transfers:?}") };
    assert_eq!((transfer.crc, transfer.missing_segments), (Some(CrcCheck::Unchecked), 5));
    assert_eq!((transfer.truncated, transfer.partly_seen()), (true, Some((165, 200))));
    assert_eq!(findings.reported_groups().count(), 0);
}

/// The capture starts between the segments of a block: no bytes are invented for those before.
#[test]
fn a_start_within_a_block_invents_nothing() {
    let whole = value(100);
    let steps = upload(&whole);
    // From segment 2 of the first block on.
    let (transfers, _) = decode(&capture(steps[4..].iter().copied()));
    let [transfer] = transfers.as_slice() else { panic!("{transfers:?}") };
    assert!(transfer.cut_start && transfer.truncated);
    assert_eq!((transfer.data.as_slice(), transfer.unseen), (&whole[7..], 0));
}

/// Segmented transfer of 2010:00, byte by byte after CiA 301 figures 32 to 37: the client asks for, or sends, segments of
/// seven bytes.
fn segmented(data: &[u8], is_upload: bool) -> Vec<UploadStep> {
    let size = u32::try_from(data.len()).unwrap().to_le_bytes();
    let start = |command| [command, 0x10, 0x20, 0, size[0], size[1], size[2], size[3]];
    let mut steps = if is_upload {
        vec![(false, [0x40, 0x10, 0x20, 0, 0, 0, 0, 0]), (true, start(0x41))]
    } else {
        vec![(false, start(0x21)), (true, [0x60, 0x10, 0x20, 0, 0, 0, 0, 0])]
    };
    let count = data.len().div_ceil(7);
    for (place, segment) in data.chunks(7).enumerate() {
        let toggle = if place % 2 == 1 { 0x10 } else { 0 };
        let mut bytes = [0; 8];
        bytes[0] = toggle | u8::try_from(7 - segment.len()).unwrap() << 1 | u8::from(place + 1 == count);
        bytes[1..=segment.len()].copy_from_slice(segment);
        let other = [if is_upload { 0x60 } else { 0x20 } | toggle, 0, 0, 0, 0, 0, 0, 0];
        steps.extend(if is_upload {
            [(false, other), (true, bytes)]
        } else {
            [(false, bytes), (true, other)]
        });
    }
    steps
}

/// 27 bytes are four segments; the second one (bytes 7 to 13) is not captured, nor its request.
#[test]
fn a_segment_is_missing_in_the_capture() {
    let whole = value(27);
    for is_upload in [true, false] {
        let text = without(&segmented(&whole, is_upload), &[4, 5]);
        let (transfers, findings) = decode(&text);
        let [transfer] = transfers.as_slice() else { panic!("{transfers:?}") };
        let ranges: Vec<_> = transfer.ranges().map(|(offset, data)| (offset, data.len())).collect();
        assert_eq!(ranges, [(0, 7), (14, 13)]);
        assert_eq!((transfer.size, transfer.unseen, transfer.missing_segments), (27, 7, 1));
        assert_eq!((transfer.outcome, transfer.truncated), (SdoOutcome::Complete, true));
        check(transfer, &whole);
        assert_eq!(findings.reported_groups().count(), 0, "a property of the capture is not a finding");
        assert!(printed(&text, false).contains("20 of 27 bytes seen"));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever frames between the start and the end of a segmented transfer are missing in one run: each captured byte keeps
    /// its position, or the transfer is known to be incomplete; no defect is reported.
    #[test]
    fn a_run_of_missing_segments_invents_nothing(
        (length, is_upload) in (15_usize..120, any::<bool>()),
        (start, count) in (2_usize..30, 1_usize..9),
    ) {
        let whole = value(length);
        let steps = segmented(&whole, is_upload);
        let dropped: Vec<_> = (start..(start + count).min(steps.len() - 2)).collect();
        let (transfers, findings) = decode(&without(&steps, &dropped));
        prop_assert_eq!(transfers.len(), 1, "{:?}", transfers);
        let transfer = &transfers[0];
        let is_known = transfer.truncated && transfer.missing_segments > 0;
        prop_assert!(is_known || transfer.data == whole, "{:?}", transfer);
        // Without an even number of whole exchanges the toggle bits still alternate: the place is unknown.
        if transfer.unseen > 0 {
            check(transfer, &whole);
        }
        prop_assert_eq!(findings.reported_groups().count(), 0);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever segments are missing, each captured byte keeps its position.
    #[test]
    fn no_byte_moves(length in 8_usize..300, mask in any::<u64>()) {
        let whole = value(length);
        let steps = upload(&whole);
        let is_segment = |step: &UploadStep| step.0 && step.1[0] & 0x7F <= 5 && step.1[0] != 0xC6;
        let dropped: Vec<_> = (3..steps.len() - 2)
            .filter(|place| is_segment(&steps[*place]) && mask >> (place % 64) & 1 == 1)
            .collect();
        let (transfers, findings) = decode(&without(&steps, &dropped));
        prop_assert_eq!(transfers.len(), 1, "{:?}", transfers);
        let transfer = &transfers[0];
        prop_assert_eq!(transfer.missing_segments, dropped.len() as u64);
        prop_assert_eq!((transfer.size, transfer.outcome), (length as u64, SdoOutcome::Complete));
        prop_assert_eq!(findings.reported_groups().count(), 0);
        check(transfer, &whole);
    }

    /// One hole of any position and length in the middle never makes a value that is presented as whole.
    #[test]
    fn a_hole_is_never_a_whole_value(start in 3_usize..40, count in 1_usize..12) {
        let whole = value(200);
        let steps = upload(&whole);
        let dropped: Vec<_> = (start..(start + count).min(steps.len() - 2)).collect();
        let (transfers, _) = decode(&without(&steps, &dropped));
        for transfer in transfers {
            prop_assert!(transfer.truncated || transfer.data == whole, "{:?}", transfer);
        }
    }
}
