//! Frames of NMEA 2000 fast packets.

use nom::Parser;
use nom::combinator::verify;
use nom::number::complete::u8 as byte;

use crate::wire::MalformedPayload;
use crate::wire::parser::{Parsed, bit_field, parse_message};

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
/// If the counter or the length is missing, or the length exceeds that of a fast packet (`needed` is 0). The
/// error counts all bytes from the start of the frame.
pub(crate) fn fast_frame(payload: &[u8]) -> Result<FastFrame<'_>, MalformedPayload> {
    parse_message("fast-packet", payload, parse_frame).map_err(
        |MalformedPayload { layer, offset, needed, available }| {
            let needed = if needed == 0 { 0 } else { needed.saturating_add(offset) };
            MalformedPayload { layer, offset, needed, available: available.saturating_add(offset) }
        },
    )
}

#[inline]
fn parse_frame(payload: &[u8]) -> Parsed<'_, FastFrame<'_>> {
    let (rest, counter) = byte(payload)?;
    let (sequence, number) = (bit_field(counter, 5, 3), bit_field(counter, 0, 5));
    if number > 0 {
        return Ok((rest, FastFrame { sequence, number, length: 0, data: rest, full: 7 }));
    }
    let (data, length) = verify(byte, |length| *length <= FAST_PACKET_SIZE).parse(rest)?;
    Ok((data, FastFrame { sequence, number, length, data, full: 6 }))
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
