//! Blocks with losses on the bus and in the capture.

use super::*;

/// Collects parts; a gap is written as one `?` per byte.
fn into(text: &mut Vec<u8>) -> impl FnMut(DataPart<'_>) {
    |part| match part {
        DataPart::Bytes(bytes) => text.extend_from_slice(bytes),
        DataPart::Gap(count) => text.resize(text.len() + count, b'?'),
    }
}

fn segments(blocks: &mut BlockProgress, text: &mut Vec<u8>, list: &[(u8, &[u8])]) {
    for (byte, data) in list {
        blocks.add_segment(byte & 0x7F, byte & 0x80 != 0, data, into(text));
    }
}

#[test]
fn the_check_value_of_the_standard() {
    // CiA 301 §7.2.4.3.16: the CRC of "123456789" is 0x31C3.
    assert_eq!(crc16(0, b"123456789"), 0x31C3);
}

#[test]
fn two_segments_in_one_block() {
    let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
    blocks.client_offers(true);
    blocks.server_offers(true);
    segments(&mut blocks, &mut data, &[(1, b"1234567"), (0x82, b"89\0\0\0\0\0")]);
    blocks.acknowledge_segments(2, 9, into(&mut data));
    assert!(blocks.is_complete);
    blocks.end_block(5, 0x31C3, into(&mut data));
    assert_eq!((data.as_slice(), blocks.crc_verdict()), (&b"123456789"[..], Some(CrcCheck::Correct)));
    assert_eq!((blocks.missing, blocks.losses), (0, 0));
}

#[test]
fn segments_without_acknowledgement_are_repeated() {
    // §7.2.4.3.9: after ackseq 1 the sender continues with the next segment as number 1.
    let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
    segments(&mut blocks, &mut data, &[(1, b"1234567"), (0x82, b"89\0\0\0\0\0")]);
    blocks.acknowledge_segments(1, 9, into(&mut data));
    assert!(!blocks.is_complete);
    segments(&mut blocks, &mut data, &[(0x81, b"89\0\0\0\0\0")]);
    blocks.acknowledge_segments(1, 11, into(&mut data));
    assert!(blocks.is_complete);
    blocks.end_block(5, 0x31C3, into(&mut data));
    assert_eq!((data.as_slice(), blocks.crc_verdict()), (&b"123456789"[..], Some(CrcCheck::Correct)));
    assert_eq!((blocks.missing, blocks.losses), (0, 1));
    assert_eq!(blocks.first_loss, Some(BlockLoss { sequence: 2, frame: Some(9) }));
}

#[test]
fn a_repeated_segment_that_is_not_captured_is_known_from_its_first_transmission() {
    let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
    segments(&mut blocks, &mut data, &[(1, b"1234567"), (0x82, b"89\0\0\0\0\0")]);
    blocks.acknowledge_segments(1, 9, into(&mut data));
    blocks.acknowledge_segments(1, 11, into(&mut data));
    assert!(blocks.is_complete);
    blocks.end_block(5, 0x31C3, into(&mut data));
    assert_eq!((data.as_slice(), blocks.missing), (&b"123456789"[..], 0));
}

#[test]
fn an_acknowledged_segment_that_was_not_captured_is_a_gap() {
    let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
    segments(&mut blocks, &mut data, &[(0x82, b"89\0\0\0\0\0")]);
    blocks.acknowledge_segments(2, 9, into(&mut data));
    blocks.end_block(5, 0x31C3, into(&mut data));
    assert_eq!((data.as_slice(), blocks.crc_verdict()), (&b"???????89"[..], Some(CrcCheck::Unchecked)));
    assert_eq!((blocks.missing, blocks.losses), (1, 0));
}

#[test]
fn a_final_segment_that_was_not_captured_is_a_gap() {
    let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
    segments(&mut blocks, &mut data, &[(1, b"1234567")]);
    blocks.acknowledge_segments(2, 9, into(&mut data));
    assert!(!blocks.is_complete && blocks.expects_end());
    blocks.end_block(5, 0x31C3, into(&mut data));
    assert_eq!((data.as_slice(), blocks.missing), (&b"1234567??"[..], 1));
}

#[test]
fn a_sequence_that_starts_again_overwrites_nothing() {
    // Blocks of 2 segments; the first acknowledgement is missing in the capture. The CRC confirms it.
    let (mut blocks, mut data) = (BlockProgress { size: Some(2), ..BlockProgress::default() }, Vec::new());
    let list: [(u8, &[u8]); 3] = [(1, b"abcdefg"), (2, b"hijklmn"), (0x81, b"op\0\0\0\0\0")];
    segments(&mut blocks, &mut data, &list);
    blocks.acknowledge_segments(1, 9, into(&mut data));
    blocks.end_block(5, crc16(0, b"abcdefghijklmnop"), into(&mut data));
    assert_eq!((data.as_slice(), blocks.crc_verdict()), (&b"abcdefghijklmnop"[..], Some(CrcCheck::Correct)));
    assert!(!blocks.is_unreliable());
}

#[test]
fn a_hole_over_an_acknowledgement_is_a_gap_and_no_loss() {
    // Blocks of 3; segment 3, the acknowledgement and segment 1 of the next block are missing.
    let (mut blocks, mut data) = (BlockProgress { size: Some(3), ..BlockProgress::default() }, Vec::new());
    segments(&mut blocks, &mut data, &[(1, b"abcdefg"), (2, b"hijklmn"), (2, b"vwxyz01")]);
    blocks.acknowledge_segments(2, 9, into(&mut data));
    blocks.give_up(into(&mut data));
    assert_eq!(data, b"abcdefghijklmn??????????????vwxyz01");
    assert_eq!((blocks.missing, blocks.losses), (2, 0));
    assert!(blocks.is_unreliable());
}

#[test]
fn an_end_without_acknowledgement_keeps_the_last_block() {
    let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
    segments(&mut blocks, &mut data, &[(1, b"1234567"), (0x82, b"89\0\0\0\0\0")]);
    assert!(blocks.expects_end());
    blocks.end_block(5, 0x31C3, into(&mut data));
    assert_eq!((data.as_slice(), blocks.crc_verdict()), (&b"123456789"[..], Some(CrcCheck::Correct)));
}

#[test]
fn a_frame_twice_and_a_short_segment() {
    let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
    segments(&mut blocks, &mut data, &[(1, b"1234567"), (1, b"1234567"), (2, b"89"), (0x83, b"x")]);
    blocks.acknowledge_segments(3, 9, into(&mut data));
    blocks.end_block(6, 0, into(&mut data));
    assert_eq!(data, b"123456789?????x", "bytes that were not sent are not invented");
}

#[test]
fn an_acknowledgement_of_more_than_a_block_has_acknowledges_nothing() {
    let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
    segments(&mut blocks, &mut data, &[(0x81, b"1234567")]);
    blocks.acknowledge_segments(128, 9, into(&mut data));
    assert!(data.is_empty() && !blocks.is_complete);
}

#[test]
fn a_wrong_crc_is_seen() {
    let (mut blocks, mut data) = (BlockProgress::default(), Vec::new());
    segments(&mut blocks, &mut data, &[(0x81, b"1234567")]);
    blocks.acknowledge_segments(1, 9, into(&mut data));
    blocks.end_block(0, 0, into(&mut data));
    assert_eq!(blocks.crc_verdict(), Some(CrcCheck::Wrong));
}

/// A transfer of ten segments in blocks of five. The receiver acknowledges the first ones of a block early, and the
/// sender continues in one of three ways: every value is whole, without a gap, and its CRC is right.
#[test]
fn a_block_of_which_a_part_is_acknowledged_continues_in_three_ways() {
    let all: Vec<u8> = (1..=70).collect();
    let data = |place: usize| all.chunks(7).nth(place).unwrap().to_vec();
    for (sent, count) in (1..5_u8).flat_map(|sent| (1..=sent).map(move |count| (sent, count))) {
        for way in 0..3 {
            let (mut blocks, mut text) =
                (BlockProgress { size: Some(5), ..BlockProgress::default() }, Vec::new());
            let add = |blocks: &mut BlockProgress, text: &mut Vec<u8>, sequence: u8, place: u8| {
                let is_last = place == 9;
                blocks.add_segment(sequence, is_last, &data(place.into()), into(text));
            };
            (0..sent).for_each(|place| add(&mut blocks, &mut text, place + 1, place));
            blocks.acknowledge_segments(count, 9, into(&mut text));
            let mut next = count;
            match way {
                // Segments that were sent before the acknowledgement arrived.
                1 => (sent..5).for_each(|place| add(&mut blocks, &mut text, place + 1, place)),
                // The numbers go on.
                2 => {
                    (count..5).for_each(|place| add(&mut blocks, &mut text, place + 1, place));
                    blocks.acknowledge_segments(5, 10, into(&mut text));
                    next = 5;
                }
                _ => {}
            }
            while next < 10 {
                let segments = (10 - next).min(5);
                (0..segments).for_each(|place| add(&mut blocks, &mut text, place + 1, next + place));
                blocks.acknowledge_segments(segments, 11, into(&mut text));
                next += segments;
            }
            assert!(blocks.is_complete, "{sent} {count} {way}");
            blocks.end_block(0, crc16(0, &all), into(&mut text));
            let found = (text.as_slice(), blocks.crc_verdict(), blocks.missing);
            assert_eq!(found, (all.as_slice(), Some(CrcCheck::Correct), 0), "{sent} {count} {way}");
            // Only a segment that was sent again was lost.
            assert!(way != 2 || sent != count || blocks.losses == 0, "{sent} {count}");
        }
    }
}
