//! Text that Wireshark and tshark export: packet details (`tshark -V`), packet bytes (`tshark -x`), or both.
//!
//! ```text
//! Frame 1: 16 bytes on wire (128 bits), 16 bytes captured (128 bits) on interface can0, id 0
//!         Interface name: can0
//!     Epoch Time: 1649163686.073498000 seconds            Epoch Arrival Time in later versions
//! Controller Area Network, ID: 1793 (0x701), Length: 1
//!     0... .... .... .... .... .... .... .... = Extended Flag: False
//! Data (1 byte)
//!     Data: 05
//!
//! 0000  00 00 07 01 01 00 00 00 05                        .........
//! ```
//!
//! The bytes are in the layout of SocketCAN with a big-endian identifier (link type 227), or follow a cooked header. Details without the bytes, of a
//! protocol that Wireshark decodes, lack the data: such packets are counted.

use crate::capture::link::frame_of_packet;
use crate::capture::text::columns::{ColumnWords, NumberBase, parse_time};
use crate::capture::text::evidence::{LineClass, is_proven};
use crate::capture::text::line_format::{
    CaptureAssumptions, LineFault, LineFormat, LineParser, ONLY_BUS, ParsedLine, first_lines,
};
use crate::capture::text::lines::SkippedLines;
use crate::capture::{Batch, CaptureFormat};
use crate::frame::Frame;

/// Number of lines at the start within which a packet must occur.
const DETECTING_LINES: usize = 200;

/// Unit of time in nanoseconds.
const SECOND: i64 = 1_000_000_000;

/// Largest packet: header and 64 bytes.
const LARGEST_PACKET: usize = 72;

const WITHOUT_BYTES: &str = "of packets without their bytes (tshark -x prints them)";
const CUT: &str = "of packets without all their bytes";
const WITHOUT_TIMES: &str = "packet bytes without details: frames have no times (tshark -V -x prints them)";

pub(super) const FORMAT: CaptureFormat = CaptureFormat {
    name: "tshark",
    title: TsharkText::TITLE,
    is_text: true,
    is_packed: false,
    detect: |head| has_details(head) || has_packets(head),
    parser: |_| Box::new(LineParser::new(TsharkText::default())),
};

/// Whether the details of a CAN packet occur, after the line of a frame.
fn has_details(head: &[u8]) -> bool {
    let is_network = |line: &[u8]| line.starts_with(NETWORK);
    let mut lines = first_lines(head, DETECTING_LINES);
    // Most captures of other programs have no such line, which is cheaper to find.
    first_lines(head, DETECTING_LINES).any(is_network) && lines.any(is_packet_start) && lines.any(is_network)
}

/// Whether the first lines are the bytes of a CAN packet.
fn has_packets(head: &[u8]) -> bool {
    let mut text = TsharkText::default();
    is_proven(head, |line| match text.take_bytes(line) {
        _ if text.has_cut_packet => LineClass::Misfit,
        Ok(Some(frame)) if text.is_exact(&frame) => LineClass::Proof,
        Ok(None) => LineClass::Related,
        Ok(Some(_)) | Err(_) => LineClass::Misfit,
    })
}

/// Start of the line with the details of CAN.
const NETWORK: &[u8] = b"Controller Area Network";

/// `Frame 1: 16 bytes on wire`, or `Frame 1: Packet, 16 bytes on wire` in later versions.
fn is_packet_start(line: &[u8]) -> bool {
    let mut words = ColumnWords::new(line);
    let number = words.next().filter(|word| *word == b"Frame").and_then(|_| words.next());
    let is_number = number
        .and_then(|word| word.strip_suffix(b":"))
        .is_some_and(|digits| !digits.is_empty() && digits.iter().all(u8::is_ascii_digit));
    is_number && memchr::memmem::find(line, b"bytes on wire").is_some()
}

/// Offset and bytes of a line of packet bytes: four digits, two spaces, pairs of digits; characters follow after three.
fn split_dump(line: &[u8]) -> Option<(u32, &[u8])> {
    let (digits, rest) = line.split_at_checked(4)?;
    let bytes = rest.strip_prefix(b"  ")?;
    let end = memchr::memmem::find(bytes, b"   ").unwrap_or(bytes.len());
    Some((NumberBase::Hex.parse_number(digits)?, bytes.get(..end)?))
}

/// State of the current packet.
#[derive(Clone, Default)]
struct TsharkText {
    time: Option<i64>,
    bus: Vec<u8>,
    /// Identifier with the flags of SocketCAN, from the details.
    identifier: Option<u32>,
    bytes: Vec<u8>,
    /// Size of the link layer header before the frame.
    header: usize,
    is_emitted: bool,
    /// Whether a packet ended without all its bytes.
    has_cut_packet: bool,
    /// Whether details of a packet occurred.
    has_details: bool,
    /// Line of the current packet, if its details are of CAN.
    open_line: Option<u64>,
    line: u64,
    skipped: SkippedLines,
}

/// Flags of SocketCAN in an identifier.
const EXTENDED: u32 = 0x8000_0000;
const REMOTE: u32 = 0x4000_0000;
const ERROR: u32 = 0x2000_0000;

/// Details that set a flag.
const FLAGS: &[(&[u8], u32)] = &[
    (b"Extended Flag: True", EXTENDED),
    (b"Remote Transmission Request Flag: True", REMOTE),
    (b"Error Message Flag: True", ERROR),
];

impl TsharkText {
    fn begin_packet(&mut self) {
        self.close_packet();
        self.time = None;
        self.identifier = None;
        self.bytes.clear();
        self.header = 0;
        self.is_emitted = false;
        self.has_details = true;
    }

    /// Counts a packet of CAN whose data did not occur.
    fn close_packet(&mut self) {
        if let Some(line) = self.open_line.take().filter(|_| !self.is_emitted) {
            self.skipped.add_line(WITHOUT_BYTES, line);
        }
    }

    /// Adds a line of packet bytes; the frame if this completes it.
    fn take_bytes(&mut self, line: &[u8]) -> Result<Option<Frame>, &'static str> {
        const BYTES: &str = "packet bytes: expected the bytes of a CAN packet";
        let (offset, pairs) = split_dump(line).ok_or(BYTES)?;
        if offset == 0 {
            let is_cut = !self.has_details && !self.is_emitted && !self.bytes.is_empty();
            self.is_emitted &= self.has_details;
            self.bytes.clear();
            if is_cut {
                self.has_cut_packet = true;
                self.skipped.add_line(CUT, self.line.saturating_sub(1));
            }
        }
        if self.is_emitted {
            return Ok(None);
        }
        if usize::try_from(offset) != Ok(self.bytes.len()) {
            return Err(BYTES);
        }
        for word in ColumnWords::new(pairs) {
            let Some(byte) = NumberBase::Hex.parse_byte(word).filter(|_| word.len() == 2) else {
                self.bytes.clear();
                return Err(BYTES);
            };
            self.bytes.push(byte);
        }
        let Some(mut packet) = self.packet_bytes() else {
            return if self.bytes.len() < self.header + 8 && self.header > 0 { Ok(None) } else { Err(BYTES) };
        };
        let [.., length, _, 0, _] = *packet.first_chunk::<8>().ok_or(BYTES)? else { return Err(BYTES) };
        let whole = 8 + usize::from(length);
        if whole > LARGEST_PACKET || packet.len() > whole.max(16) {
            return Err(BYTES);
        }
        // A remote frame has no data.
        let is_remote = packet.first().is_some_and(|byte| byte & 0xE0 == 0x40 || byte & 0xE0 == 0xC0);
        if packet.len() < whole && !is_remote {
            return Ok(None);
        }
        packet.resize(whole.max(packet.len()), 0);
        self.is_emitted = true;
        frame_of_packet(&packet).map(Some).map_err(|_| BYTES)
    }

    /// The frame of the packet, with a big-endian identifier. After a cooked header its order is that of the host, so that
    /// of the details is used.
    fn packet_bytes(&self) -> Option<Vec<u8>> {
        let mut packet = self.bytes.get(self.header..).filter(|packet| packet.len() >= 8)?.to_vec();
        if self.header > 0 {
            packet.get_mut(..4)?.copy_from_slice(&self.identifier?.to_be_bytes());
        }
        Some(packet)
    }

    /// Whether the packet has no bytes but those of its frame, or the padding of the kernel.
    fn is_exact(&self, frame: &Frame) -> bool {
        let padding = self.bytes.get(8 + frame.data().len()..).unwrap_or_default();
        padding.iter().all(|byte| *byte == 0) && self.bytes.get(5).is_some_and(|flags| *flags <= 7)
    }

    /// Takes a line of details; the frame if this completes it.
    fn take_detail(&mut self, line: &[u8]) -> Option<Frame> {
        if line.starts_with(NETWORK) {
            // The line of a frame that cannot be read precedes it.
            if self.open_line.is_some() {
                self.begin_packet();
            }
            self.identifier = memchr::memmem::find(line, b"(0x").and_then(|at| {
                let digits = line.get(at + 3..)?.split(|byte| *byte == b')').next()?;
                NumberBase::Hex.parse_number(digits)
            });
            self.open_line = Some(self.line);
            return None;
        }
        if let Some(version) = line.strip_prefix(b"Linux cooked capture") {
            self.header = if version.starts_with(b" v2") { 20 } else { 16 };
        }
        if let Some(name) = line.strip_prefix(b"Interface name: ") {
            self.bus = name.to_vec();
        }
        let epoch = line.strip_prefix(b"Epoch Time: ").or(line.strip_prefix(b"Epoch Arrival Time: "));
        if let Some(time) = epoch.and_then(|text| parse_time(ColumnWords::new(text).next()?, SECOND)) {
            self.time = Some(time);
        }
        if let Some((_, flag)) = FLAGS.iter().find(|(text, _)| line.ends_with(text)) {
            self.identifier = self.identifier.map(|identifier| identifier | flag);
        }
        // A remote frame and an empty one have no data.
        if let Some(digits) = line.strip_prefix(b"Frame-Length: ") {
            let length = NumberBase::Decimal.parse_byte(digits)?;
            let is_remote = self.identifier.is_some_and(|identifier| identifier & REMOTE != 0);
            return if is_remote || length == 0 { self.frame_of_details(length, &[]) } else { None };
        }
        let digits = line.strip_prefix(b"Data: ")?;
        let pairs = digits.chunks(2).map(|pair| NumberBase::Hex.parse_byte(pair).filter(|_| pair.len() == 2));
        let data: Vec<u8> = pairs.collect::<Option<_>>()?;
        self.frame_of_details(u8::try_from(data.len()).ok()?, &data)
    }

    fn frame_of_details(&mut self, length: u8, data: &[u8]) -> Option<Frame> {
        let identifier = self.identifier.filter(|_| !self.is_emitted)?;
        let packet = [&identifier.to_be_bytes()[..], &[length, 0, 0, 0], data].concat();
        let frame = frame_of_packet(&packet).ok()?;
        self.is_emitted = true;
        Some(frame)
    }
}

impl LineFormat for TsharkText {
    const TITLE: &'static str = "text of Wireshark";

    fn parse_line<'a>(
        &'a mut self,
        text: &'a [u8],
        assumptions: &mut CaptureAssumptions,
    ) -> Result<Option<ParsedLine<'a>>, LineFault> {
        let line = text.trim_ascii();
        if is_packet_start(line) {
            self.begin_packet();
            return Ok(None);
        }
        // Details are indented, packet bytes are not.
        let frame = match split_dump(text) {
            Some(_) if !self.has_details || self.open_line.is_some() => self.take_bytes(line)?,
            _ => self.take_detail(line),
        };
        let Some(frame) = frame else { return Ok(None) };
        if !self.has_details {
            assumptions.add_assumption(WITHOUT_TIMES);
        }
        let bus = if self.bus.is_empty() { ONLY_BUS } else { &self.bus };
        Ok(Some(ParsedLine::new(self.time, bus, frame)))
    }

    fn at_line(&mut self, number: u64) {
        self.line = number;
    }

    fn report_skipped(&mut self, batch: &mut Batch) {
        self.close_packet();
        self.skipped.report_lines(batch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::testing::{read_capture, read_in_pieces};

    fn details(number: u32, second: u32, network: &str, rest: &str) -> String {
        format!(
            "Frame {number}: 16 bytes on wire (128 bits), 16 bytes captured (128 bits) on interface can0, id 0\n    \
             Interface id: 0 (can0)\n        Interface name: can0\n    Epoch Time: {second}.000001000 seconds\n    \
             Frame Length: 16 bytes (128 bits)\n{network}\n{rest}\n"
        )
    }

    const HEARTBEAT: &str = "Controller Area Network, ID: 1793 (0x701), Length: 1";
    const EXTENDED_ID: &str = "Controller Area Network, ID: 418317056 (0x18ef0300), Length: 2\n    \
        1... .... .... .... .... .... .... .... = Extended Flag: True";

    #[test]
    fn details_with_and_without_bytes() {
        let text = [
            details(1, 5, HEARTBEAT, "    Frame-Length: 1\nData (1 byte)\n    Data: 05\n    [Length: 1]\n"),
            details(2, 6, EXTENDED_ID, "Data (2 bytes)\n    Data: ab02\n\n0000  98 ef 03 00 02 00 00 00 ab 02   ..........\n"),
            details(3, 7, HEARTBEAT, "CANopen\n    State: Operational\n\n0000  00 00 07 01 01 00 00 00 05                        .........\n"),
            details(4, 8, HEARTBEAT, "CANopen\n    State: Operational\n"),
            details(5, 9, "Controller Area Network, ID: 1793 (0x701), Length: 0", "    Frame-Length: 0\n"),
        ]
        .concat();
        let whole = read_capture(text.as_bytes());
        assert_eq!(whole, read_in_pieces(text.as_bytes(), &[11, 80, 1]));
        assert_eq!(
            whole.items,
            [
                "{1} (5.000001000) bus0 701#05 flags=00 dlc=0",
                "{2} (6.000001000) bus0 18EF0300#AB02 flags=00 dlc=0",
                "{3} (7.000001000) bus0 701#05 flags=00 dlc=0",
                "{4} (9.000001000) bus0 701# flags=00 dlc=0",
                "1 line of packets without their bytes (tshark -x prints them) skipped (first: line 40)",
            ]
        );
        assert_eq!(whole.buses, ["can0"]);
    }

    #[test]
    fn bytes_alone() {
        let fd: Vec<String> = (0..20_u8).map(|byte| format!("{byte:02x}")).collect();
        let text = format!(
            "0000  00 00 07 01 01 00 00 00 05                        .........\n\n\
             0000  98 ef 03 00 14 04 00 00 {}   ................\n0010  {}   ............\n",
            fd[..8].join(" "),
            fd[8..].join(" ")
        );
        assert_eq!(
            read_capture(text.as_bytes()).items,
            [
                WITHOUT_TIMES,
                "{1} bus0 701#05 flags=00 dlc=0",
                "{2} bus0 18EF0300#000102030405060708090A0B0C0D0E0F10111213 flags=04 dlc=0",
            ]
        );
    }

    #[test]
    fn other_dumps_are_not_packets() {
        for other in [
            "",
            "0000  45 00 00 54 00 00 40 00 40 01 00 00 7f 00 00 01   E..T..@.@.......\n",
            "0000  00 00 07 01 03 00 00 00 05   .........\n0000  00 00 07 01 01 00 00 00 05   .........\n",
            "00000000  00 00 07 01 01 00 00 00  05\n",
            "Frame 1: a picture\nController Area Network is a bus\n",
            "hello\n",
        ] {
            assert!(!(FORMAT.detect)(other.as_bytes()), "{other}");
        }
    }

    #[test]
    fn a_broken_line_of_bytes_costs_its_packet() {
        let packet = "0000  00 00 07 01 01 00 00 00 05   .........\n";
        let text =
            format!("{}{packet}{}{packet}", packet.repeat(200), "0000  00 00 07 01 01 0x 00 00 05   .\n");
        let content = read_capture(text.as_bytes());
        assert_eq!(content.frames.len(), 202);
        let bad: Vec<_> =
            content.items.iter().filter(|item| item.starts_with("line 202: packet bytes")).collect();
        assert_eq!(bad.len(), 1, "{:?}", content.items.last());
    }
}
