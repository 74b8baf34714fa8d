//! Escaping of captured text for terminal output.

/// `text` with control characters and bidirectional formatting characters shown as `\u{1b}`, so that a
/// capture cannot control the terminal.
pub fn escape(text: &str) -> std::borrow::Cow<'_, str> {
    if !is_plain(text.as_bytes()) && text.chars().any(is_terminal_control) {
        text.chars()
            .map(|c| if is_terminal_control(c) { c.escape_default().to_string() } else { c.to_string() })
            .collect::<String>()
            .into()
    } else {
        text.into()
    }
}

/// Appends escaped text; bytes that are not valid UTF-8 are replaced.
pub(super) fn push_escaped(out: &mut Vec<u8>, text: &[u8]) {
    if is_plain(text) {
        out.extend_from_slice(text);
    } else {
        out.extend_from_slice(escape(&String::from_utf8_lossy(text)).as_bytes());
    }
}

/// Whether `c` is a control character or a Unicode bidirectional formatting character.
fn is_terminal_control(c: char) -> bool {
    c.is_control() || matches!(c, '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}')
}

/// Quick check: `true` if no ASCII control character and no first byte of another character to escape occurs.
pub(super) fn is_plain(text: &[u8]) -> bool {
    let special = |byte: u8| u8::from(byte < b' ') | u8::from(matches!(byte, 0x7F | 0xC2 | 0xE2));
    text.iter().fold(0, |found, byte| found | special(*byte)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_not_sent() {
        assert_eq!(escape("→ é 5 °C"), "→ é 5 °C");
        assert_eq!(escape("a\u{202e}b – c"), "a\\u{202e}b – c");
        assert_eq!(escape("\x1b[2J\u{9b}2J\x7f"), "\\u{1b}[2J\\u{9b}2J\\u{7f}");
        let mut out = Vec::new();
        push_escaped(&mut out, b"a\tb \xC2\x9B \xC2\xB0");
        assert_eq!(String::from_utf8(out).unwrap(), "a\\tb \\u{9b} °");
    }
}
