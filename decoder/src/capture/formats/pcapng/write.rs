//! Writer of pcapng: one named interface per bus, timestamps in nanoseconds, packets in the layout of
//! SocketCAN.
//!
//! ```text
//! section header │ interface description (first frame of a bus) │ enhanced packet │ enhanced packet │ …
//!
//! packet, link type 227:  0 identifier and flags (big-endian)  4 length  5 FD flags  6 0  7 raw DLC  8 data
//! ```
//! Section 4 of draft-ietf-opsawg-pcapng; link type CAN_SOCKETCAN of tcpdump.org.

use std::io::{self, Write};

use bytemuck::must_cast;

use super::block::COMMENT;
use crate::ascii::push_part;
use crate::capture::Notice;
use crate::capture::remark::CommentRemark;
use crate::capture::text::print::cut_text;
use crate::capture::writer::FrameWriter;
use crate::frame::{CanId, Frame, FrameFlags, Timestamp};

const SECTION_HEADER: u32 = 0x0A0D_0D0A;
const INTERFACE: u32 = 1;
const PACKET: u32 = 6;
const STATISTICS: u32 = 5;
const BYTE_ORDER: u32 = 0x1A2B_3C4D;
const CAN_SOCKETCAN: u16 = 227;

/// Option codes: name of an interface, resolution of its timestamps (10^-n), flags of a packet, packets lost
/// by the system since the interface was opened, end of the options.
const NAME: u16 = 2;
const RESOLUTION: u16 = 9;
const PACKET_FLAGS: u16 = 2;
const LOST: u16 = 7;
const END: u16 = 0;

/// Maximum size of an option value in bytes.
const LONGEST_OPTION: usize = 65_535;

/// Size of the packet header before the data, and of the block header before the packet, in bytes.
const PACKET_HEADER: usize = 8;
const BLOCK_HEADER: usize = 28;

/// Maximum data size of a classic frame in bytes.
const CLASSIC: usize = 8;

/// Packet flags: to this host, from this host.
const INBOUND: u32 = 1;
const OUTBOUND: u32 = 2;

/// Flags of an identifier (SocketCAN): 29 bits, remote frame, error frame.
const EXTENDED_FLAG: u32 = 0x8000_0000;
const REMOTE_FLAG: u32 = 0x4000_0000;
const ERROR_FLAG: u32 = 0x2000_0000;

/// FD flags: bit rate switched, transmitter error passive, FD frame.
const SWITCHED: u8 = 1;
const PASSIVE: u8 = 2;
const FD: u8 = 4;

/// Writer of pcapng. Packets always have a time: a frame without time gets that of the packet before. Times
/// before 1970 are written as 0 because timestamps have no sign.
pub(super) struct PcapngWriter<W> {
    output: W,
    /// Comment of the section; empty for none.
    comment: &'static str,
    /// The current block.
    block: Vec<u8>,
    /// Name of each interface, and number of frames lost on it.
    buses: Vec<(String, u64)>,
    /// Interface of the last frame.
    last: usize,
    time: Timestamp,
    has_begun: bool,
}

impl<W: Write> PcapngWriter<W> {
    pub(super) fn new(output: W, comment: &'static str) -> Self {
        Self {
            output,
            comment,
            block: Vec::with_capacity(256),
            buses: Vec::new(),
            last: 0,
            time: Timestamp::default(),
            has_begun: false,
        }
    }

    /// Starts a block; `close` sets its length.
    fn open_block(&mut self, kind: u32) {
        self.block.clear();
        self.block.extend_from_slice([kind, 0].map(u32::to_le_bytes).as_flattened());
    }

    fn append_bytes(&mut self, bytes: &[u8]) {
        self.block.extend_from_slice(bytes);
    }

    /// Pads the block to four bytes and writes it.
    fn close_block(&mut self) -> io::Result<()> {
        let length = u32::try_from(self.block.len().saturating_add(4)).unwrap_or(u32::MAX).to_le_bytes();
        if let Some(place) = self.block.get_mut(4..8) {
            place.copy_from_slice(&length);
        }
        self.block.extend_from_slice(&length);
        self.output.write_all(&self.block)
    }

    fn begin_section(&mut self) -> io::Result<()> {
        if self.has_begun {
            return Ok(());
        }
        self.has_begun = true;
        self.open_block(SECTION_HEADER);
        self.append_bytes(&BYTE_ORDER.to_le_bytes());
        self.append_bytes(&[1, 0, 0, 0]);
        // The length of the section is unknown.
        self.append_bytes(&u64::MAX.to_le_bytes());
        if !self.comment.is_empty() {
            append_option(&mut self.block, COMMENT, cut_text(self.comment, LONGEST_OPTION).as_bytes());
            append_option(&mut self.block, END, &[]);
        }
        self.close_block()
    }

    #[inline]
    fn write_interface(&mut self, bus: &str) -> io::Result<u32> {
        if self.buses.get(self.last).is_none_or(|(name, _)| name != bus) {
            self.turn_to(bus)?;
        }
        Ok(u32::try_from(self.last).unwrap_or(u32::MAX))
    }

    /// Selects the interface of a bus; describes it if it is new.
    fn turn_to(&mut self, bus: &str) -> io::Result<()> {
        self.begin_section()?;
        if let Some(known) = self.buses.iter().position(|(name, _)| name == bus) {
            self.last = known;
            return Ok(());
        }
        self.last = self.buses.len();
        self.buses.push((bus.to_owned(), 0));
        self.open_block(INTERFACE);
        self.append_bytes(&CAN_SOCKETCAN.to_le_bytes());
        self.append_bytes(&[0; 6]);
        append_option(&mut self.block, NAME, bus.as_bytes());
        append_option(&mut self.block, RESOLUTION, &[9]);
        append_option(&mut self.block, END, &[]);
        self.close_block()
    }

    /// Writes statistics of an interface: frames lost so far, and an optional remark.
    fn write_statistics(
        &mut self,
        bus: &str,
        time: Timestamp,
        remark: Option<CommentRemark>,
    ) -> io::Result<()> {
        let interface = self.write_interface(bus)?;
        let lost = self.buses.get(self.last).map_or(0, |(_, lost)| *lost);
        let [high, low] = timestamp_halves(time);
        self.open_block(STATISTICS);
        self.append_bytes([interface, high, low].map(u32::to_le_bytes).as_flattened());
        if let Some(remark) = remark {
            append_option(&mut self.block, COMMENT, remark.comment_text().as_bytes());
        }
        if lost > 0 {
            append_option(&mut self.block, LOST, &lost.to_le_bytes());
        }
        append_option(&mut self.block, END, &[]);
        self.close_block()
    }

    fn write_packet(&mut self, frame: &Frame, bus: &str, comment: Option<&str>) -> io::Result<()> {
        let interface = self.write_interface(bus)?;
        self.time = frame.time.unwrap_or(self.time);
        let [high, low] = timestamp_halves(self.time);
        let data = frame.data().len();
        let captured = u32::try_from(data + PACKET_HEADER).unwrap_or(u32::MAX);
        self.block.clear();
        let header = [
            PACKET.to_le(),
            0,
            interface.to_le(),
            high.to_le(),
            low.to_le(),
            captured.to_le(),
            captured.to_le(),
        ];
        self.block.extend_from_slice(&must_cast::<_, [u8; BLOCK_HEADER]>(header));
        self.block.extend_from_slice(&start_of_packet(frame));
        match frame.bytes.first_chunk::<CLASSIC>() {
            Some(bytes) if data <= CLASSIC => push_part(&mut self.block, *bytes, data),
            _ => self.block.extend_from_slice(frame.data()),
        }
        push_part(&mut self.block, [0; 3], data.next_multiple_of(4) - data);
        if let Some(comment) = comment {
            append_option(&mut self.block, COMMENT, cut_text(comment, LONGEST_OPTION).as_bytes());
        }
        let direction = match frame.flags {
            flags if flags.contains(FrameFlags::TRANSMITTED) => Some(OUTBOUND),
            flags if flags.contains(FrameFlags::RECEIVED) => Some(INBOUND),
            _ => None,
        };
        if let Some(direction) = direction {
            append_option(&mut self.block, PACKET_FLAGS, &direction.to_le_bytes());
        }
        if comment.is_some() || direction.is_some() {
            append_option(&mut self.block, END, &[]);
        }
        self.close_block()
    }
}

/// Upper and lower half of a timestamp in nanoseconds.
#[inline]
fn timestamp_halves(time: Timestamp) -> [u32; 2] {
    let [low, high]: [u32; 2] = must_cast(u64::try_from(time.0).unwrap_or(0).to_le());
    [u32::from_le(high), u32::from_le(low)]
}

/// Appends an option, padded to four bytes; a value over the maximum size is cut.
fn append_option(body: &mut Vec<u8>, code: u16, value: &[u8]) {
    let value = value.get(..LONGEST_OPTION).unwrap_or(value);
    body.extend_from_slice(&code.to_le_bytes());
    body.extend_from_slice(&u16::try_from(value.len()).unwrap_or(u16::MAX).to_le_bytes());
    body.extend_from_slice(value);
    push_part(body, [0; 3], value.len().next_multiple_of(4) - value.len());
}

/// Header before the data in SocketCAN's layout.
#[inline]
fn start_of_packet(frame: &Frame) -> [u8; PACKET_HEADER] {
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
    let bit = |flag, bit| if is_fd && flags.contains(flag) { bit } else { 0 };
    let fd = bit(FrameFlags::FD, FD)
        | bit(FrameFlags::BIT_RATE_SWITCH, SWITCHED)
        | bit(FrameFlags::ERROR_STATE, PASSIVE);
    let raw_dlc = if is_fd { 0 } else { frame.raw_dlc };
    let [a, b, c, d] = id.to_be_bytes();
    [a, b, c, d, frame.length, fd, 0, raw_dlc]
}

impl<W: Write + Send> FrameWriter for PcapngWriter<W> {
    fn write(&mut self, frame: &Frame, bus: &str) -> io::Result<()> {
        self.write_packet(frame, bus, None)
    }

    fn write_commented(&mut self, frame: &Frame, bus: &str, comment: &str) -> io::Result<()> {
        self.write_packet(frame, bus, Some(comment))
    }

    fn notice(&mut self, notice: &Notice, bus: &str) -> io::Result<bool> {
        let (time, remark) = match *notice {
            Notice::LostFrames { count: Some(count), .. } => {
                self.write_interface(bus)?;
                if let Some((_, lost)) = self.buses.get_mut(self.last) {
                    *lost = lost.saturating_add(count);
                }
                (self.time, None)
            }
            Notice::Link { time, state, bit_rate, .. } => (time, Some(CommentRemark::Link(state, bit_rate))),
            Notice::Quiet(time) => (time, Some(CommentRemark::Quiet)),
            Notice::ClockSet { time, step, .. } => (time, Some(CommentRemark::ClockSet(step))),
            Notice::LostFrames { count: None, .. } => (self.time, Some(CommentRemark::Lost(None))),
            Notice::Unreadable { .. } | Notice::CutOff { .. } | Notice::Assumption(_) => return Ok(false),
        };
        self.write_statistics(bus, time, remark)?;
        Ok(true)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.begin_section()?;
        self.output.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_packet_byte_by_byte() {
        let mut writer = PcapngWriter::new(Vec::new(), "");
        let frame = Frame {
            time: Some(Timestamp(0x0102_0304_0506_0708)),
            flags: FrameFlags::RECEIVED,
            ..Frame::data_frame(CanId::from_standard(0x181), &[0xAA, 0xBB, 0xCC])
        };
        writer.write(&Frame::EMPTY, "can0").unwrap();
        let before = writer.output.len();
        // Bytes after the data are undefined and must not be written.
        writer.write_commented(&Frame { length: 1, ..frame }, "can0", "hé").unwrap();
        let expected = [
            &[6, 0, 0, 0, 64, 0, 0, 0, 0, 0, 0, 0][..],
            &[4, 3, 2, 1, 8, 7, 6, 5, 9, 0, 0, 0, 9, 0, 0, 0],
            &[0, 0, 1, 0x81, 1, 0, 0, 0, 0xAA, 0, 0, 0],
            &[1, 0, 3, 0, b'h', 0xC3, 0xA9, 0, 2, 0, 4, 0, 1, 0, 0, 0, 0, 0, 0, 0],
            &[64, 0, 0, 0],
        ];
        assert_eq!(writer.output[before..], expected.concat());
    }

    #[test]
    fn the_section_has_the_comment_of_the_capture() {
        let mut writer = PcapngWriter::new(Vec::new(), "hi");
        writer.flush().unwrap();
        let expected = [
            &[0x0A, 0x0D, 0x0D, 0x0A, 40, 0, 0, 0, 0x4D, 0x3C, 0x2B, 0x1A, 1, 0, 0, 0][..],
            &[0xFF; 8],
            &[1, 0, 2, 0, b'h', b'i', 0, 0, 0, 0, 0, 0],
            &[40, 0, 0, 0],
        ];
        assert_eq!(writer.output, expected.concat());
    }

    #[test]
    fn a_comment_is_cut_between_characters() {
        let mut writer = PcapngWriter::new(Vec::new(), "");
        writer.write(&Frame::EMPTY, "can0").unwrap();
        let before = writer.output.len();
        writer.write_commented(&Frame::EMPTY, "can0", &"é".repeat(40_000)).unwrap();
        // 65,535 is odd, so the last two-byte character does not fit.
        assert_eq!(writer.output[before + 36..before + 40], [1, 0, 0xFE, 0xFF]);
        assert_eq!(writer.output.len() - before, 32 + 8 + 4 + 65_536 + 4);
        let read = crate::capture::testing::read_capture(&writer.output);
        assert_eq!(read.frames.len(), 2);
    }

    #[test]
    fn frames_without_time_have_the_time_before() {
        let mut writer = PcapngWriter::new(Vec::new(), "");
        let later = Frame { time: Some(Timestamp(5)), ..Frame::EMPTY };
        for frame in [Frame::EMPTY, later, Frame::EMPTY] {
            writer.write(&frame, "can0").unwrap();
        }
        let read = crate::capture::testing::read_capture(&writer.output);
        let times: Vec<_> = read.frames.iter().filter_map(|frame| frame.time).collect();
        assert_eq!(times, [0, 5, 5].map(Timestamp));
    }
}
