//! Transport protocols: messages of more than eight bytes, split into packets of seven.
//!
//! ```text
//! byte            0     1      2      3      4       5 6 7
//! TP.CM   RTS     16    size (2)      packets max    PGN    J1939-21 §5.10.3; max = max packets per CTS
//!         CTS     17    count  next   FF     FF      PGN    count 0 keeps the connection open
//!         EOMA    19    size (2)      packets FF     PGN    end of message acknowledgement
//!         BAM     32    size (2)      packets FF     PGN    to all; not acknowledged
//!         abort   255   reason FF     FF     FF      PGN
//! TP.DT           sequence 1..255, seven bytes
//! ETP.CM  RTS     20    size (4)                     PGN    ISO 11783-3
//!         CTS     21    count  next (3)              PGN
//!         DPO     22    count  offset (3)            PGN    sequence 1 is packet offset + 1
//!         EOMA    23    size (4)                     PGN
//!         abort   255   reason FF     FF     FF      PGN
//! ETP.DT          sequence 1..255, seven bytes
//! ```
//!
//! Numbers and PGNs are sent least significant byte first. Unused bytes after the end of a message are FF.

use nom::Parser;
use nom::bytes::complete::take;
use nom::number::complete::{le_u16, le_u24, le_u32, u8 as byte};

use super::id::Pgn;
use crate::wire::MalformedPayload;
use crate::wire::parser::{Parsed, byte_array, field_group, parse_message};

/// Data bytes per packet.
pub(crate) const PACKET_SIZE: u32 = 7;

/// Min and max message size of the transport protocol in bytes (J1939-21 §5.10.1).
pub(crate) const TP_SIZES: (u32, u32) = (9, 1785);

/// Min and max message size of the extended transport protocol in bytes (ISO 11783-3).
pub(crate) const ETP_SIZES: (u32, u32) = (1786, 117_440_505);

/// A connection management message, TP.CM or ETP.CM.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ConnectionManagement {
    /// The originator requests a connection.
    RequestToSend {
        /// Message size in bytes.
        size: u32,
        /// Number of packets; with the extended protocol calculated from the size.
        packets: u32,
    },
    /// The responder requests packets.
    ClearToSend {
        /// Number of packets; 0 keeps the connection open.
        count: u8,
        /// Number of the first packet, counted from 1.
        next: u32,
    },
    /// The originator announces the next packets (extended protocol only).
    PacketOffset {
        /// Number of packets.
        count: u8,
        /// Packets before the announced ones.
        offset: u32,
    },
    /// The responder has received the complete message.
    EndOfMessage {
        /// Message size in bytes.
        size: u32,
    },
    /// The originator announces a message to all.
    Announce {
        /// Message size in bytes.
        size: u32,
        /// Number of packets.
        packets: u32,
    },
    /// Originator or responder closes the connection.
    Abort {
        /// Reason code; both protocols use the same codes.
        reason: u8,
    },
    /// A control byte that the protocol does not define.
    Unknown,
}

impl ConnectionManagement {
    /// Message name as in J1939-21, or as in ISO 11783-3 if `is_extended`.
    pub const fn name(self, is_extended: bool) -> &'static str {
        match (self, is_extended) {
            (Self::RequestToSend { .. }, false) => "TP.CM_RTS",
            (Self::RequestToSend { .. }, true) => "ETP.CM_RTS",
            (Self::ClearToSend { .. }, false) => "TP.CM_CTS",
            (Self::ClearToSend { .. }, true) => "ETP.CM_CTS",
            (Self::EndOfMessage { .. }, false) => "TP.CM_EndOfMsgACK",
            (Self::EndOfMessage { .. }, true) => "ETP.CM_EOMA",
            (Self::Abort { .. }, false) => "TP.Conn_Abort",
            (Self::Abort { .. }, true) => "ETP.Conn_Abort",
            (Self::PacketOffset { .. }, _) => "ETP.CM_DPO",
            (Self::Announce { .. }, _) => "TP.CM_BAM",
            (Self::Unknown, false) => "TP.CM",
            (Self::Unknown, true) => "ETP.CM",
        }
    }
}

/// Number of packets for a message of `size` bytes.
pub(crate) const fn packets_of(size: u32) -> u32 {
    size.div_ceil(PACKET_SIZE)
}

/// Reads TP.CM, or ETP.CM if `is_extended`: the message and its parameter group.
///
/// # Errors
/// If there are fewer than eight bytes.
pub fn parse_management(
    data: &[u8],
    is_extended: bool,
) -> Result<(ConnectionManagement, Pgn), MalformedPayload> {
    let layer = if is_extended { "etp.cm" } else { "tp.cm" };
    parse_message(layer, data, field_group((|data| parse_command(data, is_extended), Pgn::parse_field)))
}

/// Bytes 0..5, all but the parameter group.
fn parse_command(data: &[u8], is_extended: bool) -> Parsed<'_, ConnectionManagement> {
    let (rest, control) = byte(data)?;
    match (control, is_extended) {
        (16, false) => (le_u16, byte, byte)
            .map(|(size, packets, _)| ConnectionManagement::RequestToSend {
                size: size.into(),
                packets: packets.into(),
            })
            .parse(rest),
        (17, false) => (byte, byte, take(2_usize))
            .map(|(count, next, _)| ConnectionManagement::ClearToSend { count, next: next.into() })
            .parse(rest),
        (19, false) => (le_u16, take(2_usize))
            .map(|(size, _)| ConnectionManagement::EndOfMessage { size: size.into() })
            .parse(rest),
        (32, false) => (le_u16, byte, byte)
            .map(|(size, packets, _)| ConnectionManagement::Announce {
                size: size.into(),
                packets: packets.into(),
            })
            .parse(rest),
        (20, true) => le_u32
            .map(|size| ConnectionManagement::RequestToSend { size, packets: packets_of(size) })
            .parse(rest),
        (21, true) => {
            (byte, le_u24).map(|(count, next)| ConnectionManagement::ClearToSend { count, next }).parse(rest)
        }
        (22, true) => (byte, le_u24)
            .map(|(count, offset)| ConnectionManagement::PacketOffset { count, offset })
            .parse(rest),
        (23, true) => le_u32.map(|size| ConnectionManagement::EndOfMessage { size }).parse(rest),
        (255, _) => {
            (byte, take(3_usize)).map(|(reason, _)| ConnectionManagement::Abort { reason }).parse(rest)
        }
        _ => take(4_usize).map(|_| ConnectionManagement::Unknown).parse(rest),
    }
}

/// Reads TP.DT or ETP.DT: sequence number and seven bytes.
///
/// # Errors
/// If there are fewer than eight bytes.
#[inline]
pub fn parse_packet(data: &[u8], is_extended: bool) -> Result<(u8, [u8; 7]), MalformedPayload> {
    parse_message(if is_extended { "etp.dt" } else { "tp.dt" }, data, field_group((byte, byte_array)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// DM2 (FECB), least significant byte first.
    const PGN: [u8; 3] = [0xCB, 0xFE, 0x00];

    fn read(head: [u8; 5], is_extended: bool) -> ConnectionManagement {
        let (message, pgn) = parse_management(&[&head[..], &PGN].concat(), is_extended).unwrap();
        assert_eq!(pgn, Pgn::DM2);
        message
    }

    #[test]
    fn connection_management() {
        // 20 bytes (0x0014) need 3 packets; 0x06F9 = 1785 bytes need 255.
        assert_eq!(
            read([16, 0x14, 0, 3, 255], false),
            ConnectionManagement::RequestToSend { size: 20, packets: 3 }
        );
        assert_eq!(
            read([16, 0xF9, 6, 255, 1], false),
            ConnectionManagement::RequestToSend { size: 1785, packets: 255 }
        );
        assert_eq!(
            read([17, 2, 9, 255, 255], false),
            ConnectionManagement::ClearToSend { count: 2, next: 9 }
        );
        assert_eq!(read([19, 0x14, 0, 3, 255], false), ConnectionManagement::EndOfMessage { size: 20 });
        assert_eq!(
            read([32, 0x14, 0, 3, 255], false),
            ConnectionManagement::Announce { size: 20, packets: 3 }
        );
        assert_eq!(read([255, 3, 255, 255, 255], false), ConnectionManagement::Abort { reason: 3 });
        for control in [0, 18, 20, 21, 22, 23, 254] {
            assert_eq!(read([control, 1, 1, 1, 1], false), ConnectionManagement::Unknown, "{control}");
        }
    }

    #[test]
    fn extended_connection_management() {
        // 117,440,505 = 0x06FF_FFF9 bytes need 16,777,215 packets.
        let largest = ConnectionManagement::RequestToSend { size: ETP_SIZES.1, packets: 0xFF_FFFF };
        assert_eq!(read([20, 0xF9, 0xFF, 0xFF, 0x06], true), largest);
        assert_eq!(
            read([21, 16, 0x01, 0x02, 0x03], true),
            ConnectionManagement::ClearToSend { count: 16, next: 0x03_0201 }
        );
        assert_eq!(
            read([22, 16, 0x00, 0x02, 0x03], true),
            ConnectionManagement::PacketOffset { count: 16, offset: 0x03_0200 }
        );
        assert_eq!(read([23, 0xFA, 6, 0, 0], true), ConnectionManagement::EndOfMessage { size: ETP_SIZES.0 });
        assert_eq!(read([255, 250, 255, 255, 255], true), ConnectionManagement::Abort { reason: 250 });
        for control in [16, 17, 19, 24, 32] {
            assert_eq!(read([control, 1, 1, 1, 1], true), ConnectionManagement::Unknown, "{control}");
        }
        assert_eq!(ConnectionManagement::PacketOffset { count: 1, offset: 0 }.name(true), "ETP.CM_DPO");
    }

    #[test]
    fn packets() {
        assert_eq!(parse_packet(&[3, 1, 2, 3, 4, 5, 6, 7], false), Ok((3, [1, 2, 3, 4, 5, 6, 7])));
        let short = MalformedPayload { layer: "etp.dt", offset: 0, needed: 8, available: 7 };
        assert_eq!(parse_packet(&[3, 1, 2, 3, 4, 5, 6], true), Err(short));
        let short = MalformedPayload { layer: "tp.cm", offset: 0, needed: 8, available: 0 };
        assert_eq!(parse_management(&[], false), Err(short));
        assert_eq!([0, 7, 8, 1785].map(packets_of), [0, 1, 2, 255]);
    }
}
