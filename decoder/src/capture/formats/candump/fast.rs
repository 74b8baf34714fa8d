//! Fast path for the common log line: parsed in one pass without a search for the line end.
//!
//! ```text
//! (1700000000.123456) can0 18A#08A01F0020\n
//!  └ cached ┘ └ 6 ┘   └cached┘3 or 8, up to 16 hex digits
//! ```
//!
//! Seconds and interface repeat from line to line, so both are compared with the previous line instead of
//! being parsed. Digits are handled eight or sixteen at a time in one register. Everything else (other
//! fraction lengths, remote, FD and error frames, suffixes, CR) is left to [`super::line`]; a property test
//! compares the results of both.

use bytemuck::must_cast;
use wide::{i16x8, u8x16, u16x8};

use crate::frame::{BusIndex, CanId, Frame, FrameFlags, Timestamp};

/// Size of the window in bytes: the longest common line, and room for eight-byte loads after it.
pub(super) const WINDOW: usize = 64;

/// Longest interface name that is cached, in bytes.
const LONGEST_NAME: usize = 7;

/// The byte, repeated in a register of eight.
const fn each(byte: u8) -> u64 {
    u64::from_le_bytes([byte; 8])
}

/// Second and interfaces of the previous lines.
#[derive(Debug, Clone, Default)]
pub(super) struct Cache {
    /// `(1700000000.`, as two registers.
    head: (u64, u32),
    nanoseconds: i64,
    names: [Name; 2],
}

#[derive(Debug, Clone, Copy)]
struct Name {
    /// Name and the space after it.
    text: u64,
    mask: u64,
    length: usize,
    bus: BusIndex,
}

/// A name that matches nothing.
impl Default for Name {
    fn default() -> Self {
        Self { text: u64::MAX, mask: 0, length: 0, bus: BusIndex(0) }
    }
}

impl Cache {
    /// Stores the interface of a line that the general parser read.
    pub(super) fn learn(&mut self, name: &[u8], bus: BusIndex) {
        if name.len() > LONGEST_NAME {
            return;
        }
        let mut text = [0; 8];
        let mut mask = [0; 8];
        for (index, byte) in name.iter().chain(b" ").enumerate() {
            if let (Some(text), Some(mask)) = (text.get_mut(index), mask.get_mut(index)) {
                (*text, *mask) = (*byte, 0xFF);
            }
        }
        let [first, _] = self.names;
        let name = Name {
            text: u64::from_le_bytes(text),
            mask: u64::from_le_bytes(mask),
            length: name.len() + 1,
            bus,
        };
        if first.text != name.text {
            self.names = [name, first];
        }
    }

    /// Parses the second if it differs from that of the previous line.
    #[cold]
    fn new_second(&mut self, input: &[u8; WINDOW], head: (u64, u32)) -> Option<i64> {
        let [open, digits @ .., point] = input.first_chunk::<12>()?;
        if (*open, *point) != (b'(', b'.') {
            return None;
        }
        let value = digits.iter().try_fold(0_i64, |value, digit| {
            digit.is_ascii_digit().then(|| value * 10 + i64::from(digit - b'0'))
        })?;
        // Ten digits can exceed the range of nanoseconds; the general parser saturates.
        let nanoseconds = value.checked_mul(1_000_000_000)?;
        (self.head, self.nanoseconds) = (head, nanoseconds);
        Some(nanoseconds)
    }

    /// Parses the line at the start of `input` into `frame`, except its number; returns the length of the
    /// line with its `\n`. `None` leaves the line to the general parser and `frame` unchanged.
    #[inline]
    pub(super) fn parse(&mut self, input: &[u8; WINDOW], frame: &mut Frame) -> Option<usize> {
        let end_of_head = load(input, 4)? >> 32;
        let head = (load(input, 0)?, u32::try_from(end_of_head).ok()?);
        let nanoseconds = if head == self.head { self.nanoseconds } else { self.new_second(input, head)? };
        let fraction = load(input, 12)?;
        if fraction >> 48 != u64::from(u16::from_le_bytes(*b") ")) {
            return None;
        }
        let micros = eight_digits(fraction << 16 | u64::from(u16::from_le_bytes(*b"00")))?;
        let channel = load(input, 20)?;
        let [first, second] = &self.names;
        let name = if channel & first.mask == first.text {
            first
        } else if channel & second.mask == second.text {
            second
        } else {
            return None;
        };
        let (id, data_start) = identifier(input, 20 + name.length)?;
        let (bytes, digits) = hex_run(input, data_start)?;
        let end = data_start + digits as usize;
        if input.get(end) != Some(&b'\n') || digits % 2 != 0 {
            return None;
        }
        let beyond = u64::MAX.checked_shl(digits * 4).unwrap_or(0);
        *frame.bytes.first_chunk_mut()? = (bytes & !beyond).to_le_bytes();
        frame.time = Some(Timestamp(nanoseconds.saturating_add(micros * 1_000)));
        frame.bus = name.bus;
        frame.id = id;
        frame.flags = FrameFlags(0);
        frame.length = (digits / 2).to_le_bytes()[0];
        frame.raw_dlc = 0;
        Some(end + 1)
    }
}

#[inline]
fn load(input: &[u8; WINDOW], at: usize) -> Option<u64> {
    input.get(at..)?.first_chunk().map(|chunk| u64::from_le_bytes(*chunk))
}

/// Parses three digits and `#`, or eight digits and `#` without the error bit.
#[inline]
fn identifier(input: &[u8; WINDOW], start: usize) -> Option<(CanId, usize)> {
    let (bytes, digits) = hex_run(input, start)?;
    let [first, second, third, fourth, ..] = bytes.to_le_bytes();
    let (id, end) = if digits == 3 {
        let id = u16::from_be_bytes([first, second]) >> 4;
        ((id <= 0x7FF).then_some(CanId::Standard(id))?, start + 3)
    } else if digits == 8 {
        let id = u32::from_be_bytes([first, second, third, fourth]);
        ((id < 0x2000_0000).then_some(CanId::Extended(id))?, start + 8)
    } else {
        return None;
    };
    (input.get(end) == Some(&b'#')).then_some((id, end + 1))
}

/// Parses up to sixteen hex digits from `start`: their bytes, first byte lowest, and the number of digits.
/// The bytes after the digits are undefined.
///
/// Always processes sixteen bytes: a branch on the length would be mispredicted too often.
#[inline]
fn hex_run(input: &[u8; WINDOW], start: usize) -> Option<(u64, u32)> {
    // The pairs below require the first digit in the low byte; big-endian machines use the general parser
    // only.
    if cfg!(target_endian = "big") {
        return None;
    }
    let text = u8x16::new(*input.get(start..)?.first_chunk()?);
    let digit = text ^ u8x16::splat(b'0');
    let letter = (text | u8x16::splat(0x20)) - u8x16::splat(b'a');
    let is_letter = letter.simd_le(u8x16::splat(5));
    let is_hex = digit.simd_le(u8x16::splat(9)) | is_letter;
    let digits = (!is_hex.to_bitmask()).trailing_zeros();
    // The low nibble of a letter is its value minus 9.
    let nibbles = (digit & u8x16::splat(0x0F)) + (is_letter & u8x16::splat(9));
    let pairs: u16x8 = must_cast(nibbles);
    let pairs: i16x8 = must_cast((pairs << 4 | pairs >> 8) & u16x8::splat(0xFF));
    let [bytes, _]: [u64; 2] = must_cast(u8x16::narrow_i16x8(pairs, pairs));
    Some((bytes, digits))
}

/// Value of eight decimal digits, first digit in the lowest byte.
#[inline]
fn eight_digits(text: u64) -> Option<i64> {
    let values = text ^ each(b'0');
    if (values | values.wrapping_add(each(0x7F - 9))) & each(0x80) != 0 {
        return None;
    }
    let pairs = (values * 10 + (values >> 8)) & 0x00FF_00FF_00FF_00FF;
    let quads = (pairs * 100 + (pairs >> 16)) & 0x0000_FFFF_0000_FFFF;
    let all = quads.wrapping_mul(10_000).wrapping_add(quads >> 32) & 0xFFFF_FFFF;
    i64::try_from(all).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(line: &str) -> [u8; WINDOW] {
        let mut window = [b'~'; WINDOW];
        window[..line.len()].copy_from_slice(line.as_bytes());
        window
    }

    fn cache() -> Cache {
        let mut cache = Cache::default();
        cache.learn(b"can1", BusIndex(1));
        cache.learn(b"can0", BusIndex(0));
        cache
    }

    /// The frame of a line, and the length of the line.
    fn parse(line: &str) -> Option<(Frame, usize)> {
        let mut frame = Frame::EMPTY;
        let taken = cache().parse(&window(line), &mut frame)?;
        Some((frame, taken))
    }

    fn expected(time: i64, bus: u8, id: CanId, data: &[u8]) -> Frame {
        Frame { time: Some(Timestamp(time)), bus: BusIndex(bus), ..Frame::data_frame(id, data) }
    }

    #[test]
    fn a_line_of_each_common_kind() {
        let line = "(1700000000.123456) can0 18A#08a01F0020\n";
        let (frame, taken) = parse(line).unwrap();
        let data = [0x08, 0xA0, 0x1F, 0x00, 0x20];
        assert_eq!(frame, expected(1_700_000_000_123_456_000, 0, CanId::Standard(0x18A), &data));
        assert_eq!(frame.bytes[5..8], [0, 0, 0], "what is behind the data is no data");
        assert_eq!(taken, line.len());

        let (frame, _) = parse("(0000000000.000001) can1 18FEF100#0011223344556677\n").unwrap();
        let data = [0, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77];
        assert_eq!(frame, expected(1_000, 1, CanId::Extended(0x18FE_F100), &data));

        let (frame, _) = parse("(1700000000.000000) can0 080#\n").unwrap();
        assert_eq!(frame, expected(1_700_000_000_000_000_000, 0, CanId::Standard(0x80), &[]));
    }

    #[test]
    fn each_digit_has_its_value_and_their_neighbours_in_ascii_none() {
        for (digits, byte) in [("09", 0x09), ("9a", 0x9A), ("aF", 0xAF), ("f0", 0xF0), ("A9", 0xA9)] {
            let (frame, _) = parse(&format!("(1700000000.000000) can0 080#{digits}\n")).unwrap();
            assert_eq!(frame.data(), [byte], "{digits}");
        }
        for wrong in ['/', ':', '@', 'G', '`', 'g', ' ', 'P', 'p', 'Ä'] {
            assert_eq!(parse(&format!("(1700000000.000000) can0 080#0{wrong}\n")), None, "{wrong}");
            assert_eq!(parse(&format!("(1700000000.000000) can0 0{wrong}0#00\n")), None, "{wrong}");
        }
    }

    #[test]
    fn anything_else_is_left_to_the_general_parser() {
        for line in [
            "(1700000000.123456) can0 701#R1\n",
            "(1700000000.123456) can0 123##1AA\n",
            "(1700000000.123456) can0 123#AABBCCDDEEFF0011_9\n",
            "(1700000000.123456) can0 123#AAB\n",
            "(1700000000.123456) can0 123#AA\r\n",
            "(1700000000.123456) can0 20000004#0004000000000000\n",
            "(1700000000.123456) can0 800#AA\n",
            "(1700000000.123456789) can0 123#AA\n",
            "(170000000 .123456) can0 123#AA\n",
            "(1700000000.12x456) can0 123#AA\n",
            "(9999999999.999999) can0 123#AA\n",
            "(1700000000.123456) can2 123#AA\n",
            "(1700000000.123456) can0 12G#AA\n",
            " (1700000000.123456)  can0  123   [1]  AA\n",
        ] {
            assert_eq!(parse(line), None, "{line}");
        }
    }
}
