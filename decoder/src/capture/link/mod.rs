//! Link layer of packet captures: headers before the CAN frame in packets of pcap and pcapng.
//!
//! ```text
//! 227 CAN_SOCKETCAN  frame
//! 113 LINUX_SLL      0 packet type (2)  2 device type (2)  4 address length (2)  6 address (8)
//!                   14 protocol (2)    16 frame
//! 276 LINUX_SLL2     0 protocol (2)     2 reserved (2)     4 interface index (4)  8 device type (2)
//!                   10 packet type (1) 11 address length (1)  12 address (8)     20 frame
//! ```
//! The cooked headers (SLL) are big-endian in all captures. The identifier after them has the byte order of
//! the capture (libpcap: of the machine that wrote it); that of type 227 is big-endian.
//!
//! The protocol is 0x000C for CAN, 0x000D for CAN FD, 0x000E for CAN XL; other values are not CAN and occur
//! on the device `any`. Packet type 4 means transmitted by this host. Other types do not mean received,
//! because Linux loops transmitted frames back as broadcasts.

mod channel;
mod socketcan;

pub(super) use channel::{CaptureInterface, PacketHeader, PacketOutput};
pub use socketcan::kernel_frame;
pub(super) use socketcan::{IdOrder, frame_of_packet, parse_common};

use super::byte_order::ByteOrder;
use crate::frame::FrameFlags;

/// Link types that can contain CAN frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LinkType {
    /// A frame without header.
    SocketCan,
    /// Linux "cooked" header, version 1.
    Cooked,
    /// Linux "cooked" header, version 2.
    Cooked2,
    /// Another link type, by its number.
    Other(u16),
}

impl LinkType {
    /// The link type in a capture header; the upper half may contain the length of a checksum.
    pub(super) fn new(number: u32) -> Self {
        let [_, _, high, low] = number.to_be_bytes();
        match u16::from_be_bytes([high, low]) {
            227 => Self::SocketCan,
            113 => Self::Cooked,
            276 => Self::Cooked2,
            other => Self::Other(other),
        }
    }
}

/// Content of a packet.
enum PacketContent<'a> {
    /// A frame in SocketCAN's layout.
    Can(LinkPayload<'a>),
    /// Another protocol, by its number.
    NotCan(u16),
    /// Shorter than the header.
    Short {
        /// Size of the header in bytes.
        header: usize,
    },
}

/// A CAN frame extracted from a packet.
struct LinkPayload<'a> {
    bytes: &'a [u8],
    kind: LinkFrameType,
    flags: FrameFlags,
    /// Interface number on the host that recorded the capture.
    interface: Option<u32>,
}

/// Frame type according to the link layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LinkFrameType {
    /// Unknown: determined by the frame.
    Unsaid,
    /// CAN FD.
    Fd,
    /// CAN XL.
    Xl,
}

const PROTOCOL_CAN: u16 = 0x000C;
const PROTOCOL_CAN_FD: u16 = 0x000D;
const PROTOCOL_CAN_XL: u16 = 0x000E;
const PACKET_OUTGOING: u16 = 4;

/// Removes the link layer header from a packet.
fn open_packet(link: LinkType, packet: &[u8]) -> PacketContent<'_> {
    let big = ByteOrder::Big;
    let header = match link {
        LinkType::Other(number) => return PacketContent::NotCan(number),
        LinkType::SocketCan => {
            let flags = FrameFlags::default();
            return PacketContent::Can(LinkPayload {
                bytes: packet,
                kind: LinkFrameType::Unsaid,
                flags,
                interface: None,
            });
        }
        LinkType::Cooked => 16,
        LinkType::Cooked2 => 20,
    };
    let Some(bytes) = packet.get(header..) else { return PacketContent::Short { header } };
    let (protocol, packet_type, interface) = if link == LinkType::Cooked {
        (big.u16(packet, 14), big.u16(packet, 0), None)
    } else {
        (big.u16(packet, 0), packet.get(10).copied().map(u16::from), big.u32(packet, 4))
    };
    let kind = match protocol.unwrap_or(0) {
        PROTOCOL_CAN => LinkFrameType::Unsaid,
        PROTOCOL_CAN_FD => LinkFrameType::Fd,
        PROTOCOL_CAN_XL => LinkFrameType::Xl,
        other => return PacketContent::NotCan(other),
    };
    let outgoing = packet_type == Some(PACKET_OUTGOING);
    let flags = if outgoing { FrameFlags::TRANSMITTED } else { FrameFlags::default() };
    PacketContent::Can(LinkPayload { bytes, kind, flags, interface })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksum_bits_in_a_link_type_are_ignored() {
        assert_eq!(LinkType::new(0x1000_00E3), LinkType::SocketCan);
        assert_eq!(LinkType::new(0x2400_0071), LinkType::Cooked);
        assert_eq!(LinkType::new(276), LinkType::Cooked2);
        assert_eq!(LinkType::new(1), LinkType::Other(1));
    }

    #[test]
    fn a_cooked_header_tells_protocol_and_direction() {
        let packet = b"\0\x04\x01\x18\0\0\0\0\0\0\0\0\0\0\0\x0DFRAME";
        let PacketContent::Can(payload) = open_packet(LinkType::Cooked, packet) else {
            panic!("expected CAN")
        };
        assert_eq!((payload.bytes, payload.kind), (&b"FRAME"[..], LinkFrameType::Fd));
        assert_eq!((payload.flags, payload.interface), (FrameFlags::TRANSMITTED, None));
        assert!(matches!(open_packet(LinkType::Cooked, &packet[..15]), PacketContent::Short { header: 16 }));
        let other = b"\0\x01\0\x01\0\x06\0\0\0\0\0\0\0\0\x08\0IP";
        assert!(matches!(open_packet(LinkType::Cooked, other), PacketContent::NotCan(0x0800)));
    }

    #[test]
    fn a_cooked_header_of_version_two_tells_the_interface() {
        let packet = b"\0\x0C\0\0\0\0\0\x07\x01\x18\x01\0\0\0\0\0\0\0\0\0FRAME";
        let PacketContent::Can(payload) = open_packet(LinkType::Cooked2, packet) else {
            panic!("expected CAN")
        };
        assert_eq!((payload.bytes, payload.kind), (&b"FRAME"[..], LinkFrameType::Unsaid));
        assert_eq!((payload.flags, payload.interface), (FrameFlags::default(), Some(7)));
        assert!(matches!(open_packet(LinkType::Cooked2, &packet[..19]), PacketContent::Short { header: 20 }));
    }
}
