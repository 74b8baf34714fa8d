//! Frames of NMEA 2000 fast packets.

use crate::wire::Malformed;

/// Max bytes of a fast packet: 6 in frame 0 and 7 in each of 31 more.
pub(crate) const FAST_PACKET_SIZE: u8 = 6 + 31 * 7;

/// Contents of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct FastFrame<'a> {
    /// Sequence counter 0..=7, equal in all frames of a packet.
    pub(crate) sequence: u8,
    /// Number of the frame, 0..=31.
    pub(crate) number: u8,
    /// Length of the packet; 0 except in frame 0.
    pub(crate) length: u8,
    /// Data of the frame, possibly with padding.
    pub(crate) data: &'a [u8],
    /// Bytes of data in a full frame: 6 in frame 0, 7 in others.
    pub(crate) full: u8,
}

/// Reads a frame.
///
/// # Errors
/// If the counter or the length is missing, or the length exceeds that of a fast packet (`needed` is 0).
pub(crate) fn fast_frame(payload: &[u8]) -> Result<FastFrame<'_>, Malformed> {
    let error = |offset, needed| Malformed {
        layer: "fast-packet",
        offset,
        needed,
        available: u8::try_from(payload.len()).unwrap_or(u8::MAX),
    };
    let Some((counter, rest)) = payload.split_first() else { return Err(error(0, 1)) };
    let (sequence, number) = (counter >> 5, counter & 0x1F);
    if number > 0 {
        return Ok(FastFrame { sequence, number, length: 0, data: rest, full: 7 });
    }
    match rest.split_first() {
        Some((length, data)) if *length <= FAST_PACKET_SIZE => {
            Ok(FastFrame { sequence, number, length: *length, data, full: 6 })
        }
        Some(_) => Err(error(1, 0)),
        None => Err(error(1, 2)),
    }
}

/// Frames of a packet of `length` bytes.
pub(crate) fn fast_frames_of(length: u8) -> u32 {
    1 + u32::from(length.saturating_sub(6)).div_ceil(7)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counter_and_length() {
        // 60: sequence 3, frame 0; 1A: 26 bytes, which need 1 + 20 / 7 = 4 frames.
        let first = fast_frame(&[0x60, 0x1A, 0, 0xB7, 6, 0x67, 0x0D, 0x0B]).unwrap();
        assert_eq!((first.sequence, first.number, first.length, first.data.len()), (3, 0, 26, 6));
        let next = fast_frame(&[0x61, 1, 2, 3, 4, 5, 6, 7]).unwrap();
        assert_eq!((next.sequence, next.number, next.length, next.data.len()), (3, 1, 0, 7));
        assert_eq!([0, 6, 7, 13, 14, 26, 223].map(fast_frames_of), [1, 1, 2, 2, 3, 4, 32]);
    }

    #[test]
    fn frames_that_are_too_short_or_announce_too_much() {
        assert_eq!(fast_frame(&[]).unwrap_err().needed, 1);
        assert_eq!(fast_frame(&[0x40]).unwrap_err().needed, 2);
        assert!(fast_frame(&[0x41]).is_ok_and(|frame| frame.data.is_empty()));
        assert!(fast_frame(&[0x40, 223]).is_ok());
        let error = fast_frame(&[0x40, 224, 1]).unwrap_err();
        assert_eq!((error.offset, error.needed, error.available), (1, 0, 3));
    }
}
