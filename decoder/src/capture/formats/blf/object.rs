//! Detection of objects.
//!
//! ```text
//!  0 LOBJ   4 size of the header (2)   6 version of the header (2)   8 size of the object (4)   12 type (4)
//! 16 flags (4): unit of time   24 time (8)   then fields of the version, up to the body
//! ```
//! Up to three fill bytes follow an object, depending on the writer.

use crate::capture::byte_order::ByteOrder::Little;

/// Title of the format.
pub(super) const TITLE: &str = "Vector BLF";

/// Size of the part of the header that all objects have, in bytes.
pub(super) const BASE: usize = 16;

/// Maximum number of fill bytes after an object.
pub(super) const FILL: usize = 3;

/// Plausibility limits of an object: header size, version, type and size. 133 types are known; Vector's
/// programs write containers of 128 KiB.
const LONGEST_HEADER: u16 = 256;
const LAST_VERSION: u16 = 3;
const LAST_KIND: u32 = 0x3FF;
const LARGEST: u32 = 64 * 1024 * 1024;

const MAGIC: &[u8; 4] = b"LOBJ";

/// Header of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ObjectHeader {
    /// Size of the header in bytes.
    pub(super) header: usize,
    /// Size of the object in bytes, with its header.
    pub(super) size: usize,
    /// Object type.
    pub(super) kind: u32,
}

/// Content found at a position.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum ObjectContent {
    Object(ObjectHeader),
    /// Number of bytes, at least one, that are not part of an object.
    Gap(usize),
    /// Too few bytes to decide, or none.
    More,
}

/// Determines what `rest` begins with.
pub(super) fn find_object(rest: &[u8]) -> ObjectContent {
    let mut gap = 0;
    loop {
        let here = rest.get(gap..).unwrap_or_default();
        let may_go_on = here.len() < BASE && here.iter().zip(MAGIC).all(|(found, magic)| found == magic);
        match parse_header(here) {
            Some(head) if gap == 0 => return ObjectContent::Object(head),
            None if may_go_on && gap == 0 => return ObjectContent::More,
            Some(_) => return ObjectContent::Gap(gap),
            None if may_go_on => return ObjectContent::Gap(gap),
            None => {}
        }
        // An object cannot begin before the next `L`.
        let next = here.get(1..).and_then(|behind| memchr::memchr(b'L', behind));
        gap = next.map_or(rest.len(), |next| gap + 1 + next);
    }
}

/// Whether an object follows after `size` bytes, with optional fill bytes; `true` if more input is needed to
/// decide.
pub(super) fn is_followed(rest: &[u8], size: usize) -> bool {
    let Some(behind) = rest.get(size..) else { return true };
    let window = behind.get(..FILL + MAGIC.len()).unwrap_or(behind);
    window.len() < FILL + MAGIC.len() || memchr::memmem::find(window, MAGIC).is_some()
}

fn parse_header(bytes: &[u8]) -> Option<ObjectHeader> {
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
    is_plausible.then_some(ObjectHeader { header: header.into(), size, kind })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: [u8; BASE] = *b"LOBJ\x20\0\x01\0\x30\0\0\0\x01\0\0\0";

    #[test]
    fn an_object_is_found_behind_other_bytes() {
        let head = ObjectHeader { header: 32, size: 48, kind: 1 };
        assert_eq!(find_object(&HEAD), ObjectContent::Object(head));
        assert_eq!(
            find_object(&[&b"\0L\0LOBJ...............LO"[..], &HEAD].concat()),
            ObjectContent::Gap(24)
        );
        assert_eq!(find_object(b"nothing"), ObjectContent::Gap(7));
        assert_eq!(find_object(b"nothing LO"), ObjectContent::Gap(8));
        assert_eq!(find_object(b"LO"), ObjectContent::More);
        assert_eq!(find_object(&HEAD[..15]), ObjectContent::More);
        assert_eq!(find_object(b""), ObjectContent::More);
    }

    #[test]
    fn what_cannot_be_an_object_is_none() {
        for (at, byte) in [(4, 15), (6, 0), (6, 4), (8, 31), (11, 5), (13, 4)] {
            let mut bytes = HEAD;
            bytes[at] = byte;
            assert_eq!(find_object(&bytes), ObjectContent::Gap(BASE), "{at} = {byte}");
        }
    }

    #[test]
    fn an_object_is_followed_by_another_or_by_the_end() {
        let two = [&[0; 8][..], b"\0\0", &HEAD].concat();
        assert!(is_followed(&two, 8) && is_followed(&two[..9], 8) && is_followed(&two, 100));
        assert!(!is_followed(&two, 2));
    }
}
