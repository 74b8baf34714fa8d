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

/// Offset of the fraction of a second in a line.
const FRACTION: usize = 12;

/// Offset of the interface name in a line.
const NAME: usize = 20;

/// Value of an ASCII hex digit; [`NOT_HEX`] for other bytes.
static HEX: [u16; 256] = hex_table();

/// Exceeds an 11-bit identifier in every digit position.
const NOT_HEX: u16 = 0x800;

/// Mask of the payload by its number of hex digits.
static PAYLOAD: [u64; 17] = payload_table();

#[expect(clippy::indexing_slicing, reason = "evaluated at compile time")]
const fn payload_table() -> [u64; 17] {
    let mut table = [u64::MAX; 17];
    let mut digits = 0;
    while digits < 16 {
        table[digits] = (1 << (digits * 4)) - 1;
        digits += 1;
    }
    table
}

#[expect(clippy::indexing_slicing, reason = "evaluated at compile time")]
const fn hex_table() -> [u16; 256] {
    let mut table = [NOT_HEX; 256];
    let mut digit = 0;
    while digit < 16 {
        table[b"0123456789ABCDEF"[digit as usize] as usize] = digit;
        table[b"0123456789abcdef"[digit as usize] as usize] = digit;
        digit += 1;
    }
    table
}

/// Second and interfaces of the previous lines.
#[derive(Debug, Clone, Default)]
pub(super) struct LineCache {
    /// `(1700000000.`, as two registers that overlap.
    head: (u64, u64),
    nanoseconds: i64,
    names: [InterfaceName; 2],
}

#[derive(Debug, Clone, Copy)]
struct InterfaceName {
    /// Name and the space after it.
    text: u64,
    mask: u64,
    /// Length of the name, at most [`LONGEST_NAME`].
    length: usize,
    bus: BusIndex,
}

/// A name that matches nothing.
impl Default for InterfaceName {
    fn default() -> Self {
        Self { text: u64::MAX, mask: 0, length: 0, bus: BusIndex(0) }
    }
}

impl LineCache {
    /// Stores the interface of a line that the general parser read.
    pub(super) fn learn_interface(&mut self, name: &[u8], bus: BusIndex) {
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
        let name = InterfaceName {
            text: u64::from_le_bytes(text),
            mask: u64::from_le_bytes(mask),
            length: name.len(),
            bus,
        };
        if first.text != name.text {
            self.names = [name, first];
        }
    }

    /// Parses the second if it differs from that of the previous line.
    #[cold]
    fn new_second(&mut self, input: &[u8; WINDOW], head: (u64, u64)) -> Option<i64> {
        let [open, digits @ .., point] = input.first_chunk::<12>()?;
        if (*open, *point) != (b'(', b'.') {
            return None;
        }
        let value = digits.iter().try_fold(0_i64, |value, digit| {
            digit.is_ascii_digit().then(|| value * 10 + i64::from(digit - b'0'))
        })?;
        // Ten digits can exceed the range of nanoseconds; the general parser saturates. The range includes all
        // fractions of the second.
        let nanoseconds = value.checked_mul(1_000_000_000)?;
        nanoseconds.checked_add(999_999_999)?;
        (self.head, self.nanoseconds) = (head, nanoseconds);
        Some(nanoseconds)
    }

    /// Parses the line at the start of `input` into `frame`, except its number; returns the length of the
    /// line with its `\n`. `None` leaves the line to the general parser and `frame` unchanged.
    #[inline]
    pub(super) fn parse(&mut self, input: &[u8; WINDOW], frame: &mut Frame) -> Option<usize> {
        let head = (load_word(input, 0)?, load_word(input, 4)?);
        let is_same = (head.0 ^ self.head.0) | (head.1 ^ self.head.1) == 0;
        let nanoseconds = if is_same { self.nanoseconds } else { self.new_second(input, head)? };
        let fraction = parse_fraction(load_word(input, FRACTION)?)?;
        let channel = load_word(input, NAME)?;
        let [first, second] = &self.names;
        let name = if channel & first.mask == first.text {
            first
        } else if channel & second.mask == second.text {
            second
        } else {
            return None;
        };
        // The remainder equals the length; it shows the compiler that the window contains the line.
        let (id, data_start) = parse_identifier(input, NAME + 1 + name.length % (LONGEST_NAME + 1))?;
        let (bytes, digits) = hex_run(input, data_start)?;
        let end = data_start + digits as usize;
        if input.get(end) != Some(&b'\n') || digits % 2 != 0 {
            return None;
        }
        *frame.bytes.first_chunk_mut()? = (bytes & PAYLOAD.get(digits as usize)?).to_le_bytes();
        frame.time = Some(Timestamp(nanoseconds.wrapping_add(fraction)));
        frame.bus = name.bus;
        frame.id = id;
        frame.flags = FrameFlags(0);
        frame.length = (digits / 2).to_le_bytes()[0];
        frame.raw_dlc = 0;
        Some(end + 1)
    }
}

#[inline]
fn load_word(input: &[u8; WINDOW], at: usize) -> Option<u64> {
    input.get(at..)?.first_chunk().map(|chunk| u64::from_le_bytes(*chunk))
}

/// Parses three digits and `#`, or eight digits and `#` without the error bit.
#[inline]
fn parse_identifier(input: &[u8; WINDOW], start: usize) -> Option<(CanId, usize)> {
    let [first, second, third, mark] = *input.get(start..)?.first_chunk()?;
    if mark == b'#' {
        let [first, second, third] = [first, second, third].map(digit_value);
        let id = first << 8 | second << 4 | third;
        let [low, high, ..] = id.to_le_bytes();
        return (id <= 0x7FF).then_some((CanId::Standard(u16::from_le_bytes([low, high])), start + 4));
    }
    let (bytes, digits) = hex_run(input, start)?;
    let [first, second, third, fourth, ..] = bytes.to_le_bytes();
    let id = u32::from_be_bytes([first, second, third, fourth]);
    let is_valid = digits == 8 && id < 0x2000_0000 && input.get(start + 8) == Some(&b'#');
    is_valid.then_some((CanId::Extended(id), start + 9))
}

#[inline]
fn digit_value(digit: u8) -> u32 {
    u32::from(HEX.get(usize::from(digit)).copied().unwrap_or(NOT_HEX))
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
    // Bytes that are not digits, and not letters from A to F, become 16 or more.
    let decimal = (text + u8x16::splat(0xFF - b'9')).saturating_sub(u8x16::splat(6)) - u8x16::splat(0xF0);
    let letter = ((text & u8x16::splat(0xDF)) - u8x16::splat(b'A')).saturating_add(u8x16::splat(10));
    let nibbles = decimal.min(letter);
    let not_hex = nibbles.saturating_add(u8x16::splat(0x80 - 16)).to_bitmask();
    let digits = (not_hex | 1 << 16).trailing_zeros();
    let pairs: u16x8 = must_cast(nibbles);
    let pairs: i16x8 = must_cast((pairs << 12 | pairs) >> 8);
    let [bytes, _]: [u64; 2] = must_cast(u8x16::narrow_i16x8(pairs, pairs));
    Some((bytes, digits))
}

/// Nanoseconds of six decimal digits before `) `, first digit in the lowest byte.
#[inline]
fn parse_fraction(text: u64) -> Option<i64> {
    let values = text ^ u64::from_le_bytes(*b"000000) ");
    // A byte of 10 or more, and in the last two bytes of 1 or more, sets its uppermost bit.
    let excess =
        u64::from_le_bytes([0x80 - 10, 0x80 - 10, 0x80 - 10, 0x80 - 10, 0x80 - 10, 0x80 - 10, 0x7F, 0x7F]);
    if (values | values.wrapping_add(excess)) & u64::from_le_bytes([0x80; 8]) != 0 {
        return None;
    }
    // Each multiplication adds a group of digits to the scaled group before it.
    let pairs = (values << 16).wrapping_mul(1 + (10 << 8)) >> 8 & 0x00FF_00FF_00FF_00FF;
    let quads = pairs.wrapping_mul(1 + (100 << 16)) >> 16 & 0x0000_FFFF_0000_FFFF;
    // The first four of eight digits are below 100, so that the sum is below 2^32.
    let nanoseconds = quads.wrapping_mul(1_000 + (10_000_000 << 32)) >> 32;
    i64::try_from(nanoseconds).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(line: &str) -> [u8; WINDOW] {
        let mut window = [b'~'; WINDOW];
        window[..line.len()].copy_from_slice(line.as_bytes());
        window
    }

    fn cache() -> LineCache {
        let mut cache = LineCache::default();
        cache.learn_interface(b"can1", BusIndex(1));
        cache.learn_interface(b"can0", BusIndex(0));
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

    /// The frame of a line in which `byte` replaces the byte at `place`.
    fn parse_with(line: &str, place: usize, byte: u8) -> Option<Frame> {
        let mut window = window(line);
        window[place] = byte;
        let mut frame = Frame::EMPTY;
        cache().parse(&window, &mut frame).map(|_| frame)
    }

    #[test]
    fn a_byte_is_a_digit_exactly_if_the_standard_library_accepts_it() {
        let line = "(1700000000.000000) can0 000#0000000000000000\n";
        for byte in 0..=u8::MAX {
            let (digit, decimal) = (char::from(byte).to_digit(16), char::from(byte).to_digit(10));
            for place in 0..6 {
                let found = parse_with(line, FRACTION + place, byte).map(|frame| frame.time.unwrap().0);
                let unit = 100_000_000 / 10_i64.pow(u32::try_from(place).unwrap());
                let expected = decimal.map(|digit| 1_700_000_000_000_000_000 + i64::from(digit) * unit);
                assert_eq!(found, expected, "fraction, {place}: {byte}");
            }
            for place in 0..3 {
                let found = parse_with(line, 25 + place, byte).map(|frame| frame.id.number());
                let expected = digit.map(|digit| digit << (8 - 4 * place)).filter(|id| *id <= 0x7FF);
                assert_eq!(found, expected, "identifier, {place}: {byte}");
            }
            for place in 0..16 {
                let found = parse_with(line, 29 + place, byte).filter(|frame| frame.length == 8);
                let found = found.map(|frame| u64::from_be_bytes(*frame.bytes.first_chunk().unwrap()));
                assert_eq!(found, digit.map(|digit| u64::from(digit) << (60 - 4 * place)), "{place}: {byte}");
            }
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
            "(9223372036.000000) can0 123#AA\n",
            "(1700000000.123456) can2 123#AA\n",
            "(1700000000.123456) can0 12G#AA\n",
            " (1700000000.123456)  can0  123   [1]  AA\n",
        ] {
            assert_eq!(parse(line), None, "{line}");
        }
    }
}
