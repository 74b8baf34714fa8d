//! Texts of a driver.

/// The text up to its first NUL, without control characters; bytes outside ASCII are replaced, because the drivers use the
/// code page of the computer.
pub(crate) fn clean_text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let readable = bytes.iter().take(end).map(|byte| match byte {
        b' '..=b'~' => char::from(*byte),
        0x80.. => char::REPLACEMENT_CHARACTER,
        _ => ' ',
    });
    readable.collect::<String>().trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_end_at_nul_and_contain_no_control_character() {
        assert_eq!(clean_text(b"PCAN-USB\0FD"), "PCAN-USB");
        assert_eq!(clean_text(b"a\x1b[31mb\r\n\x9b"), "a [31mb  \u{fffd}");
        assert_eq!(clean_text(&[0; 33]), "");
        assert_eq!(clean_text(b"no end"), "no end");
    }
}
