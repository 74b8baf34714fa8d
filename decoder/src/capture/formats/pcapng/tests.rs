//! Unit tests of the pcapng parser, in a separate file because of their length.

#![expect(clippy::cast_possible_truncation, reason = "made-up numbers are small")]

use proptest::prelude::*;

use super::*;
use crate::capture::testing::{read_capture, read_in_pieces};

const SYNC: &[u8] = b"\0\0\0\x80\0\0\0\0\0\0\0\0\0\0\0\0";
const HEARTBEAT: &[u8] = b"\0\0\x07\x05\x01\0\0\0\x7F";

/// Writes blocks in one byte order.
#[derive(Clone)]
struct Writer {
    order: ByteOrder,
    bytes: Vec<u8>,
}

impl Writer {
    fn new(order: ByteOrder) -> Self {
        let mut writer = Self { order, bytes: Vec::new() };
        writer.section();
        writer
    }

    /// Section with one CAN interface.
    fn usual() -> Self {
        let mut writer = Self::new(ByteOrder::Little);
        writer.interface(227, &[]);
        writer
    }

    fn u16(&self, number: u16) -> [u8; 2] {
        if self.order == ByteOrder::Big { number.to_be_bytes() } else { number.to_le_bytes() }
    }

    fn u32(&self, number: u32) -> [u8; 4] {
        if self.order == ByteOrder::Big { number.to_be_bytes() } else { number.to_le_bytes() }
    }

    fn block(&mut self, kind: u32, body: &[u8]) -> &mut Self {
        let size = body.len().next_multiple_of(4);
        let length = self.u32(size as u32 + 12);
        self.bytes.extend(self.u32(kind));
        self.bytes.extend(length);
        self.bytes.extend(body);
        self.bytes.resize(self.bytes.len() + size - body.len(), 0);
        self.bytes.extend(length);
        self
    }

    fn section(&mut self) -> &mut Self {
        let body = [&self.u32(0x1A2B_3C4D)[..], &self.u16(1), &self.u16(0), &[0xFF; 8]].concat();
        self.block(0x0A0D_0D0A, &body)
    }

    fn options(&self, options: &[(u16, &[u8])]) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (code, value) in options {
            bytes.extend(self.u16(*code));
            bytes.extend(self.u16(value.len() as u16));
            bytes.extend(*value);
            bytes.resize(bytes.len().next_multiple_of(4), 0);
        }
        if !options.is_empty() {
            bytes.extend([0; 4]);
        }
        bytes
    }

    fn interface(&mut self, link: u16, options: &[(u16, &[u8])]) -> &mut Self {
        let body = [&self.u16(link)[..], &[0; 2], &self.u32(0), &self.options(options)].concat();
        self.block(1, &body)
    }

    fn packet(&mut self, interface: u32, ticks: u64, packet: &[u8], options: &[(u16, &[u8])]) -> &mut Self {
        let length = self.u32(packet.len() as u32);
        let (high, low) = (self.u32((ticks >> 32) as u32), self.u32((ticks & 0xFFFF_FFFF) as u32));
        let mut body = [&self.u32(interface)[..], &high, &low, &length, &length, packet].concat();
        body.resize(body.len().next_multiple_of(4), 0);
        body.extend(self.options(options));
        self.block(6, &body)
    }

    fn items(&self) -> Vec<String> {
        read_capture(&self.bytes).items
    }
}

#[test]
fn both_byte_orders_and_several_sections() {
    let mut writer = Writer::new(ByteOrder::Little);
    writer.interface(227, &[(2, b"left")]).packet(0, 1_700_000_000_000_000, SYNC, &[]);
    writer.order = ByteOrder::Big;
    writer.section().interface(227, &[(9, b"\x09"), (2, b"right\0")]);
    writer.packet(0, 1_700_000_001_000_000_002, HEARTBEAT, &[]).packet(
        0,
        1_700_000_002_000_000_003,
        SYNC,
        &[],
    );
    let content = read_capture(&writer.bytes);
    assert_eq!(
        content.items,
        [
            "{1} (1700000000.000000000) bus0 080# flags=00 dlc=0",
            "{2} (1700000001.000000002) bus1 705#7F flags=00 dlc=0",
            "{3} (1700000002.000000003) bus1 080# flags=00 dlc=0",
        ]
    );
    assert_eq!(content.buses, ["left", "right"]);
}

#[test]
fn every_interface_has_its_own_clock_and_name() {
    let mut writer = Writer::new(ByteOrder::Big);
    writer.interface(227, &[(9, b"\x0C")]).interface(227, &[(9, b"\x8A"), (14, b"\0\0\0\0\0\0\0\x64")]);
    writer.interface(227, &[(2, b"\xFFvcan"), (9, b"\xFF"), (14, b"\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF")]);
    for interface in [2, 0, 1, 0] {
        writer.packet(interface, 5_120, SYNC, &[]);
    }
    let content = read_capture(&writer.bytes);
    assert_eq!(
        content.items,
        [
            "{1} (-1.000000000) bus0 080# flags=00 dlc=0",
            "{2} (0.000000005) bus1 080# flags=00 dlc=0",
            "{3} (105.000000000) bus2 080# flags=00 dlc=0",
            "{4} (0.000000005) bus1 080# flags=00 dlc=0",
        ]
    );
    assert_eq!(content.buses, ["\u{FFFD}vcan", "can0", "can1"]);
}

#[test]
fn packets_of_all_three_kinds() {
    let mut writer = Writer::usual();
    writer.block(3, &[&[9, 0, 0, 0], HEARTBEAT].concat());
    writer.block(2, &[&b"\0\0\x02\0\0\0\0\0\x07\0\0\0\x09\0\0\0\x09\0\0\0"[..], HEARTBEAT].concat());
    writer.block(2, &[&b"\0\0\xFF\xFF\0\0\0\0\x07\0\0\0\x09\0\0\0\x09\0\0\0"[..], HEARTBEAT].concat());
    writer.packet(0, 7, HEARTBEAT, &[(2, b"\x02\0\0\0"), (4, b"\x03\0\0\0\0\0\0\0")]);
    writer.packet(0, 7, HEARTBEAT, &[(1, b"comment"), (2, b"\x01\0\0\0")]);
    assert_eq!(
        writer.items(),
        [
            "{1} bus0 705#7F flags=00 dlc=0",
            "byte 76: 2 frames lost",
            "{2} (0.000007000) bus0 705#7F flags=00 dlc=0",
            "{3} (0.000007000) bus0 705#7F flags=00 dlc=0",
            "byte 164: 3 frames lost",
            "{4} (0.000007000) bus0 705#7F flags=20 dlc=0",
            "{5} (0.000007000) bus0 705#7F flags=40 dlc=0",
        ]
    );
}

#[test]
fn packets_state_their_interface_only_on_the_device_any() {
    let mut writer = Writer::new(ByteOrder::Big);
    writer.interface(276, &[(2, b"any")]).interface(276, &[(2, b"can7")]).interface(276, &[]);
    let mut packet = vec![0, 0x0C, 0, 0, 0, 0, 0, 5, 1, 0x18, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    packet.extend(HEARTBEAT);
    writer.packet(0, 1, &packet, &[]).packet(1, 2, &packet, &[]).packet(2, 3, &packet, &[]);
    let content = read_capture(&writer.bytes);
    assert_eq!(content.buses, ["if5", "can7"]);
    assert_eq!(content.items[2], "{3} (0.000003000) bus0 705#7F flags=20 dlc=0");
}

#[test]
fn a_simple_packet_is_cut_at_the_interfaces_longest() {
    let mut writer = Writer::new(ByteOrder::Little);
    writer.block(1, b"\xE3\0\0\0\x0A\0\0\0");
    writer.block(3, b"\x10\0\0\0\0\0\x01\x23\x04\0\0\0AB\0\0");
    assert_eq!(writer.items(), ["byte 48: CAN frame: found 2 of 4 data bytes"]);
}

#[test]
fn losses_are_reported_when_their_counter_grows() {
    let mut writer = Writer::usual();
    writer.interface(1, &[]);
    let mut statistics = |interface: u8, code: u8, lost: u8| {
        let mut body = vec![interface, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, code, 0, 8, 0];
        body.extend([lost, 0, 0, 0, 0, 0, 0, 0]);
        writer.block(5, &body);
    };
    for (interface, code, lost) in [(0, 5, 0), (0, 5, 4), (0, 7, 4), (0, 5, 9), (1, 5, 9), (7, 5, 9)] {
        statistics(interface, code, lost);
    }
    assert_eq!(writer.items(), ["byte 104: 4 frames lost", "byte 176: 5 frames lost"]);
}

#[test]
fn packets_that_are_no_can_are_counted_for_each_section() {
    let mut writer = Writer::usual();
    writer.interface(1, &[(2, b"eth\x1B0")]);
    writer.packet(1, 0, b"ethernet", &[]).packet(0, 0, SYNC, &[]).packet(1, 0, b"ethernet", &[]);
    writer.section().interface(212, &[(2, b"lin0")]).packet(0, 0, b"lin", &[]).interface(212, &[]);
    let content = read_capture(&writer.bytes);
    assert_eq!(
        content.items,
        [
            "{1} (0.000000000) bus0 080# flags=00 dlc=0",
            "interface \"eth\\x1b0\" is Ethernet, not CAN (link type 1): 2 packets skipped",
            "interface \"lin0\" is LIN, not CAN (link type 212): 1 packet skipped",
        ]
    );
    assert_eq!(content.buses, ["can0"]);
}

#[test]
fn unknown_blocks_of_any_length_are_passed_over() {
    let mut writer = Writer::usual();
    writer.packet(0, 0, SYNC, &[]);
    for length in [0, 100, LARGEST_RECORD - 12, LARGEST_RECORD - 8, 300_000, 3_000_000] {
        writer.block(0x1234, &vec![6; length]).block(4, &vec![6; length]).packet(0, 0, SYNC, &[]);
    }
    // The comment of an interface or section may have the same length.
    writer.section();
    let body = [&b"\xE3\0\0\0\0\0\0\0\x02\0\x03\0can\0"[..], &vec![1; 300_000]].concat();
    writer.block(1, &body).packet(0, 0, HEARTBEAT, &[]);
    let content = read_capture(&writer.bytes);
    assert_eq!(content.items.len(), 8, "{:?}", content.items);
    assert_eq!(content.frames.len(), 8);
    assert_eq!(content.buses, ["can0", "can"]);
    assert_eq!(read_in_pieces(&writer.bytes, &[70_001]), content);
}

#[test]
fn bytes_that_are_no_block_are_passed_over_and_reported() {
    let garbage: [(&[u8], &str); 7] = [
        (&[0; 40], "block of invalid length: 40 bytes"),
        (b"x", "bytes between blocks: 1 byte"),
        (b"xyz", "bytes between blocks: 3 bytes"),
        (b"\x06\0\0\0\x20\0\0\0 an interrupted packet", "block with two different lengths: 30 bytes"),
        (b"\x06\0\0\0\xFC\xFF\xFF\xFF", "block of invalid length: 8 bytes"),
        (b"\x99\0\0\0\xFC\xFF\xFF\xFF", "block of invalid length: 8 bytes"),
        (b"\x0A\x0D\x0D\x0A\x1C\0\0\0bad magic", "section header without magic: 17 bytes"),
    ];
    for (garbage, expected) in garbage {
        let mut writer = Writer::usual();
        writer.packet(0, 0, SYNC, &[]).bytes.extend(garbage);
        for _ in 0..4_000 {
            writer.packet(0, 0, HEARTBEAT, &[]);
        }
        let content = read_capture(&writer.bytes);
        assert_eq!(content.items[1], format!("byte 96: {expected} skipped"));
        assert_eq!((content.frames.len(), content.items.len()), (4_001, 4_002));
    }
}

#[test]
fn a_long_block_with_the_wrong_end_is_reported_where_it_began() {
    let mut writer = Writer::usual();
    writer.block(0x1234, &vec![6; 200_000]).packet(0, 0, SYNC, &[]);
    let end = 48 + 8 + 200_000;
    writer.bytes[end] ^= 1;
    let items = writer.items();
    assert_eq!(items[0], "byte 48: block with two different lengths: 200012 bytes skipped");
    assert_eq!(items.len(), 2);
}

#[test]
fn a_capture_that_ends_too_early_says_where() {
    let mut writer = Writer::usual();
    writer.packet(0, 0, SYNC, &[]);
    let start = writer.bytes.len();
    writer.packet(0, 0, HEARTBEAT, &[]);
    for end in start + 1..writer.bytes.len() {
        let items = read_capture(&writer.bytes[..end]).items;
        let bytes = if end == start + 1 { "byte" } else { "bytes" };
        let count = end - start;
        assert_eq!(
            items[1..],
            [format!("byte 96: the capture ends inside a block: {count} {bytes} skipped")]
        );
    }
    let mut writer = Writer::usual();
    writer.block(0x1234, &vec![6; 200_000]);
    for end in [150_000, 200_058, 200_059] {
        let items = read_capture(&writer.bytes[..end]).items;
        assert_eq!(items, ["byte 48: the capture ends inside a block of 200012 bytes"]);
    }
}

#[test]
fn hostile_numbers_in_packets_and_interfaces() {
    let mut writer = Writer::new(ByteOrder::Little);
    writer.packet(0, 0, SYNC, &[]).block(3, b"\x10\0\0\0");
    writer.block(1, b"\xE3\0").packet(0, 0, SYNC, &[]);
    writer.interface(227, &[]).packet(2, 0, SYNC, &[]).packet(u32::MAX, 0, SYNC, &[]);
    writer
        .block(6, b"\x01\0\0\0\0\0\0\0\0\0\0\0\xFF\xFF\xFF\xFF\0\0\0\0data")
        .block(6, b"short")
        .block(2, b"");
    writer.block(3, b"").block(5, b"");
    // Fewer bytes on the wire than captured.
    writer.block(6, &[&b"\x01\0\0\0\0\0\0\0\0\0\0\0\x09\0\0\0\0\0\0\0"[..], HEARTBEAT].concat());
    assert_eq!(
        writer.items(),
        [
            "byte 28: packet of undefined interface 0",
            "byte 76: packet of undefined interface 0",
            "byte 92: interface description: too short",
            "{1} (0.000000000) bus0 080# flags=00 dlc=0",
            "byte 176: packet of undefined interface 2",
            "byte 224: packet of undefined interface 4294967295",
            "byte 272: packet block: found 4 of 4294967295 captured bytes",
            "byte 308: packet block: too short",
            "byte 328: packet block: too short",
            "byte 340: packet block: too short",
            "{2} (0.000000000) bus1 705#7F flags=00 dlc=0",
        ]
    );
}

#[test]
fn interfaces_beyond_the_limit_have_unreadable_packets() {
    let mut writer = Writer::new(ByteOrder::Little);
    for _ in 0..1_030 {
        writer.interface(227, &[(2, b"same")]);
    }
    let last = writer.bytes.len();
    writer.packet(1_024, 0, SYNC, &[]).packet(1_023, 0, SYNC, &[]);
    assert_eq!(
        writer.items(),
        [
            format!("byte {last}: packet of undefined interface 1024"),
            "{1} (0.000000000) bus0 080# flags=00 dlc=0".into()
        ]
    );
}

#[test]
fn more_buses_than_a_capture_may_name() {
    let mut writer = Writer::new(ByteOrder::Little);
    for _ in 0..65 {
        writer.interface(227, &[]);
    }
    for interface in 0..65 {
        writer.packet(interface, 0, SYNC, &[]);
    }
    let content = read_capture(&writer.bytes);
    assert_eq!(content.frames.len(), 64);
    assert!(content.items[64].ends_with("more than 64 interfaces"), "{:?}", content.items[64]);
}

fn blocks() -> impl Strategy<Value = Vec<u8>> {
    let step = (0u8..20, 0u32..3, any::<u64>(), proptest::collection::vec(any::<u8>(), 0..70));
    (any::<bool>(), proptest::collection::vec(step, 0..40)).prop_map(|(is_big, steps)| {
        let mut writer = Writer::new(if is_big { ByteOrder::Big } else { ByteOrder::Little });
        writer.interface(227, &[]).interface(113, &[(2, b"any"), (9, b"\x8A")]);
        for (step, interface, ticks, bytes) in steps {
            match step {
                0 => drop(writer.section().interface(227, &[])),
                1 => drop(writer.interface(ticks as u16, &[(9, &bytes), (14, &bytes)])),
                2 => drop(writer.block(ticks as u32, &bytes)),
                3 => drop(writer.block(u32::from(step) + interface, &bytes)),
                4 => writer.bytes.extend(bytes),
                5 => drop(writer.packet(interface, ticks, &bytes, &[(2, &bytes), (4, &bytes)])),
                6..10 => drop(writer.packet(interface, ticks, HEARTBEAT, &[])),
                _ => drop(writer.packet(0, ticks, SYNC, &[])),
            }
        }
        writer.bytes
    })
}

proptest! {
    #[test]
    fn pieces_of_any_size_give_the_same(bytes in blocks(), sizes in proptest::collection::vec(1usize..90, 1..8)) {
        prop_assert_eq!(read_in_pieces(&bytes, &sizes), read_capture(&bytes));
    }

    #[test]
    fn damage_anywhere_is_survived(
        mut bytes in blocks(),
        damage in proptest::collection::vec((12usize..3_000, any::<u8>()), 1..10),
        sizes in proptest::collection::vec(1usize..90, 1..8),
    ) {
        for (at, byte) in damage {
            if let Some(target) = bytes.get_mut(at) {
                *target = byte;
            }
        }
        prop_assert_eq!(read_in_pieces(&bytes, &sizes), read_capture(&bytes));
    }

    #[test]
    fn any_bytes_behind_a_header_are_survived(bytes in proptest::collection::vec(any::<u8>(), 0..3_000)) {
        let mut whole = Writer::usual().bytes;
        whole.extend(bytes);
        read_capture(&whole);
    }
}
