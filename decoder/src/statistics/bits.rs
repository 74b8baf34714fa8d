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

/// CRC after one byte, for a register whose other bits are zero.
static CRC: [u16; 256] = crc_table();

/// Number of stuff bits for a byte, and the next state, by the current state.
static STUFF: [[(u8, u8); 256]; STATES] = stuff_table();

#[expect(clippy::cast_possible_truncation, clippy::indexing_slicing, reason = "evaluated at compile time")]
const fn crc_table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = (byte as u16) << 7;
        let mut bit = 0;
        while bit < 8 {
            crc = crc_step(crc, false);
            bit += 1;
        }
        table[byte] = crc;
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
const fn stuff_table() -> [[(u8, u8); 256]; STATES] {
    let mut table = [[(0, 0); 256]; STATES];
    let mut state = 0;
    while state < STATES {
        let mut byte = 0;
        while byte < 256 {
            let (mut stuffed, mut now) = (0, state);
            let mut place = 8;
            while place > 0 {
                place -= 1;
                let (more, next) = stuff_step(now, byte >> place & 1 != 0);
                stuffed += more;
                now = next;
            }
            table[state][byte] = (stuffed, now as u8);
            byte += 1;
        }
        state += 1;
    }
    table
}

/// Next state: 0 is the start, 1 to 4 a run of that many zeros, 5 to 8 a run of 1 to 4 ones.
const fn stuff_step(state: usize, bit: bool) -> (u8, usize) {
    let (last, run) = if state > 4 { (true, state - 4) } else { (false, state) };
    let run = if run > 0 && last == bit { run + 1 } else { 1 };
    // The stuff bit has the opposite value and starts a new run.
    let (stuffed, bit, run) = if run == LONGEST_RUN { (1, !bit, 1) } else { (0, bit, run) };
    (stuffed, if bit { run + 4 } else { run })
}

/// Counter for bits on the wire.
#[derive(Default)]
struct Wire {
    crc: u16,
    bits: u32,
    state: usize,
}

impl Wire {
    /// Sends the lowest `width` bits, most significant bit first.
    fn send(&mut self, value: u32, width: u32) {
        let whole = width / 8 * 8;
        for place in (whole..width).rev() {
            let bit = value >> place & 1 != 0;
            self.crc = crc_step(self.crc, bit);
            self.stuff(bit);
        }
        for place in (0..whole / 8).rev() {
            let [.., byte] = (value >> (place * 8)).to_be_bytes();
            self.byte(byte);
        }
    }

    fn byte(&mut self, byte: u8) {
        let [.., front] = (self.crc >> 7).to_be_bytes();
        self.crc = self.crc << 8 & 0x7FFF ^ CRC.get(usize::from(front ^ byte)).copied().unwrap_or(0);
        self.stuff_byte(byte);
    }

    fn stuff(&mut self, bit: bool) {
        let (stuffed, state) = stuff_step(self.state, bit);
        self.bits += 1 + u32::from(stuffed);
        self.state = state;
    }

    fn stuff_byte(&mut self, byte: u8) {
        let row = STUFF.get(self.state).and_then(|row| row.get(usize::from(byte)));
        let (stuffed, state) = row.copied().unwrap_or((0, 0));
        self.bits += 8 + u32::from(stuffed);
        self.state = usize::from(state);
    }

    fn finish(mut self) -> u32 {
        let [high, low] = self.crc.to_be_bytes();
        for place in (0..7).rev() {
            self.stuff(high >> place & 1 != 0);
        }
        self.stuff_byte(low);
        self.bits + UNSTUFFED
    }
}

/// Number of bits of a frame including intermission; `None` for FD and error frames.
pub fn frame_bits(frame: &Frame) -> Option<u32> {
    if frame.flags.0 & (FrameFlags::FD.0 | FrameFlags::ERROR.0) != 0 {
        return None;
    }
    let remote = u32::from(frame.flags.contains(FrameFlags::REMOTE));
    let dlc = u32::from(if frame.raw_dlc > 8 { frame.raw_dlc } else { frame.length.min(8) });
    let mut wire = Wire::default();
    match frame.id {
        // SOF, identifier, RTR, IDE, r0, DLC.
        CanId::Standard(id) => wire.send(u32::from(id) << 7 | remote << 6 | dlc, 19),
        CanId::Extended(id) => {
            // SOF, eleven bits, SRR, IDE; eighteen bits, RTR, r1, r0, DLC.
            wire.send(id >> 18 << 2 | 0b11, 14);
            wire.send((id & 0x3_FFFF) << 7 | remote << 6 | dlc, 25);
        }
    }
    for byte in frame.data().iter().take(8) {
        wire.byte(*byte);
    }
    Some(wire.finish())
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
            assert!((plain..=most).contains(&bits(CanId::standard(0x555), &data)));
            let zeros = bits(CanId::standard(0), &vec![0; length as usize]);
            assert!((plain + 4..=most).contains(&zeros), "{length}: {zeros}");
            let plain = 67 + 8 * length;
            let most = plain + (54 + 8 * length - 1) / 4;
            assert!((plain..=most).contains(&bits(CanId::extended(0x1555_5555), &data)));
        }
    }

    /// Bit by bit, as in the standard.
    fn slowly(frame: &Frame) -> u32 {
        let mut bits = vec![false];
        let mut push =
            |value: u32, width: u32| bits.extend((0..width).rev().map(|place| value >> place & 1 != 0));
        match frame.id {
            CanId::Standard(id) => push(u32::from(id) << 3, 14),
            CanId::Extended(id) => {
                push(id >> 18, 11);
                push(0b11, 2);
                push(id, 18);
                push(0, 3);
            }
        }
        push(u32::from(frame.length), 4);
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
        fn tables_count_as_bits_do(id: u32, is_long: bool, data in proptest::collection::vec(0_u8.., 0..=8)) {
            let id = if is_long { CanId::extended(id) } else { CanId::standard((id & 0x7FF) as u16) };
            let frame = Frame::data_frame(id, &data);
            proptest::prop_assert_eq!(frame_bits(&frame), Some(slowly(&frame)));
        }
    }

    #[test]
    fn a_frame_counted_by_hand() {
        // 0x555, no data: 0 10101010101 0 0 0 0000 and CRC. After the last 1 of the identifier there are
        // seven zeros, so one stuff bit after five of them. The CRC of these 19 bits is 0x674C
        // (110011101001100); it needs no stuff bit.
        assert_eq!(bits(CanId::standard(0x555), &[]), 47 + 1);
    }
}
