//! Unit tests of the pcap parser, in a separate file because of their length.

#![expect(clippy::cast_possible_truncation, reason = "made-up numbers are small")]

use proptest::prelude::*;

use super::*;
use crate::capture::testing::{read_capture, read_in_pieces};

const SYNC: &[u8] = b"\0\0\0\x80\0\0\0\0\0\0\0\0\0\0\0\0";
const HEARTBEAT: &[u8] = b"\0\0\x07\x05\x01\0\0\0\x7F";

fn number(order: ByteOrder, number: u32) -> [u8; 4] {
    match order {
        ByteOrder::Big => number.to_be_bytes(),
        ByteOrder::Little => number.to_le_bytes(),
    }
}

fn capture(order: ByteOrder, magic: u32, link: u32, packets: &[&[u8]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for field in [magic, if order == ByteOrder::Big { 0x0002_0004 } else { 0x0004_0002 }, 0, 0, 0, link] {
        bytes.extend(number(order, field));
    }
    for (index, packet) in packets.iter().enumerate() {
        let length = packet.len() as u32;
        for field in [1_700_000_000 + index as u32, 123_456, length, length] {
            bytes.extend(number(order, field));
        }
        bytes.extend(*packet);
    }
    bytes
}

fn usual(packets: &[&[u8]]) -> Vec<u8> {
    capture(ByteOrder::Little, 0xA1B2_C3D4, 227, packets)
}

#[test]
fn both_byte_orders_and_both_resolutions() {
    for order in [ByteOrder::Big, ByteOrder::Little] {
        for (magic, fraction) in [(0xA1B2_C3D4, "123456000"), (0xA1B2_3C4D, "000123456")] {
            let content = read_capture(&capture(order, magic, 227, &[SYNC, HEARTBEAT, SYNC]));
            let expected = [
                format!("{{1}} (1700000000.{fraction}) bus0 080# flags=00 dlc=0"),
                format!("{{2}} (1700000001.{fraction}) bus0 705#7F flags=00 dlc=0"),
                format!("{{3}} (1700000002.{fraction}) bus0 080# flags=00 dlc=0"),
            ];
            assert_eq!(content.items, expected, "{order:?} {magic:08X}");
            assert_eq!(content.buses, ["can0"]);
        }
    }
}

#[test]
fn cooked_packets_of_both_versions() {
    let mut first = b"\0\x04\x01\x18\0\0\0\0\0\0\0\0\0\0\0\x0C".to_vec();
    first.extend(HEARTBEAT);
    let content = read_capture(&capture(ByteOrder::Big, 0xA1B2_C3D4, 113, &[&first]));
    assert_eq!(content.items, ["{1} (1700000000.123456000) bus0 705#7F flags=20 dlc=0"]);
    let second = |index: u8| {
        let mut packet = vec![0, 0x0C, 0, 0, 0, 0, 0, index, 1, 0x18, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        packet.extend(b"\x05\x07\0\0\x01\0\0\0\x7F");
        packet
    };
    let packets = [second(3), second(9), second(3)];
    let packets: Vec<&[u8]> = packets.iter().map(Vec::as_slice).collect();
    let content = read_capture(&capture(ByteOrder::Little, 0xA1B2_C3D4, 276, &packets));
    assert_eq!(content.items[0], "{1} (1700000000.123456000) bus0 705#7F flags=00 dlc=0");
    assert_eq!(content.buses, ["if3", "if9"]);
    assert_eq!(content.frames.iter().map(|frame| frame.bus.0).collect::<Vec<_>>(), [0, 1, 0]);
}

#[test]
fn all_kinds_of_frame() {
    let mut fd = vec![0x98, 0xFE, 0xF1, 0x80, 12, 0x05, 0, 0];
    fd.extend([0xAB; 12]);
    let content = read_capture(&capture(
        ByteOrder::Little,
        0xA1B2_C3D4,
        0x1400_00E3,
        &[
            b"\x40\0\x07\x05\x01\0\0\0\0\0\0\0\0\0\0\0",
            b"\x20\0\0\x04\x08\0\0\0\0\x10\0\0\0\0\x60\0",
            &fd,
            b"\0\0\x01\x23\x08\0\0\x0F12345678",
            b"\0\0\0\x05\x81\0\x01\0\0\0\0\0x",
            b"\0\0\x01\x23\x08\0\0\x00123",
            b"",
        ],
    ));
    assert_eq!(
        content.items,
        [
            "{1} (1700000000.123456000) bus0 705#R1 flags=01 dlc=0",
            "{2} (1700000001.123456000) bus0 00000004#0010000000006000 flags=02 dlc=0",
            "{3} (1700000002.123456000) bus0 18FEF180#ABABABABABABABABABABABAB flags=0C dlc=0",
            "{4} (1700000003.123456000) bus0 123#3132333435363738 flags=00 dlc=15",
            "byte 156: CAN XL frame: not supported (priority 005, VCID 00, SDT 00, AF 00000000, 1 bytes)",
            "byte 185: CAN frame: found 3 of 8 data bytes",
            "byte 212: CAN frame: found 0 bytes; expected at least 8",
        ]
    );
}

#[test]
fn identifiers_in_the_writers_order_are_detected_and_reported_once() {
    let content = read_capture(&usual(&[
        b"\x01\x02\0\0\x01\0\0\0A",
        b"\x80\0\0\0\x01\0\0\0B",
        b"\x05\x07\0\0\x01\0\0\0C",
    ]));
    assert_eq!(
        content.items,
        [
            "interface \"can0\": identifiers are little-endian, contrary to the standard; read as little-endian",
            "{1} (1700000000.123456000) bus0 201#41 flags=00 dlc=0",
            "{2} (1700000001.123456000) bus0 080#42 flags=00 dlc=0",
            "{3} (1700000002.123456000) bus0 705#43 flags=00 dlc=0",
        ]
    );
}

#[test]
fn a_capture_of_something_else_says_so_at_its_end() {
    let content = read_capture(&capture(ByteOrder::Little, 0xA1B2_C3D4, 1, &[SYNC, b"", HEARTBEAT]));
    assert_eq!(content.items, ["interface \"can0\" is Ethernet, not CAN (link type 1): 3 packets skipped"]);
    assert_eq!(content.buses, [] as [&str; 0]);
    let arp = b"\0\x01\0\x01\0\x06\0\0\0\0\0\0\0\0\x08\x06who has";
    let content = read_capture(&capture(ByteOrder::Little, 0xA1B2_C3D4, 113, &[arp]));
    assert_eq!(
        content.items,
        ["interface \"can0\": 1 packet other than CAN skipped (first protocol 0x0806)"]
    );
    assert_eq!(read_capture(&usual(&[])).items, [] as [&str; 0]);
}

#[test]
fn a_capture_that_ends_too_early_says_where() {
    let whole = usual(&[SYNC, HEARTBEAT]);
    for missing in 1..9 + 16 {
        let content = read_capture(&whole[..whole.len() - missing]);
        let found = 25 - missing;
        let of = if found < 16 { 16 } else { 25 };
        assert_eq!(content.frames.len(), 1);
        let expected = format!("byte 56: the capture ends inside a packet: found {found} of {of} bytes");
        assert_eq!(content.items[1..], [expected]);
    }
    assert_eq!(read_capture(&whole[..56]).items.len(), 1);
    assert_eq!(read_capture(&whole[..24]).items.len(), 0);
    let options = crate::capture::ReadOptions::default();
    let mut reader = crate::capture::CaptureReader::open(&whole[..20], &options).unwrap();
    let error = reader.read(&mut Batch::new()).unwrap_err();
    assert!(error.to_string().starts_with("pcap: byte 0: found 20 bytes"), "{error}");
}

#[test]
fn a_length_no_packet_has_is_passed_over_without_memory_for_it() {
    let mut bytes = usual(&[SYNC]);
    let mut header = [0u8; 16];
    header[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    bytes.extend(header);
    bytes.extend(vec![0; 600_000]);
    let content = read_capture(&bytes);
    assert_eq!(
        content.items[1..],
        [
            "byte 56: packet of 4294967295 bytes: too long for a CAN frame",
            "byte 600072: the capture ends inside a packet: 4294367295 bytes are missing"
        ]
    );
    let long = vec![0; LARGEST_PACKET + 1];
    let longest = vec![0; LARGEST_PACKET];
    let content = read_capture(&usual(&[&long, SYNC, &longest, SYNC]));
    assert_eq!(content.frames.len(), 3, "the longest is read, and has length 0");
    let content = read_capture(&capture(ByteOrder::Big, 0xA1B2_C3D4, 1, &[&long, SYNC]));
    assert_eq!(content.items, ["interface \"can0\" is Ethernet, not CAN (link type 1): 2 packets skipped"]);
}

#[test]
fn odd_headers_of_packets_are_read_all_the_same() {
    let mut bytes = usual(&[HEARTBEAT, HEARTBEAT]);
    bytes[28..32].copy_from_slice(&3_000_001u32.to_le_bytes());
    bytes[36..40].copy_from_slice(&0u32.to_le_bytes());
    let content = read_capture(&bytes);
    assert_eq!(content.items[0], "{1} (1700000003.000001000) bus0 705#7F flags=00 dlc=0");
    assert_eq!(content.frames.len(), 2);
}

fn packets() -> impl Strategy<Value = Vec<u8>> {
    let packet = prop_oneof![
        4 => Just(SYNC.to_vec()),
        4 => Just(HEARTBEAT.to_vec()),
        1 => proptest::collection::vec(any::<u8>(), 0..80),
        1 => (0u8..65).prop_map(|length| {
            let mut packet = vec![0, 0, 1, 0x23, length, 4, 0, 0];
            packet.extend(vec![length; usize::from(length)]);
            packet
        }),
    ];
    (any::<bool>(), any::<bool>(), proptest::collection::vec(packet, 0..40)).prop_map(
        |(big, nano, packets)| {
            let packets: Vec<&[u8]> = packets.iter().map(Vec::as_slice).collect();
            let order = if big { ByteOrder::Big } else { ByteOrder::Little };
            capture(order, if nano { 0xA1B2_3C4D } else { 0xA1B2_C3D4 }, 227, &packets)
        },
    )
}

proptest! {
    #[test]
    fn pieces_of_any_size_give_the_same(bytes in packets(), sizes in proptest::collection::vec(1usize..60, 1..8)) {
        prop_assert_eq!(read_in_pieces(&bytes, &sizes), read_capture(&bytes));
    }

    #[test]
    fn damage_anywhere_is_survived(
        mut bytes in packets(),
        damage in proptest::collection::vec((24usize..2_000, any::<u8>()), 1..10),
        sizes in proptest::collection::vec(1usize..60, 1..8),
    ) {
        for (at, byte) in damage {
            if let Some(target) = bytes.get_mut(at) {
                *target = byte;
            }
        }
        prop_assert_eq!(read_in_pieces(&bytes, &sizes), read_capture(&bytes));
    }

    #[test]
    fn any_bytes_behind_a_header_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..2_000), link in 0u32..300) {
        let mut whole = capture(ByteOrder::Little, 0xA1B2_C3D4, link, &[]);
        whole.extend(bytes);
        read_capture(&whole);
    }
}
