//! Decodes the bytes of a file. CiA 306-1 §4 requires ASCII, but editors also write other encodings.

use std::borrow::Cow;

/// Windows-1252 0x80..=0x9F; all others equal Latin-1. The five unassigned bytes map to themselves.
const WINDOWS_1252: [char; 32] = [
    '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8D}', 'Ž', '\u{8F}', '\u{90}',
    '‘', '’', '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9D}', 'ž', 'Ÿ',
];

/// Text encoded as indicated by its byte order mark, otherwise UTF-8 if valid, otherwise Windows-1252.
pub(in crate::profile) fn decode_text(bytes: &[u8]) -> Cow<'_, str> {
    match bytes {
        [0xEF, 0xBB, 0xBF, rest @ ..] => utf8_or_windows(rest),
        [0xFF, 0xFE, rest @ ..] => Cow::Owned(decode_utf16(rest, u16::from_le_bytes)),
        [0xFE, 0xFF, rest @ ..] => Cow::Owned(decode_utf16(rest, u16::from_be_bytes)),
        _ => utf8_or_windows(bytes),
    }
}

fn utf8_or_windows(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().copied().map(windows_1252).collect()),
    }
}

fn windows_1252(byte: u8) -> char {
    let upper = byte.checked_sub(0x80).and_then(|at| WINDOWS_1252.get(usize::from(at)));
    upper.copied().unwrap_or(char::from(byte))
}

fn decode_utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> String {
    let units = bytes.as_chunks().0.iter().map(|pair| unit(*pair));
    char::decode_utf16(units).map(|character| character.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_by_mark_then_by_content() {
        assert_eq!(decode_text(b"\xEF\xBB\xBF[1000]"), "[1000]");
        assert_eq!(decode_text("Größe".as_bytes()), "Größe");
        assert_eq!(decode_text(b"Gr\xF6\xDFe \x80 \x94\x81"), "Größe € ”\u{81}");
        assert_eq!(decode_text(b"\xFF\xFE[\0]\0"), "[]");
        assert_eq!(decode_text(b"\xFE\xFF\0[\0]\xD8"), "[]");
    }
}
