//! How an object is told from other bytes.
//!
//! ```text
//!  0 LOBJ   4 size of the header (2)   6 its version (2)   8 size of the object (4)   12 kind (4)
//! 16 flags (4): unit of time   24 time (8)   then what else the version has, up to the body
//! ```
//! Behind an object stand up to three bytes that fill up: how many depends on the writer.

use crate::capture::byte_order::ByteOrder::Little;

/// Title of the format.
pub(super) const TITLE: &str = "Vector BLF";

/// Bytes that all objects begin with.
pub(super) const BASE: usize = 16;

/// Bytes that may fill up behind an object.
pub(super) const FILL: usize = 3;

/// Longest header, and largest kind and size that are believed: 133 kinds are known, and containers hold
/// 128 KiB as Vector's programs write them.
const LONGEST_HEADER: u16 = 256;
const LAST_VERSION: u16 = 3;
const LAST_KIND: u32 = 0x3FF;
const LARGEST: u32 = 64 * 1024 * 1024;

const MAGIC: &[u8; 4] = b"LOBJ";

/// What an object's first bytes say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Head {
    /// Bytes before the body.
    pub(super) header: usize,
    /// Bytes in all.
    pub(super) size: usize,
    /// What it is.
    pub(super) kind: u32,
}

/// What stands at a place.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// An object.
    Object(Head),
    /// So many bytes that are none, at least one.
    Gap(usize),
    /// Too few bytes to tell, or none.
    More,
}

/// Looks at the beginning of `rest`.
pub(super) fn find(rest: &[u8]) -> Found {
    let mut gap = 0;
    loop {
        let here = rest.get(gap..).unwrap_or_default();
        let may_go_on = here.len() < BASE && here.iter().zip(MAGIC).all(|(found, magic)| found == magic);
        match head(here) {
            Some(head) if gap == 0 => return Found::Object(head),
            None if may_go_on && gap == 0 => return Found::More,
            Some(_) => return Found::Gap(gap),
            None if may_go_on => return Found::Gap(gap),
            None => {}
        }
        // An object cannot begin before the next of its first bytes.
        let next = here.get(1..).and_then(|behind| memchr::memchr(b'L', behind));
        gap = next.map_or(rest.len(), |next| gap + 1 + next);
    }
}

/// Whether an object follows at the end of one, or behind what fills up; `true` if that cannot be seen.
pub(super) fn is_followed(rest: &[u8], size: usize) -> bool {
    let Some(behind) = rest.get(size..) else { return true };
    let window = behind.get(..FILL + MAGIC.len()).unwrap_or(behind);
    window.len() < FILL + MAGIC.len() || memchr::memmem::find(window, MAGIC).is_some()
}

fn head(bytes: &[u8]) -> Option<Head> {
    if !bytes.starts_with(MAGIC) {
        return None;
    }
    let (header, version) = (Little.u16(bytes, 4)?, Little.u16(bytes, 6)?);
    let (size, kind) = (Little.u32(bytes, 8)?, Little.u32(bytes, 12)?);
    let is_plausible = (BASE..=usize::from(LONGEST_HEADER)).contains(&usize::from(header))
        && (1..=LAST_VERSION).contains(&version)
        && (u32::from(header)..=LARGEST).contains(&size)
        && kind <= LAST_KIND;
    let size = usize::try_from(size).ok()?;
    is_plausible.then_some(Head { header: header.into(), size, kind })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: [u8; BASE] = *b"LOBJ\x20\0\x01\0\x30\0\0\0\x01\0\0\0";

    #[test]
    fn an_object_is_found_behind_other_bytes() {
        let head = Head { header: 32, size: 48, kind: 1 };
        assert_eq!(find(&HEAD), Found::Object(head));
        assert_eq!(find(&[&b"\0L\0LOBJ...............LO"[..], &HEAD].concat()), Found::Gap(24));
        assert_eq!(find(b"nothing"), Found::Gap(7));
        assert_eq!(find(b"nothing LO"), Found::Gap(8));
        assert_eq!(find(b"LO"), Found::More);
        assert_eq!(find(&HEAD[..15]), Found::More);
        assert_eq!(find(b""), Found::More);
    }

    #[test]
    fn what_cannot_be_an_object_is_none() {
        for (at, byte) in [(4, 15), (6, 0), (6, 4), (8, 31), (11, 5), (13, 4)] {
            let mut bytes = HEAD;
            bytes[at] = byte;
            assert_eq!(find(&bytes), Found::Gap(BASE), "{at} = {byte}");
        }
    }

    #[test]
    fn an_object_is_followed_by_another_or_by_the_end() {
        let two = [&[0; 8][..], b"\0\0", &HEAD].concat();
        assert!(is_followed(&two, 8) && is_followed(&two[..9], 8) && is_followed(&two, 100));
        assert!(!is_followed(&two, 2));
    }
}
