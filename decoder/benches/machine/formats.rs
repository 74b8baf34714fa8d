//! Writers of captures, independent of the readers under test.

use std::io::{self, Write};

use super::Message;

/// Link type `LINKTYPE_CAN_SOCKETCAN`.
const LINK_TYPE: u16 = 227;

/// Capture format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Output of `candump -l`.
    Candump,
    /// Classic pcap with microseconds, little endian.
    Pcap,
    /// pcapng, one interface with nanoseconds.
    Pcapng,
}

impl Format {
    /// Writes the header of the capture.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn begin(self, out: &mut impl Write) -> io::Result<()> {
        match self {
            Self::Candump => Ok(()),
            Self::Pcap => {
                out.write_all(&0xA1B2_C3D4_u32.to_le_bytes())?;
                out.write_all(&[2, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0])?;
                out.write_all(&65_535_u32.to_le_bytes())?;
                out.write_all(&u32::from(LINK_TYPE).to_le_bytes())
            }
            Self::Pcapng => {
                let section = [0x4D, 0x3C, 0x2B, 0x1A, 1, 0, 0, 0, 255, 255, 255, 255, 255, 255, 255, 255];
                block(out, 0x0A0D_0D0A, &section)?;
                let [low, high] = LINK_TYPE.to_le_bytes();
                let mut interface = vec![low, high, 0, 0, 0, 0, 4, 0];
                interface.extend_from_slice(&[2, 0, 4, 0]);
                interface.extend_from_slice(b"can0");
                interface.extend_from_slice(&[9, 0, 1, 0, 9, 0, 0, 0]);
                interface.extend_from_slice(&[0, 0, 0, 0]);
                block(out, 1, &interface)
            }
        }
    }

    /// Writes one frame.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn write(self, message: &Message, out: &mut impl Write) -> io::Result<()> {
        let (seconds, nanoseconds) = (message.time / 1_000_000_000, message.time % 1_000_000_000);
        let micros = nanoseconds / 1_000;
        match self {
            Self::Candump => {
                let digits = if message.extended { 8 } else { 3 };
                write!(out, "({seconds}.{micros:06}) can0 {:0digits$X}#", message.id)?;
                if message.remote {
                    return writeln!(out, "R{}", message.length);
                }
                for byte in message.payload() {
                    write!(out, "{byte:02X}")?;
                }
                out.write_all(b"\n")
            }
            Self::Pcap => {
                let part = |value: u64| u32::try_from(value).unwrap_or(0).to_le_bytes();
                let size = 16_u32.to_le_bytes();
                out.write_all(&[part(seconds), part(micros), size, size].concat())?;
                out.write_all(&can_frame(message))
            }
            Self::Pcapng => {
                let half = |value: u64| u32::try_from(value & 0xFFFF_FFFF).unwrap_or(0).to_le_bytes();
                let size = 16_u32.to_le_bytes();
                let head = [[0; 4], half(message.time >> 32), half(message.time), size, size];
                let mut body = head.concat();
                body.extend_from_slice(&can_frame(message));
                block(out, 6, &body)
            }
        }
    }
}

/// `struct can_frame` with the identifier in network byte order, as in packet sockets.
fn can_frame(message: &Message) -> [u8; 16] {
    let id = message.id | u32::from(message.remote) << 30 | u32::from(message.extended) << 31;
    let mut frame = [0; 16];
    let head = id.to_be_bytes().into_iter().chain([message.length, 0, 0, 0]).chain(message.data);
    for (target, byte) in frame.iter_mut().zip(head) {
        *target = byte;
    }
    frame
}

fn block(out: &mut impl Write, kind: u32, body: &[u8]) -> io::Result<()> {
    let length = u32::try_from(body.len() + 12).unwrap_or(0).to_le_bytes();
    out.write_all(&[kind.to_le_bytes(), length].concat())?;
    out.write_all(body)?;
    out.write_all(&length)
}
