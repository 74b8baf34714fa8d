//! Length and payload of frames in formats with a number before the bytes: a DLC, a length, or either.

use super::columns::{NumberBase, parse_data, parse_identifier};
use crate::frame::{CanId, Frame, FrameFlags, MAX_DATA, fd_length, is_fd_length};

/// Expected content if the data do not match the length.
pub(in crate::capture) const SHORT: &str = "data: fewer bytes than the length";

/// Expected content if the length is invalid.
pub(in crate::capture) const LENGTH: &str = "length: expected a valid length of the frame type";

/// Expected content if a hexadecimal identifier is invalid.
pub(in crate::capture) const IDENTIFIER: &str =
    "identifier: expected hex digits, up to 7FF or extended up to 1FFFFFFF";

/// Length, and the DLC of a classic frame if above 8, from a DLC.
pub(in crate::capture) fn by_dlc(dlc: u8, flags: FrameFlags) -> Option<(u8, u8)> {
    match dlc {
        0..=8 => Some((dlc, 0)),
        9..=15 if flags.contains(FrameFlags::FD) => Some((fd_length(dlc), 0)),
        9..=15 => Some((8, dlc)),
        _ => None,
    }
}

/// Length, and a DLC of 0, from a length in bytes.
pub(in crate::capture) fn by_length(length: u8, flags: FrameFlags) -> Option<(u8, u8)> {
    let most = if flags.contains(FrameFlags::FD) { 64 } else { 8 };
    (length <= most && is_fd_length(length)).then_some((length, 0))
}

/// Length and DLC from a DLC or a length; the number of data bytes decides which one it is.
pub(in crate::capture) fn by_either(number: u8, there: usize, flags: FrameFlags) -> Option<(u8, u8)> {
    let fits = |(length, _): &(u8, u8)| usize::from(*length) == there;
    let (dlc, length) = (by_dlc(number, flags), by_length(number, flags));
    dlc.filter(fits).or(length.filter(fits)).or(dlc).or(length)
}

/// An identifier whose type is determined by its value only.
pub(in crate::capture) fn by_size(number: u32) -> Option<CanId> {
    parse_identifier(number, number > 0x7FF)
}

/// Parses a hexadecimal number, with or without 0x.
pub(in crate::capture) fn parse_hex(word: &[u8]) -> Option<u32> {
    NumberBase::Hex.parse_number(word.strip_prefix(b"0x").or(word.strip_prefix(b"0X")).unwrap_or(word))
}

/// Builds a frame whose data are the next words; a remote frame needs none.
pub(in crate::capture) fn build_frame<'a>(
    id: CanId,
    flags: FrameFlags,
    (length, raw_dlc): (u8, u8),
    words: impl Iterator<Item = &'a [u8]>,
    base: NumberBase,
) -> Option<Frame> {
    let count = if flags.contains(FrameFlags::REMOTE) { 0 } else { usize::from(length) };
    let bytes = parse_data(words, count, base)?;
    Some(Frame { id, flags, length, raw_dlc, bytes, ..Frame::EMPTY })
}

/// Builds a frame whose data are all words. More than eight words are an FD frame; these formats have no
/// other sign of FD.
pub(in crate::capture) fn frame_of_all<'a>(
    id: CanId,
    flags: FrameFlags,
    words: impl Iterator<Item = &'a [u8]> + Clone,
) -> Option<Frame> {
    let there = u8::try_from(words.clone().take(MAX_DATA + 1).count()).ok()?;
    let flags = if there > 8 { flags.with(FrameFlags::FD) } else { flags };
    build_frame(id, flags, by_length(there, flags)?, words, NumberBase::Hex)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::text::columns::ColumnWords;

    #[test]
    fn a_number_is_a_dlc_a_length_or_what_the_bytes_say() {
        let (classic, fd) = (FrameFlags(0), FrameFlags::FD);
        assert_eq!(by_dlc(13, classic), Some((8, 13)));
        assert_eq!(by_dlc(13, fd), Some((32, 0)));
        assert_eq!(by_dlc(16, fd), None);
        assert_eq!(by_length(12, classic), None);
        assert_eq!(by_length(12, fd), Some((12, 0)));
        assert_eq!(by_length(13, fd), None);
        assert_eq!(by_either(12, 12, fd), Some((12, 0)));
        assert_eq!(by_either(12, 24, fd), Some((24, 0)));
        assert_eq!(by_either(64, 64, fd), Some((64, 0)));
        assert_eq!(by_either(9, 8, classic), Some((8, 9)));
    }

    #[test]
    fn all_words_are_the_payload() {
        let id = CanId::from_standard(1);
        let frame = frame_of_all(id, FrameFlags(0), ColumnWords::new(b"01 A")).unwrap();
        assert_eq!((frame.data(), frame.flags), (&[1, 10][..], FrameFlags(0)));
        let words = [&b"5A"[..]; 12];
        let frame = frame_of_all(id, FrameFlags(0), words.into_iter()).unwrap();
        assert_eq!((frame.length, frame.flags), (12, FrameFlags::FD));
        assert_eq!(frame_of_all(id, FrameFlags(0), [&b"5A"[..]; 9].into_iter()), None);
        assert_eq!(frame_of_all(id, FrameFlags(0), [&b"5A"[..]; 300].into_iter()), None);
        assert_eq!(frame_of_all(id, FrameFlags(0), ColumnWords::new(b"01 x")), None);
    }
}
