//! How long a frame is on the wire: exact for classic frames (ISO 11898-1 §10.4, §10.5).
//!
//! ```text
//! SOF identifier RTR IDE r0 DLC data CRC │ delimiter ACK EOF intermission
//! └──── a stuff bit after five equal ──┘ │ └──── 13 bits, never stuffed ─┘
//! ```

use crate::frame::{CanId, Frame, FrameFlags};

/// CRC delimiter, ACK slot and delimiter, seven bits of end of frame, three of intermission.
const UNSTUFFED: u32 = 1 + 2 + 7 + 3;

/// Counts bits as they go over the wire.
#[derive(Default)]
struct Wire {
    crc: u16,
    bits: u32,
    last: Option<bool>,
    run: u8,
}

impl Wire {
    fn send(&mut self, value: u32, width: u32) {
        for place in (0..width).rev() {
            let bit = value >> place & 1 != 0;
            // CRC-15: x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1.
            let carry = (self.crc >> 14 & 1 != 0) != bit;
            self.crc = self.crc << 1 & 0x7FFF;
            if carry {
                self.crc ^= 0x4599;
            }
            self.stuff(bit);
        }
    }

    fn stuff(&mut self, bit: bool) {
        self.bits += 1;
        self.run = if self.last == Some(bit) { self.run + 1 } else { 1 };
        self.last = Some(bit);
        if self.run == 5 {
            // The stuff bit is the opposite and begins a run of its own.
            self.bits += 1;
            self.last = Some(!bit);
            self.run = 1;
        }
    }

    fn finish(mut self) -> u32 {
        let crc = u32::from(self.crc);
        for place in (0..15).rev() {
            self.stuff(crc >> place & 1 != 0);
        }
        self.bits + UNSTUFFED
    }
}

/// Bits of a frame with intermission; `None` for FD and error frames.
pub fn frame_bits(frame: &Frame) -> Option<u32> {
    if frame.flags.0 & (FrameFlags::FD.0 | FrameFlags::ERROR.0) != 0 {
        return None;
    }
    let remote = u32::from(frame.flags.contains(FrameFlags::REMOTE));
    let mut wire = Wire::default();
    wire.send(0, 1);
    match frame.id {
        CanId::Standard(id) => {
            wire.send(u32::from(id), 11);
            wire.send(remote << 2, 3);
        }
        CanId::Extended(id) => {
            wire.send(id >> 18, 11);
            wire.send(0b11, 2);
            wire.send(id, 18);
            wire.send(remote << 2, 3);
        }
    }
    let dlc = if frame.raw_dlc > 8 { frame.raw_dlc } else { frame.length.min(8) };
    wire.send(u32::from(dlc), 4);
    for byte in frame.data().iter().take(8) {
        wire.send(u32::from(*byte), 8);
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
    fn lengths_lie_between_none_stuffed_and_all_stuffed() {
        // 47 + 8n bits without stuffing, floor((34 + 8n − 1) / 4) more at most; 67 and 54 for 29 bits.
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

    #[test]
    fn a_frame_counted_by_hand() {
        // 0x555, no data: 0 10101010101 0 0 0 0000 and CRC. Behind the identifier's last 1 come seven
        // zeros, so one stuff bit after five of them; the CRC of these 19 bits is 0x674C
        // (110011101001100), which needs none.
        assert_eq!(bits(CanId::standard(0x555), &[]), 47 + 1);
    }
}
