//! Length of a frame on the wire, exact for classic frames (ISO 11898-1 §10.4, §10.5).
//!
//! ```text
//! SOF identifier RTR IDE r0 DLC data CRC │ delimiter ACK EOF intermission
//! └──── a stuff bit after five equal ──┘ │ └──── 13 bits, never stuffed ─┘
//! ```

use crate::frame::{CanId, Frame, FrameFlags};

/// CRC delimiter, ACK slot and delimiter, seven bits of end of frame, three of intermission.
const UNSTUFFED: u32 = 1 + 2 + 7 + 3;

/// CRC-15: x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1.
const POLYNOMIAL: u16 = 0x4599;

/// Number of equal bits after which an opposite bit is stuffed.
const LONGEST_RUN: usize = 5;

/// Stuffing states: start, and runs of 1 to 4 zeros or ones.
const STATES: usize = 9;

/// Maximum number of bytes of the CRC: 39 bits of an extended header, padded with zeros in front, and data.
const CRC_BYTES: usize = 5 + 8;

/// CRC of a byte that is followed by n bytes of zeros, by n. The CRC of bytes is the sum of their CRCs.
static CRC: [[u16; 256]; CRC_BYTES] = crc_table();

/// Stuffing table: by state and bits, the next state and the number of stuff bits as in [`BitStuffing`]. Rows beyond
/// the states are unused.
type StuffTable = [u32; 16 << 8];

/// Stuffing of eight bits.
static STUFF: StuffTable = stuff_table(true);

/// Stuffing of fewer than eight bits, after a 1 that marks their number.
static STUFF_PART: StuffTable = stuff_table(false);

#[expect(clippy::cast_possible_truncation, clippy::indexing_slicing, reason = "evaluated at compile time")]
const fn crc_table() -> [[u16; 256]; CRC_BYTES] {
    let mut table = [[0; 256]; CRC_BYTES];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = (byte as u16) << 7;
        let mut following = 0;
        while following < CRC_BYTES {
            let mut bit = 0;
            while bit < 8 {
                crc = crc_step(crc, false);
                bit += 1;
            }
            table[following][byte] = crc;
            following += 1;
        }
        byte += 1;
    }
    table
}

const fn crc_step(crc: u16, bit: bool) -> u16 {
    let carry = (crc >> 14 & 1 != 0) != bit;
    let crc = crc << 1 & 0x7FFF;
    if carry { crc ^ POLYNOMIAL } else { crc }
}

#[expect(clippy::cast_possible_truncation, clippy::indexing_slicing, reason = "evaluated at compile time")]
const fn stuff_table(is_whole: bool) -> StuffTable {
    let mut table = [0; 16 << 8];
    let mut state = 0;
    while state < STATES {
        let mut bits = if is_whole { 0 } else { 1 };
        while bits < 256_u32 {
            let (mut stuffed, mut now) = (0, state);
            let mut place = if is_whole { 8 } else { bits.ilog2() };
            while place > 0 {
                place -= 1;
                let (more, next) = stuff_step(now, bits >> place & 1 != 0);
                stuffed += more;
                now = next;
            }
            table[state << 8 | bits as usize] = stuffed << 16 | (now as u32) << 8;
            bits += 1;
        }
        state += 1;
    }
    table
}

/// Next state: 0 is the start, 1 to 4 a run of that many zeros, 5 to 8 a run of 1 to 4 ones.
const fn stuff_step(state: usize, bit: bool) -> (u32, usize) {
    let (last, run) = if state > 4 { (true, state - 4) } else { (false, state) };
    let run = if run > 0 && last == bit { run + 1 } else { 1 };
    // The stuff bit has the opposite value and starts a new run.
    let (stuffed, bit, run) = if run == LONGEST_RUN { (1, !bit, 1) } else { (0, bit, run) };
    (stuffed, if bit { run + 4 } else { run })
}

/// Bits sent so far: stuffing state in bits 8 to 11, number of stuff bits in bits 16 to 31.
#[derive(Debug, Clone, Copy, Default)]
struct BitStuffing(u32);

impl BitStuffing {
    const STATE: u32 = 0xF00;

    #[inline]
    fn send_bits(&mut self, table: &StuffTable, bits: u8) {
        let entry = table.get((self.0 & Self::STATE | u32::from(bits)) as usize).copied().unwrap_or(0);
        self.0 = (self.0 & !Self::STATE).wrapping_add(entry);
    }

    fn stuff_bits(self) -> u32 {
        self.0 >> 16
    }
}

/// Properties of a classic frame, apart from its identifier, that determine the bits before the data.
#[derive(Debug, Clone, Copy)]
struct FrameShape {
    is_remote: bool,
    dlc: u8,
    /// Number of data bytes, at most 8.
    length: u8,
}

impl FrameShape {
    fn shape_of(frame: &Frame) -> Self {
        let is_remote = frame.flags.contains(FrameFlags::REMOTE);
        let length = frame.length.min(8);
        let dlc = if frame.raw_dlc > 8 { frame.raw_dlc } else { length };
        Self { is_remote, dlc, length: if is_remote { 0 } else { length } }
    }
}

/// Data bytes of a classic frame as one number, the first byte highest, and zeros after them.
#[inline]
fn payload_number(frame: &Frame, mask: u64) -> u64 {
    u64::from_be_bytes(frame.bytes.first_chunk().copied().unwrap_or_default()) & mask
}

/// Mask of [`payload_number`] for up to eight bytes.
fn payload_mask(length: u8) -> u64 {
    !u64::MAX.checked_shr(8 * u32::from(length)).unwrap_or(0)
}

/// State after SOF to DLC, and the CRC of these bits with the data as zeros.
#[derive(Debug, Clone, Copy, Default)]
struct FrameHeader {
    crc: u16,
    stuffing: BitStuffing,
    /// Bits of the frame without stuff bits.
    bits: u32,
    length: u8,
}

impl FrameHeader {
    fn header_of(id: CanId, FrameShape { is_remote, dlc, length }: FrameShape) -> Self {
        let end = u64::from(is_remote) << 6 | u64::from(dlc & 0xF);
        let mut stuffing = BitStuffing::default();
        let following = usize::from(length);
        let (mut crc, width, last) = match id {
            CanId::Standard(id) => {
                // SOF, identifier, RTR, IDE, r0, DLC.
                let [last, middle, first, ..] = (u64::from(id & 0x7FF) << 7 | end).to_le_bytes();
                stuffing.send_bits(&STUFF_PART, 1 << 3 | first);
                stuffing.send_bits(&STUFF, middle);
                (crc_of(first, following + 2) ^ crc_of(middle, following + 1), 19, last)
            }
            CanId::Extended(id) => {
                // SOF, eleven bits, SRR, IDE; eighteen bits, RTR, r1, r0, DLC.
                let id = u64::from(id & 0x1FFF_FFFF);
                let bits = id >> 18 << 27 | 0b11 << 25 | (id & 0x3_FFFF) << 7 | end;
                let [last, fourth, third, second, first, ..] = bits.to_le_bytes();
                stuffing.send_bits(&STUFF_PART, 1 << 7 | first);
                for byte in [second, third, fourth] {
                    stuffing.send_bits(&STUFF, byte);
                }
                let upper = crc_of(first, following + 4) ^ crc_of(second, following + 3);
                (upper ^ crc_of(third, following + 2) ^ crc_of(fourth, following + 1), 39, last)
            }
        };
        stuffing.send_bits(&STUFF, last);
        crc ^= crc_of(last, following);
        Self { crc, stuffing, bits: width + 8 * u32::from(length) + 15 + UNSTUFFED, length }
    }

    /// Number of bits of a frame with this header and [`payload_number`].
    fn count_bits(self, payload: u64) -> u32 {
        let Self { mut crc, mut stuffing, bits, length } = self;
        // The last byte is the lowest. Bytes of zeros in front of the data do not change the CRC.
        let aligned = payload.checked_shr(64 - 8 * u32::from(length)).unwrap_or(0).to_le_bytes();
        for (following, byte) in aligned.into_iter().enumerate() {
            crc ^= crc_of(byte, following);
        }
        let mut rest = payload.swap_bytes();
        for _ in 0..length {
            stuffing.send_bits(&STUFF, rest.to_le_bytes()[0]);
            rest >>= 8;
        }
        let [high, low] = crc.to_be_bytes();
        stuffing.send_bits(&STUFF_PART, 1 << 7 | high);
        stuffing.send_bits(&STUFF, low);
        bits + stuffing.stuff_bits()
    }
}

/// CRC of a byte that `following` bytes of zeros follow.
#[inline]
fn crc_of(byte: u8, following: usize) -> u16 {
    CRC.get(following).and_then(|row| row.get(usize::from(byte))).copied().unwrap_or(0)
}

/// Whether the length of a frame cannot be computed.
#[inline]
fn is_unknown(frame: &Frame) -> bool {
    frame.flags.0 & (FrameFlags::FD.0 | FrameFlags::ERROR.0) != 0
}

/// Number of bits of a frame including intermission; `None` for FD and error frames.
pub fn frame_bits(frame: &Frame) -> Option<u32> {
    if is_unknown(frame) {
        return None;
    }
    let header = FrameHeader::header_of(frame.id, FrameShape::shape_of(frame));
    Some(header.count_bits(payload_number(frame, payload_mask(header.length))))
}

/// Number of bits of the last frame of one identifier: computed again only if the frame changes.
#[derive(Debug, Clone, Default)]
pub(super) struct LastFrameBits {
    /// Length, DLC and flags of the last frame; the last byte is 0 before the first frame.
    shape: [u8; 4],
    header: FrameHeader,
    mask: u64,
    payload: u64,
    bits: u32,
}

impl LastFrameBits {
    /// As [`frame_bits`], for a frame of the same identifier as all others.
    #[inline]
    pub(super) fn count_bits(&mut self, frame: &Frame) -> Option<u32> {
        if is_unknown(frame) {
            return None;
        }
        let shape = [frame.length, frame.raw_dlc, frame.flags.0 & FrameFlags::REMOTE.0, 1];
        if shape != self.shape {
            self.set_shape(frame, shape);
        }
        let payload = payload_number(frame, self.mask);
        if payload != self.payload {
            self.payload = payload;
            self.bits = self.header.count_bits(payload);
        }
        Some(self.bits)
    }

    #[cold]
    fn set_shape(&mut self, frame: &Frame, shape: [u8; 4]) {
        self.shape = shape;
        self.header = FrameHeader::header_of(frame.id, FrameShape::shape_of(frame));
        self.mask = payload_mask(self.header.length);
        self.payload = payload_number(frame, self.mask);
        self.bits = self.header.count_bits(self.payload);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bits(id: CanId, data: &[u8]) -> u32 {
        frame_bits(&Frame::data_frame(id, data)).unwrap()
    }

    #[test]
    fn lengths_are_between_no_and_maximum_stuffing() {
        // 47 + 8n bits without stuffing, plus up to floor((34 + 8n − 1) / 4); 67 and 54 for 29 bits.
        for length in 0..=8_u32 {
            let data: Vec<u8> = (0..length).map(|n| 0x55 ^ u8::try_from(n).unwrap()).collect();
            let plain = 47 + 8 * length;
            let most = plain + (34 + 8 * length - 1) / 4;
            assert!((plain..=most).contains(&bits(CanId::from_standard(0x555), &data)));
            let zeros = bits(CanId::from_standard(0), &vec![0; length as usize]);
            assert!((plain + 4..=most).contains(&zeros), "{length}: {zeros}");
            let plain = 67 + 8 * length;
            let most = plain + (54 + 8 * length - 1) / 4;
            assert!((plain..=most).contains(&bits(CanId::from_extended(0x1555_5555), &data)));
        }
    }

    /// Bit by bit, as in the standard.
    fn slowly(frame: &Frame) -> u32 {
        let mut bits = vec![false];
        let mut push =
            |value: u32, width: u32| bits.extend((0..width).rev().map(|place| value >> place & 1 != 0));
        let remote = u32::from(frame.flags.contains(FrameFlags::REMOTE));
        match frame.id {
            CanId::Standard(id) => push(u32::from(id) << 3 | remote << 2, 14),
            CanId::Extended(id) => {
                push(id >> 18, 11);
                push(0b11, 2);
                push(id, 18);
                push(remote << 2, 3);
            }
        }
        push(u32::from(if frame.raw_dlc > 8 { frame.raw_dlc } else { frame.length }), 4);
        frame.data().iter().for_each(|byte| push(u32::from(*byte), 8));
        let crc = bits.iter().fold(0, |crc, bit| crc_step(crc, *bit));
        bits.extend((0..15).rev().map(|place| crc >> place & 1 != 0));
        let (mut count, mut last, mut run) = (0, None, 0);
        for bit in bits {
            count += 1;
            run = if last == Some(bit) { run + 1 } else { 1 };
            last = Some(bit);
            if run == 5 {
                (count, last, run) = (count + 1, Some(!bit), 1);
            }
        }
        count + UNSTUFFED
    }

    proptest::proptest! {
        #[test]
        fn tables_count_as_bits_do(
            id: u32,
            is_long: bool,
            frames in proptest::collection::vec(
                (proptest::collection::vec(0_u8.., 0..=8), 0_u8..16, proptest::bool::ANY, 0_u8..3), 1..6
            ),
        ) {
            let id = if is_long { CanId::from_extended(id) } else { CanId::from_standard((id & 0x7FF) as u16) };
            let mut last = LastFrameBits::default();
            for (data, raw_dlc, is_remote, repeats) in frames {
                let raw_dlc = if data.len() == 8 { raw_dlc } else { 0 };
                let mut frame = Frame { raw_dlc, ..Frame::data_frame(id, &data) };
                if is_remote {
                    frame.flags = FrameFlags::REMOTE;
                }
                // Bytes after the data do not count.
                frame.bytes[8..].fill(0x55);
                frame.bytes[data.len()..].iter_mut().for_each(|byte| *byte |= raw_dlc);
                let expected = Some(slowly(&frame));
                proptest::prop_assert_eq!(frame_bits(&frame), expected);
                for _ in 0..=repeats {
                    proptest::prop_assert_eq!(last.count_bits(&frame), expected);
                }
            }
        }
    }

    #[test]
    fn frames_without_a_known_length_have_no_bits() {
        let mut last = LastFrameBits::default();
        let frame = Frame::data_frame(CanId::from_standard(0x555), &[]);
        for flags in [FrameFlags::FD, FrameFlags::ERROR] {
            let frame = Frame { flags, ..frame };
            assert_eq!((frame_bits(&frame), last.count_bits(&frame)), (None, None));
        }
        assert_eq!(last.count_bits(&frame), Some(48));
    }

    #[test]
    fn a_frame_counted_by_hand() {
        // 0x555, no data: 0 10101010101 0 0 0 0000 and CRC. After the last 1 of the identifier there are
        // seven zeros, so one stuff bit after five of them. The CRC of these 19 bits is 0x674C
        // (110011101001100); it needs no stuff bit.
        assert_eq!(bits(CanId::from_standard(0x555), &[]), 47 + 1);
    }
}
