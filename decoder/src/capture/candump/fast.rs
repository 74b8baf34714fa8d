//! The common log line, read straight ahead without searching for its end.
//!
//! ```text
//! (1700000000.123456) can0 18A#08A01F0020\n
//!  └ cached ┘ └ 6 ┘   └cached┘3 or 8, up to 16 hex digits
//! ```
//!
//! Seconds and interface repeat from line to line, so both are compared with the line before instead of
//! being parsed. Digits are handled eight at a time in one register. Everything else (other fraction
//! lengths, remote, FD and error frames, suffixes, CR) is left to [`super::line`]; a property test holds
//! both to the same result.

use crate::frame::{BusIndex, CanId};

/// Bytes looked at: the longest common line, and room for eight-byte loads behind it.
pub(super) const WINDOW: usize = 64;

/// Longest interface name that is cached, in bytes.
const LONGEST_NAME: usize = 7;

/// Repeated byte, as a register of eight.
const fn each(byte: u8) -> u64 {
    u64::from_le_bytes([byte; 8])
}

/// What was read of a line.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct FastLine {
    pub(super) stamp: i64,
    pub(super) bus: BusIndex,
    pub(super) id: CanId,
    pub(super) length: u8,
    pub(super) data: u64,
    /// Bytes of the line with its `\n`.
    pub(super) taken: usize,
}

/// Second and interfaces of the lines before.
#[derive(Debug, Clone, Default)]
pub(super) struct Cache {
    /// `(1700000000.`, as two registers.
    head: (u64, u32),
    nanoseconds: i64,
    names: [Name; 2],
}

#[derive(Debug, Clone, Copy, Default)]
struct Name {
    /// Name and the blank behind it.
    text: u64,
    mask: u64,
    length: usize,
    bus: BusIndex,
}

impl Cache {
    /// Remembers the interface of a line that was read the long way.
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

    /// Another second than that of the line before.
    #[cold]
    fn new_second(&mut self, input: &[u8; WINDOW], head: (u64, u32)) -> Option<i64> {
        let [open, digits @ .., point] = input.first_chunk::<12>()?;
        if (*open, *point) != (b'(', b'.') {
            return None;
        }
        let value = digits.iter().try_fold(0_i64, |value, digit| {
            digit.is_ascii_digit().then(|| value * 10 + i64::from(digit - b'0'))
        })?;
        // Ten digits can be a few years beyond the last nanosecond there is: the general parser saturates.
        let nanoseconds = value.checked_mul(1_000_000_000)?;
        (self.head, self.nanoseconds) = (head, nanoseconds);
        Some(nanoseconds)
    }

    /// Reads the line at the start of `input`; `None` leaves it to the general parser.
    #[inline]
    pub(super) fn parse(&mut self, input: &[u8; WINDOW]) -> Option<FastLine> {
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
        let name = if channel & first.mask == first.text && first.length != 0 {
            first
        } else if channel & second.mask == second.text && second.length != 0 {
            second
        } else {
            return None;
        };
        let start = 20 + name.length;
        let (id, data_start) = identifier(input, start)?;
        let (data, digits) = hex_run(input, data_start)?;
        let end = data_start + digits;
        if input.get(end) != Some(&b'\n') || digits % 2 != 0 {
            return None;
        }
        Some(FastLine {
            stamp: nanoseconds.saturating_add(micros * 1_000),
            bus: name.bus,
            id,
            length: u8::try_from(digits / 2).ok()?,
            data,
            taken: end + 1,
        })
    }
}

#[inline]
fn load(input: &[u8; WINDOW], at: usize) -> Option<u64> {
    input.get(at..)?.first_chunk().map(|chunk| u64::from_le_bytes(*chunk))
}

/// Three digits and `#`, or eight and `#` without the error bit.
#[inline]
fn identifier(input: &[u8; WINDOW], start: usize) -> Option<(CanId, usize)> {
    let text = load(input, start)?;
    if text >> 24 & 0xFF == u64::from(b'#') {
        let digits = text & 0x00FF_FFFF | u64::from(b'0') << 24;
        if not_hex(digits | each(b'0') << 32) != 0 {
            return None;
        }
        // Nibbles of the digits, first digit lowest byte.
        let nibbles = nibbles(digits);
        let id = (nibbles & 0xF) << 8 | (nibbles >> 8 & 0xF) << 4 | nibbles >> 16 & 0xF;
        return (id <= 0x7FF).then_some((CanId::Standard(u16::try_from(id).ok()?), start + 4));
    }
    if input.get(start + 8) != Some(&b'#') || not_hex(text) != 0 {
        return None;
    }
    let id = pack(nibbles(text)).swap_bytes();
    (id < 0x2000_0000).then_some((CanId::Extended(id), start + 9))
}

/// Up to sixteen hex digits from `start`: their bytes, first byte lowest, and the number of digits.
///
/// Always looks at sixteen: a branch on the length would be mispredicted too often.
#[inline]
fn hex_run(input: &[u8; WINDOW], start: usize) -> Option<(u64, usize)> {
    let low = load(input, start)?;
    let high = load(input, start + 8)?;
    let wrong = u128::from(not_hex(low)) | u128::from(not_hex(high)) << 64;
    let digits = wrong.trailing_zeros() / 8;
    let bytes = u64::from(pack(nibbles(low))) | u64::from(pack(nibbles(high))) << 32;
    let beyond = u64::MAX.checked_shl(digits * 4).unwrap_or(0);
    Some((bytes & !beyond, digits as usize))
}

/// The top bit of each byte that is no hexadecimal digit.
#[inline]
const fn not_hex(text: u64) -> u64 {
    let ascii = text & each(0x7F);
    let as_digit = ascii ^ each(0x30);
    let above_nine = as_digit.wrapping_add(each(0x7F - 9));
    let as_letter = (ascii | each(0x20)) ^ each(0x60);
    let above_f = as_letter.wrapping_add(each(0x7F - 6));
    let below_a = !as_letter.wrapping_add(each(0x7F));
    (text | above_nine & (above_f | below_a)) & each(0x80)
}

/// The value of each hexadecimal digit, in place.
#[inline]
const fn nibbles(text: u64) -> u64 {
    (text & each(0x0F)) + ((text >> 6) & each(0x01)) * 9
}

/// Eight nibbles, first lowest, to four bytes, first lowest.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "the low half holds the four bytes")]
const fn pack(nibbles: u64) -> u32 {
    let pairs = (nibbles << 4 | nibbles >> 8) & 0x00FF_00FF_00FF_00FF;
    let quads = (pairs | pairs >> 8) & 0x0000_FFFF_0000_FFFF;
    (quads | quads >> 16) as u32
}

/// The number that eight decimal digits make, first digit lowest byte.
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

    #[test]
    fn a_line_of_each_common_kind() {
        let line = "(1700000000.123456) can0 18A#08a01F0020\n";
        let fast = cache().parse(&window(line)).unwrap();
        assert_eq!(fast.stamp, 1_700_000_000_123_456_000);
        assert_eq!(fast.id, CanId::Standard(0x18A));
        assert_eq!((fast.length, fast.bus), (5, BusIndex(0)));
        assert_eq!(fast.data.to_le_bytes()[..5], [0x08, 0xA0, 0x1F, 0x00, 0x20]);
        assert_eq!(fast.taken, line.len());

        let fast = cache().parse(&window("(0000000000.000001) can1 18FEF100#0011223344556677\n")).unwrap();
        assert_eq!((fast.stamp, fast.id), (1_000, CanId::Extended(0x18FE_F100)));
        assert_eq!(fast.data.to_le_bytes(), [0, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77]);
        assert_eq!(fast.bus, BusIndex(1));

        let fast = cache().parse(&window("(1700000000.000000) can0 080#\n")).unwrap();
        assert_eq!((fast.length, fast.id), (0, CanId::Standard(0x80)));
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
            assert_eq!(cache().parse(&window(line)), None, "{line}");
        }
    }
}
