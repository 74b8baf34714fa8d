//! pcap: the classic capture format of tcpdump, Wireshark and python-can.
//!
//! ```text
//! header, 24 bytes                              packet, 16 bytes and its data
//!  0 magic (4): byte order and resolution        0 seconds since 1970 (4)
//!  4 version (2 + 2)  8 time zone (4)            4 fraction (4): microseconds or nanoseconds
//! 12 accuracy (4)    16 longest packet (4)       8 bytes captured (4)
//! 20 link type (4): upper half about checksums  12 bytes on the wire (4)
//! ```
//! Magic 0xA1B2C3D4 means microseconds, 0xA1B23C4D nanoseconds, each in both byte orders.
//!
//! `pcap-file` reads the header. Packets are parsed here, so that invalid fields do not reject a packet
//! (a longest packet of 0, a fraction of a second or more, fewer bytes on the wire than captured).

use pcap_file::pcap::{PcapHeader, PcapParseError, PcapTsResolution};

use crate::capture::byte_order::ByteOrder;
use crate::capture::link::{CaptureInterface, LinkType, PacketHeader, PacketOutput, parse_common};
use crate::capture::{
    Batch, BusNames, CaptureError, CaptureFormat, CapturePlace, FormatParser, LARGEST_RECORD, Notice,
};
use crate::frame::{FrameFlags, Timestamp};

const TITLE: &str = "pcap";
const HEADER: usize = 24;
const PACKET_HEADER: usize = 16;
/// Number of packet bytes read by the fast path.
const COMMON: usize = 16;
/// Maximum size of a packet in bytes.
const LARGEST_PACKET: usize = LARGEST_RECORD - PACKET_HEADER;

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "pcap",
    title: TITLE,
    is_text: false,
    is_packed: false,
    detect: |head| {
        matches!(
            head.first_chunk().map(|magic| u32::from_be_bytes(*magic)),
            Some(0xA1B2_C3D4 | 0xD4C3_B2A1 | 0xA1B2_3C4D | 0x4D3C_B2A1)
        )
    },
    parser: |_| Box::new(PcapParser::default()),
};

/// Properties from the file header.
#[derive(Debug, Clone, Copy)]
struct PcapProperties {
    order: ByteOrder,
    /// 1 or 1,000.
    nanoseconds_per_tick: u16,
}

/// Parser of pcap.
#[derive(Clone, Default)]
struct PcapParser {
    header: Option<(PcapProperties, CaptureInterface)>,
    /// Bytes used so far.
    offset: u64,
    /// Bytes left to skip.
    skip: u64,
    frames: u64,
    buses: BusNames,
    has_ended: bool,
}

impl PcapProperties {
    #[inline]
    fn to_time(self, seconds: u32, fraction: u32) -> Timestamp {
        let fraction = u64::from(fraction) * u64::from(self.nanoseconds_per_tick);
        // Less than 2^62 + 2^48.
        Timestamp((u64::from(seconds) * 1_000_000_000 + fraction).cast_signed())
    }
}

impl PcapParser {
    /// Parses consecutive common packets; returns the number of bytes used.
    #[inline]
    fn parse_run<const BIG: bool>(&mut self, input: &[u8], batch: &mut Batch) -> usize {
        let Some((header, channel)) = &self.header else { return 0 };
        let Some((bus, order)) = channel.fast_path() else { return 0 };
        let number =
            |bytes: &[u8; 4]| if BIG { u32::from_be_bytes(*bytes) } else { u32::from_le_bytes(*bytes) };
        let mut rest = input;
        let mut last = self.frames;
        for slot in batch.free_slots() {
            let Some(window) = rest.first_chunk::<{ PACKET_HEADER + COMMON }>() else { break };
            let ([seconds, fraction, captured, _, ..], []) = window.as_chunks::<4>() else { break };
            let captured = number(captured);
            let Some(packet) = window.last_chunk() else { break };
            if !parse_common(packet, captured, order, slot) {
                break;
            }
            // Up to eight data bytes: not more than the window.
            rest = rest.get(PACKET_HEADER + captured as usize..).unwrap_or_default();
            last += 1;
            slot.number = last;
            slot.time = Some(header.to_time(number(seconds), number(fraction)));
            slot.bus = bus;
        }
        batch.commit_all(last.saturating_sub(self.frames));
        self.frames = last;
        input.len().saturating_sub(rest.len())
    }

    /// Parses the file header; returns the number of bytes used.
    fn parse_header(&mut self, input: &[u8], at_end: bool) -> Result<usize, CaptureError> {
        match PcapHeader::from_slice(input) {
            Ok((_, header)) => {
                let order = if header.endianness.is_big() { ByteOrder::Big } else { ByteOrder::Little };
                let is_nano = header.ts_resolution == PcapTsResolution::NanoSecond;
                let header_of_packets =
                    PcapProperties { order, nanoseconds_per_tick: if is_nano { 1 } else { 1_000 } };
                let channel = CaptureInterface::new(LinkType::new(header.datalink.into()), order, None, 0);
                self.header = Some((header_of_packets, channel));
                Ok(HEADER)
            }
            Err(PcapParseError::IncompleteBuffer(..)) if !at_end => Ok(0),
            Err(error) => Err(CaptureError::Header {
                format: TITLE,
                offset: self.offset,
                found: format!("{} bytes ({error})", input.len().min(HEADER)),
                expected: "a header of 24 bytes",
            }),
        }
    }

    /// Parses one packet of any type; returns the number of bytes used.
    fn parse_packet(&mut self, offset: u64, rest: &[u8], at_end: bool, batch: &mut Batch) -> usize {
        let Some((header, channel)) = &mut self.header else { return 0 };
        let place = CapturePlace::Offset(offset);
        let order = header.order;
        let numbers = (order.u32(rest, 0), order.u32(rest, 4), order.u32(rest, 8), order.u32(rest, 12));
        let (Some(seconds), Some(fraction), Some(captured), Some(_)) = numbers else {
            return cut_off(rest, PACKET_HEADER as u64, place, at_end, batch);
        };
        let whole = u64::from(captured).saturating_add(PACKET_HEADER as u64);
        let length = usize::try_from(captured).unwrap_or(usize::MAX);
        if length > LARGEST_PACKET {
            if channel.may_hold_can() {
                let reason = format!("packet of {captured} bytes: too long for a CAN frame");
                batch.add_notice(Notice::Unreadable { place, reason });
            } else {
                channel.count_skipped();
            }
            self.skip = u64::from(captured);
            return PACKET_HEADER;
        }
        let Some(packet) = rest.get(PACKET_HEADER..).and_then(|data| data.get(..length)) else {
            return cut_off(rest, whole, place, at_end, batch);
        };
        let head = PacketHeader {
            time: Some(header.to_time(seconds, fraction)),
            flags: FrameFlags::default(),
            place,
        };
        let mut out = PacketOutput { batch, frames: &mut self.frames, buses: &mut self.buses };
        channel.on_packet(packet, head, &mut out);
        PACKET_HEADER.saturating_add(length)
    }

    fn end_capture(&mut self, batch: &mut Batch) {
        if std::mem::replace(&mut self.has_ended, true) {
            return;
        }
        if self.skip > 0 {
            let reason = format!("the capture ends inside a packet: {} bytes are missing", self.skip);
            batch.add_notice(Notice::CutOff { place: CapturePlace::Offset(self.offset), reason });
        }
        if let Some(notice) = self.header.as_ref().and_then(|(_, channel)| channel.skipped_notice()) {
            batch.add_notice(notice);
        }
    }
}

/// Reports a packet cut off at the end of the capture and returns its size; otherwise returns 0 to request
/// more input.
fn cut_off(rest: &[u8], whole: u64, place: CapturePlace, at_end: bool, batch: &mut Batch) -> usize {
    if !at_end || rest.is_empty() {
        return 0;
    }
    let reason = format!("the capture ends inside a packet: found {} of {whole} bytes", rest.len());
    batch.add_notice(Notice::CutOff { place, reason });
    rest.len()
}

impl FormatParser for PcapParser {
    fn parse(&mut self, input: &[u8], at_end: bool, batch: &mut Batch) -> Result<usize, CaptureError> {
        let mut taken = usize::try_from(self.skip).unwrap_or(usize::MAX).min(input.len());
        self.skip -= taken as u64;
        let start = self.offset;
        if self.header.is_none() {
            taken = self.parse_header(input, at_end)?;
        }
        while self.skip == 0 && !batch.is_full() {
            let rest = input.get(taken..).unwrap_or_default();
            let is_big = self.header.as_ref().is_some_and(|(header, _)| header.order == ByteOrder::Big);
            let common = if is_big {
                self.parse_run::<true>(rest, batch)
            } else {
                self.parse_run::<false>(rest, batch)
            };
            taken += common;
            if batch.is_full() {
                break;
            }
            let rest = rest.get(common..).unwrap_or_default();
            match self.parse_packet(start.saturating_add(taken as u64), rest, at_end, batch) {
                0 => break,
                length => taken += length,
            }
        }
        self.offset = self.offset.saturating_add(taken as u64);
        if at_end && taken == input.len() && !batch.is_full() {
            self.end_capture(batch);
        }
        Ok(taken)
    }

    fn buses(&self) -> &BusNames {
        &self.buses
    }

    fn clone_box(&self) -> Box<dyn FormatParser> {
        Box::new(self.clone())
    }
}

#[cfg(test)]
mod tests;
