//! Link layer of packet captures: what stands before a CAN frame in a packet of pcap and pcapng.
//!
//! ```text
//! 227 CAN_SOCKETCAN  frame
//! 113 LINUX_SLL      0 packet type (2)  2 device type (2)  4 address length (2)  6 address (8)
//!                   14 protocol (2)    16 frame
//! 276 LINUX_SLL2     0 protocol (2)     2 reserved (2)     4 interface index (4)  8 device type (2)
//!                   10 packet type (1) 11 address length (1)  12 address (8)     20 frame
//! ```
//! The cooked headers (SLL) are big-endian in every capture. The identifier behind them is in the order
//! of the capture (libpcap: of the machine that wrote it), that of type 227 is big-endian.
//!
//! The protocol says 0x000C for CAN, 0x000D for CAN FD, 0x000E for CAN XL; anything else is no CAN, as on
//! the device `any`. Packet type 4 is a frame this host sent; the other types do not say that it was
//! received, because Linux loops sent frames back as broadcasts.

mod channel;
mod socketcan;

pub(super) use channel::{Channel, Head, Output};
pub use socketcan::kernel_frame;
pub(super) use socketcan::{IdOrder, common};

use super::byte_order::ByteOrder;
use crate::frame::FrameFlags;

/// Kinds of packet that may hold CAN frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Link {
    /// The frame alone.
    SocketCan,
    /// Linux "cooked" header, first version.
    Cooked,
    /// Linux "cooked" header, second version.
    Cooked2,
    /// Something else, by its number.
    Other(u16),
}

impl Link {
    /// The link type of a capture's header; the upper half may hold the length of a checksum.
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

/// What a packet turned out to hold.
enum Opened<'a> {
    /// A frame in SocketCAN's layout.
    Can(Payload<'a>),
    /// Another protocol, by its number.
    NotCan(u16),
    /// Fewer bytes than the header has.
    Short {
        /// How many the header has.
        header: usize,
    },
}

/// A CAN frame taken out of its packet.
struct Payload<'a> {
    bytes: &'a [u8],
    kind: Kind,
    flags: FrameFlags,
    /// The recording host's number of the interface.
    interface: Option<u32>,
}

/// What the link layer knows about a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    /// Nothing: the frame must say.
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

/// Takes the link layer off a packet.
fn open(link: Link, packet: &[u8]) -> Opened<'_> {
    let big = ByteOrder::Big;
    let header = match link {
        Link::Other(number) => return Opened::NotCan(number),
        Link::SocketCan => {
            let flags = FrameFlags::default();
            return Opened::Can(Payload { bytes: packet, kind: Kind::Unsaid, flags, interface: None });
        }
        Link::Cooked => 16,
        Link::Cooked2 => 20,
    };
    let Some(bytes) = packet.get(header..) else { return Opened::Short { header } };
    let (protocol, packet_type, interface) = if link == Link::Cooked {
        (big.u16(packet, 14), big.u16(packet, 0), None)
    } else {
        (big.u16(packet, 0), packet.get(10).copied().map(u16::from), big.u32(packet, 4))
    };
    let kind = match protocol.unwrap_or(0) {
        PROTOCOL_CAN => Kind::Unsaid,
        PROTOCOL_CAN_FD => Kind::Fd,
        PROTOCOL_CAN_XL => Kind::Xl,
        other => return Opened::NotCan(other),
    };
    let outgoing = packet_type == Some(PACKET_OUTGOING);
    let flags = if outgoing { FrameFlags::TRANSMITTED } else { FrameFlags::default() };
    Opened::Can(Payload { bytes, kind, flags, interface })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksum_bits_in_a_link_type_are_ignored() {
        assert_eq!(Link::new(0x1000_00E3), Link::SocketCan);
        assert_eq!(Link::new(0x2400_0071), Link::Cooked);
        assert_eq!(Link::new(276), Link::Cooked2);
        assert_eq!(Link::new(1), Link::Other(1));
    }

    #[test]
    fn a_cooked_header_tells_protocol_and_direction() {
        let packet = b"\0\x04\x01\x18\0\0\0\0\0\0\0\0\0\0\0\x0DFRAME";
        let Opened::Can(payload) = open(Link::Cooked, packet) else { panic!("expected CAN") };
        assert_eq!((payload.bytes, payload.kind), (&b"FRAME"[..], Kind::Fd));
        assert_eq!((payload.flags, payload.interface), (FrameFlags::TRANSMITTED, None));
        assert!(matches!(open(Link::Cooked, &packet[..15]), Opened::Short { header: 16 }));
        let other = b"\0\x01\0\x01\0\x06\0\0\0\0\0\0\0\0\x08\0IP";
        assert!(matches!(open(Link::Cooked, other), Opened::NotCan(0x0800)));
    }

    #[test]
    fn a_cooked_header_of_version_two_tells_the_interface() {
        let packet = b"\0\x0C\0\0\0\0\0\x07\x01\x18\x01\0\0\0\0\0\0\0\0\0FRAME";
        let Opened::Can(payload) = open(Link::Cooked2, packet) else { panic!("expected CAN") };
        assert_eq!((payload.bytes, payload.kind), (&b"FRAME"[..], Kind::Unsaid));
        assert_eq!((payload.flags, payload.interface), (FrameFlags::default(), Some(7)));
        assert!(matches!(open(Link::Cooked2, &packet[..19]), Opened::Short { header: 20 }));
    }
}
