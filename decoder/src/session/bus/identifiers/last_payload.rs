//! Payload of the last frame of an identifier, for comparison with the next one.

use crate::frame::{Frame, FrameFlags, low_bits};

/// Payload of the last data frame of an identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::session) struct LastPayload {
    /// Little-endian; unused bytes are 0.
    word: u64,
    /// Bits of the used bytes.
    used: u64,
    /// Length in bytes, at most 8; [`UNKNOWN`] before the first frame and after a frame without such a payload.
    length: u8,
}

const UNKNOWN: u8 = u8::MAX;

/// Maximum length that can be compared.
const LONGEST: u8 = 8;

impl LastPayload {
    /// Before the first frame.
    pub(in crate::session) const NONE: Self = Self { word: 0, used: 0, length: UNKNOWN };

    /// Payload of a frame; [`Self::NONE`] for a remote frame and for more than eight bytes.
    #[inline]
    pub(in crate::session) fn payload_of(frame: &Frame) -> Self {
        match frame.bytes.first_chunk() {
            Some(bytes) if frame.length <= LONGEST && !frame.flags.contains(FrameFlags::REMOTE) => {
                let used = low_bits(8 * u32::from(frame.length));
                Self { word: u64::from_le_bytes(*bytes) & used, used, length: frame.length }
            }
            _ => Self::NONE,
        }
    }

    /// Bits in which the next payload differs; `None` if the lengths differ or one of them is unknown.
    #[inline]
    pub(in crate::session) fn changed_bits(self, next: Self) -> Option<u64> {
        (self.length == next.length && self.length != UNKNOWN).then_some(self.word ^ next.word)
    }

    /// Payload and changed bits of a classic data frame that has the length of the last one; `None` for other frames.
    #[inline]
    pub(in crate::session) fn next(&self, frame: &Frame) -> Option<(u64, u64)> {
        let bytes = frame.bytes.first_chunk().filter(|_| frame.length == self.length)?;
        let word = u64::from_le_bytes(*bytes) & self.used;
        frame.flags.is_classic_data().then_some((word, word ^ self.word))
    }

    /// The payload, little-endian; unused bytes are 0.
    pub(in crate::session) fn word(&self) -> u64 {
        self.word
    }

    /// Takes the next payload of the same length.
    #[inline]
    pub(in crate::session) fn set_word(&mut self, word: u64) {
        self.word = word;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    fn frame(data: &[u8]) -> Frame {
        Frame::data_frame(CanId::from_standard(0x181), data)
    }

    fn payload(data: &[u8]) -> LastPayload {
        LastPayload::payload_of(&frame(data))
    }

    #[test]
    fn changed_bits_of_payloads_with_equal_length() {
        assert_eq!(payload(&[1, 2]).changed_bits(payload(&[1, 2])), Some(0));
        assert_eq!(payload(&[1, 2]).changed_bits(payload(&[3, 2])), Some(2));
        assert_eq!(payload(&[0; 8]).changed_bits(payload(&[0, 0, 0, 0, 0, 0, 0, 0x80])), Some(1 << 63));
        assert_eq!(payload(&[]).changed_bits(payload(&[])), Some(0));
        assert_eq!(payload(&[1]).changed_bits(payload(&[1, 0])), None);
        assert_eq!(LastPayload::NONE.changed_bits(payload(&[])), None);
        assert_eq!(payload(&[0; 9]), LastPayload::NONE);
    }

    #[test]
    fn bytes_beyond_the_length_are_not_compared() {
        let mut short = frame(&[1, 2, 3]);
        short.length = 2;
        assert_eq!(payload(&[1, 2]).changed_bits(LastPayload::payload_of(&short)), Some(0));
        assert_eq!(payload(&[1, 2]).next(&short), Some((0x0201, 0)));
        short.flags = FrameFlags::REMOTE;
        assert_eq!(LastPayload::payload_of(&short), LastPayload::NONE);
    }

    #[test]
    fn only_a_classic_data_frame_of_the_same_length_follows() {
        let last = payload(&[1, 2]);
        assert_eq!(last.next(&frame(&[1, 6])), Some((0x0601, 0x0400)));
        assert_eq!(last.next(&frame(&[1])), None);
        assert_eq!(last.next(&Frame { flags: FrameFlags::FD, ..frame(&[1, 2]) }), None);
        assert_eq!(LastPayload::NONE.next(&frame(&[0; 9])), None);
    }
}
