//! Writes pcapng: an interface a bus with its name, stamps of nanoseconds, packets as SocketCAN has them.
//!
//! ```text
//! section header │ interface description (first frame of a bus) │ enhanced packet │ enhanced packet │ …
//!
//! packet, link type 227:  0 identifier and flags (big-endian)  4 length  5 FD flags  6 0  7 raw DLC  8 data
//! ```
//! Section 4 of draft-ietf-opsawg-pcapng; link type by tcpdump.org, CAN_SOCKETCAN.

use std::io::{self, Write};

use super::super::writer::FrameWriter;
use super::COMMENT;
use crate::capture::Notice;
use crate::capture::remark::Remark;
use crate::frame::{CanId, Frame, FrameFlags, Timestamp};

const SECTION_HEADER: u32 = 0x0A0D_0D0A;
const INTERFACE: u32 = 1;
const PACKET: u32 = 6;
const STATISTICS: u32 = 5;
const BYTE_ORDER: u32 = 0x1A2B_3C4D;
const CAN_SOCKETCAN: u16 = 227;

/// Options: comment; name of an interface, resolution of its stamps (10^-n); flags of a packet; packets lost by the
/// system since the interface was opened; end.
const NAME: u16 = 2;
const RESOLUTION: u16 = 9;
const PACKET_FLAGS: u16 = 2;
const LOST: u16 = 7;
const END: u16 = 0;

/// Flags of a packet: to this host, from it.
const INBOUND: u32 = 1;
const OUTBOUND: u32 = 2;

/// Bits of an identifier (SocketCAN): 29 bits, remote frame, error frame.
const EXTENDED_FLAG: u32 = 0x8000_0000;
const REMOTE_FLAG: u32 = 0x4000_0000;
const ERROR_FLAG: u32 = 0x2000_0000;

/// FD flags: bit rate switched, sender error passive, an FD frame.
const SWITCHED: u8 = 1;
const PASSIVE: u8 = 2;
const FD: u8 = 4;

/// Writer of pcapng. It has no packets without time: those of frames without one are stamped 0.
pub(super) struct PcapngWriter<W> {
    output: W,
    /// Name of each interface, and frames lost on it.
    buses: Vec<(String, u64)>,
    time: Timestamp,
    has_begun: bool,
}

impl<W: Write> PcapngWriter<W> {
    pub(super) fn new(output: W) -> Self {
        Self { output, buses: Vec::new(), time: Timestamp::default(), has_begun: false }
    }

    fn block(&mut self, kind: u32, body: &[u8]) -> io::Result<()> {
        let length = u32::try_from(body.len() + 12).unwrap_or(u32::MAX);
        self.output.write_all(&kind.to_le_bytes())?;
        self.output.write_all(&length.to_le_bytes())?;
        self.output.write_all(body)?;
        self.output.write_all(&length.to_le_bytes())
    }

    fn begin(&mut self) -> io::Result<()> {
        if self.has_begun {
            return Ok(());
        }
        self.has_begun = true;
        let mut body = BYTE_ORDER.to_le_bytes().to_vec();
        body.extend_from_slice(&[1, 0, 0, 0]);
        // The length of the section is not known.
        body.extend_from_slice(&u64::MAX.to_le_bytes());
        self.block(SECTION_HEADER, &body)
    }

    fn interface(&mut self, bus: &str) -> io::Result<u32> {
        let known = self.buses.iter().position(|(name, _)| name == bus);
        let index = known.unwrap_or(self.buses.len());
        if known.is_none() {
            self.buses.push((bus.to_owned(), 0));
            let mut body = CAN_SOCKETCAN.to_le_bytes().to_vec();
            body.extend_from_slice(&[0; 6]);
            option(&mut body, NAME, bus.as_bytes());
            option(&mut body, RESOLUTION, &[9]);
            option(&mut body, END, &[]);
            self.block(INTERFACE, &body)?;
        }
        Ok(u32::try_from(index).unwrap_or(u32::MAX))
    }

    /// What is known of an interface at a time: frames lost so far, and a remark.
    fn statistics(&mut self, bus: &str, time: Timestamp, remark: Option<Remark>) -> io::Result<()> {
        self.begin()?;
        let interface = self.interface(bus)?;
        let lost = self.buses.get(interface as usize).map_or(0, |(_, lost)| *lost);
        let mut body = interface.to_le_bytes().to_vec();
        for half in halves(time) {
            body.extend_from_slice(&half.to_le_bytes());
        }
        if let Some(remark) = remark {
            option(&mut body, COMMENT, remark.text().as_bytes());
        }
        if lost > 0 {
            option(&mut body, LOST, &lost.to_le_bytes());
        }
        option(&mut body, END, &[]);
        self.block(STATISTICS, &body)
    }
}

/// A time in nanoseconds as the two halves of a stamp.
fn halves(time: Timestamp) -> [u32; 2] {
    let stamp = u64::try_from(time.0).unwrap_or(0);
    [stamp >> 32, stamp & u64::from(u32::MAX)].map(|half| u32::try_from(half).unwrap_or(u32::MAX))
}

/// Appends an option, padded to four bytes.
fn option(body: &mut Vec<u8>, code: u16, value: &[u8]) {
    body.extend_from_slice(&code.to_le_bytes());
    body.extend_from_slice(&u16::try_from(value.len()).unwrap_or(u16::MAX).to_le_bytes());
    body.extend_from_slice(value);
    pad(body);
}

fn pad(body: &mut Vec<u8>) {
    while !body.len().is_multiple_of(4) {
        body.push(0);
    }
}

/// A frame in SocketCAN's layout.
fn packet(frame: &Frame) -> Vec<u8> {
    let flags = frame.flags;
    let mut id = frame.id.number();
    if flags.contains(FrameFlags::ERROR) {
        id |= ERROR_FLAG;
    } else if matches!(frame.id, CanId::Extended(_)) {
        id |= EXTENDED_FLAG;
    }
    if flags.contains(FrameFlags::REMOTE) {
        id |= REMOTE_FLAG;
    }
    let is_fd = flags.contains(FrameFlags::FD);
    let fd =
        [(FrameFlags::FD, FD), (FrameFlags::BIT_RATE_SWITCH, SWITCHED), (FrameFlags::ERROR_STATE, PASSIVE)];
    let fd = fd.iter().filter(|(flag, _)| is_fd && flags.contains(*flag)).fold(0, |all, (_, bit)| all | bit);
    let raw_dlc = if is_fd { 0 } else { frame.raw_dlc };
    let mut bytes = id.to_be_bytes().to_vec();
    bytes.extend_from_slice(&[frame.length, fd, 0, raw_dlc]);
    bytes.extend_from_slice(frame.data());
    bytes
}

impl<W: Write + Send> FrameWriter for PcapngWriter<W> {
    fn write(&mut self, frame: &Frame, bus: &str) -> io::Result<()> {
        self.begin()?;
        let interface = self.interface(bus)?;
        self.time = frame.time.unwrap_or_default();
        let [high, low] = halves(self.time);
        let packet = packet(frame);
        let length = u32::try_from(packet.len()).unwrap_or(u32::MAX);
        let mut body = Vec::with_capacity(128);
        for number in [interface, high, low, length, length] {
            body.extend_from_slice(&number.to_le_bytes());
        }
        body.extend_from_slice(&packet);
        pad(&mut body);
        let direction = match frame.flags {
            flags if flags.contains(FrameFlags::TRANSMITTED) => Some(OUTBOUND),
            flags if flags.contains(FrameFlags::RECEIVED) => Some(INBOUND),
            _ => None,
        };
        if let Some(direction) = direction {
            option(&mut body, PACKET_FLAGS, &direction.to_le_bytes());
            option(&mut body, END, &[]);
        }
        self.block(PACKET, &body)
    }

    fn notice(&mut self, notice: &Notice, bus: &str) -> io::Result<bool> {
        let (time, remark) = match *notice {
            Notice::LostFrames { count: Some(count), .. } => {
                self.begin()?;
                let interface = self.interface(bus)?;
                if let Some((_, lost)) = self.buses.get_mut(interface as usize) {
                    *lost = lost.saturating_add(count);
                }
                (self.time, None)
            }
            Notice::Link { time, state, bit_rate, .. } => (time, Some(Remark::Link(state, bit_rate))),
            Notice::Quiet(time) => (time, Some(Remark::Quiet)),
            Notice::LostFrames { count: None, .. } => (self.time, Some(Remark::Lost(None))),
            Notice::Unreadable { .. } | Notice::Assumption(_) => return Ok(false),
        };
        self.statistics(bus, time, remark)?;
        Ok(true)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.begin()?;
        self.output.flush()
    }
}
