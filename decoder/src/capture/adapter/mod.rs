//! The wire text of adapters and servers that hand over a live bus: bytes to replies, commands to bytes.
//!
//! Nothing here opens or waits. Commands are types of their own, which cannot say anything that would put
//! a frame on a bus.

pub mod slcan;
pub mod socketcand;

/// What has come of a reply whose end has not: bounded, so that rubbish without an end takes no memory.
#[derive(Debug, Clone, Default)]
struct Begun {
    bytes: Vec<u8>,
    is_too_long: bool,
}

impl Begun {
    /// Takes `piece` as far as `limit` bytes in all allow.
    fn add(&mut self, piece: &[u8], limit: usize) {
        let room = limit.saturating_sub(self.bytes.len());
        self.is_too_long |= piece.len() > room;
        self.bytes.extend_from_slice(piece.get(..room).unwrap_or(piece));
    }

    /// Forgets it; keeps the memory.
    fn clear(&mut self) {
        self.bytes.clear();
        self.is_too_long = false;
    }
}

/// The number that these hexadecimal digits are, at most eight of them.
fn hexadecimal(digits: &[u8]) -> Option<u32> {
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
        let mut begun = Begun::default();
        begun.add(b"abc", 5);
        begun.add(b"de", 5);
        assert_eq!((&begun.bytes[..], begun.is_too_long), (&b"abcde"[..], false));
        begun.add(b"f", 5);
        assert_eq!((&begun.bytes[..], begun.is_too_long), (&b"abcde"[..], true));
        begun.clear();
        assert_eq!((begun.bytes.len(), begun.is_too_long), (0, false));
    }

    #[test]
    fn hexadecimal_numbers_have_one_to_eight_digits() {
        assert_eq!(hexadecimal(b"1fFFffFF"), Some(0x1FFF_FFFF));
        assert_eq!(hexadecimal(b"EA5F"), Some(59_999));
        for bad in ["", "123456789", "12G", "+1", " 1"] {
            assert_eq!(hexadecimal(bad.as_bytes()), None, "{bad}");
        }
    }
}
