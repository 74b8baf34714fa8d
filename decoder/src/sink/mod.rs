//! Events to bytes, one format a file.

mod ascii;
pub mod jsonl;
pub mod text;

/// `text` with control characters shown as `\u{1b}`, so that nothing from a capture steers a terminal.
pub fn escape(text: &str) -> std::borrow::Cow<'_, str> {
    if !is_plain(text.as_bytes()) && text.chars().any(char::is_control) {
        text.chars()
            .map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() })
            .collect::<String>()
            .into()
    } else {
        text.into()
    }
}

/// Appends text escaped; bytes that are no UTF-8 are replaced.
fn push_escaped(out: &mut Vec<u8>, text: &[u8]) {
    if is_plain(text) {
        out.extend_from_slice(text);
    } else {
        out.extend_from_slice(escape(&String::from_utf8_lossy(text)).as_bytes());
    }
}

/// Surely without control characters: none of ASCII, and not the first byte of those beyond it.
fn is_plain(text: &[u8]) -> bool {
    const BEYOND_ASCII: u8 = 0xC2;
    let special = |byte: u8| u8::from(byte < b' ') | u8::from(byte == 0x7F) | u8::from(byte == BEYOND_ASCII);
    text.iter().fold(0, |found, byte| found | special(*byte)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_not_sent() {
        assert_eq!(escape("→ é 5 °C"), "→ é 5 °C");
        assert_eq!(escape("\x1b[2J\u{9b}2J\x7f"), "\\u{1b}[2J\\u{9b}2J\\u{7f}");
        let mut out = Vec::new();
        push_escaped(&mut out, b"a\tb \xC2\x9B \xC2\xB0");
        assert_eq!(String::from_utf8(out).unwrap(), "a\\tb \\u{9b} °");
    }
}
