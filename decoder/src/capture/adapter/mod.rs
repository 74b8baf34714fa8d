//! Adapters and servers for a live bus: parsing of replies, encoding of commands, reports of drivers.
//!
//! This module does no I/O. The command types have no variant that transmits a frame on a bus.

pub mod driver;
pub mod slcan;
pub mod socketcand;

/// Beginning of a reply that is still incomplete. Bounded, so that garbage without an end uses no memory.
#[derive(Debug, Clone, Default)]
struct PendingReply {
    bytes: Vec<u8>,
    is_too_long: bool,
}

impl PendingReply {
    /// Appends `piece`, up to `limit` bytes in total.
    fn append_piece(&mut self, piece: &[u8], limit: usize) {
        let room = limit.saturating_sub(self.bytes.len());
        self.is_too_long |= piece.len() > room;
        self.bytes.extend_from_slice(piece.get(..room).unwrap_or(piece));
    }

    /// Clears the content; keeps the memory.
    fn clear(&mut self) {
        self.bytes.clear();
        self.is_too_long = false;
    }
}

/// Value of at most eight hexadecimal digits; `None` if a digit is invalid or none is present.
fn parse_hexadecimal(digits: &[u8]) -> Option<u32> {
    if digits.is_empty() || digits.len() > 8 {
        return None;
    }
    digits.iter().try_fold(0_u32, |value, digit| Some(value << 4 | char::from(*digit).to_digit(16)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_has_begun_is_kept_up_to_its_limit() {
        let mut begun = PendingReply::default();
        begun.append_piece(b"abc", 5);
        begun.append_piece(b"de", 5);
        assert_eq!((&begun.bytes[..], begun.is_too_long), (&b"abcde"[..], false));
        begun.append_piece(b"f", 5);
        assert_eq!((&begun.bytes[..], begun.is_too_long), (&b"abcde"[..], true));
        begun.clear();
        assert_eq!((begun.bytes.len(), begun.is_too_long), (0, false));
    }

    #[test]
    fn hexadecimal_numbers_have_one_to_eight_digits() {
        assert_eq!(parse_hexadecimal(b"1fFFffFF"), Some(0x1FFF_FFFF));
        assert_eq!(parse_hexadecimal(b"EA5F"), Some(59_999));
        for bad in ["", "123456789", "12G", "+1", " 1"] {
            assert_eq!(parse_hexadecimal(bad.as_bytes()), None, "{bad}");
        }
    }
}
