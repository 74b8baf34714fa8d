//! Escaping of captured text for terminal output.

use std::fmt::Write as _;

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

/// A JSON document without control characters and bidirectional formatting characters, which JSON permits in strings: a
/// reader may print it on a terminal. Its meaning stays the same.
pub fn escape_json(json: &str) -> std::borrow::Cow<'_, str> {
    let is_unsafe = |c: char| c > '~' && is_terminal_control(c);
    if is_plain(json.as_bytes()) || !json.chars().any(is_unsafe) {
        return json.into();
    }
    let mut safe = String::with_capacity(json.len());
    for c in json.chars() {
        if is_unsafe(c) {
            // All of them have at most four hexadecimal digits.
            let _ = write!(safe, "\\u{:04x}", u32::from(c));
        } else {
            safe.push(c);
        }
    }
    safe.into()
}

/// Appends escaped text; bytes that are not valid UTF-8 are replaced.
pub(crate) fn push_escaped(out: &mut Vec<u8>, text: &[u8]) {
    if is_plain(text) {
        out.extend_from_slice(text);
    } else {
        out.extend_from_slice(escape(&String::from_utf8_lossy(text)).as_bytes());
    }
}

/// Whether `c` is a control character or a Unicode bidirectional formatting character.
fn is_terminal_control(c: char) -> bool {
    let is_bidirectional = matches!(
        c,
        '\u{061C}' | '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}'
    );
    // Line and paragraph separators end a line for some readers.
    c.is_control() || is_bidirectional || matches!(c, '\u{2028}' | '\u{2029}')
}

/// Quick check: `true` if no ASCII control character and no first byte of another character to escape occurs.
pub(crate) fn is_plain(text: &[u8]) -> bool {
    let special = |byte: u8| u8::from(byte < b' ') | u8::from(matches!(byte, 0x7F | 0xC2 | 0xD8 | 0xE2));
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
        assert_eq!(escape("\u{61c}\u{2028}"), "\\u{61c}\\u{2028}");
        let mut out = Vec::new();
        push_escaped(&mut out, b"a\tb \xC2\x9B \xC2\xB0");
        assert_eq!(String::from_utf8(out).unwrap(), "a\\tb \\u{9b} °");
    }

    #[test]
    fn json_keeps_its_meaning_without_control_characters() {
        let name = "° é \u{9b}2J\u{7f}\u{202e}\u{61c}\u{2029}\n→";
        let json = serde_json::to_string(&[name]).unwrap();
        let safe = escape_json(&json);
        assert_eq!(safe, r#"["° é \u009b2J\u007f\u202e\u061c\u2029\n→"]"#);
        assert_eq!(serde_json::from_str::<Vec<String>>(&safe).unwrap(), [name]);
        // Line ends between values stay.
        assert_eq!(escape_json("{\n \"a\": 1\n}\n"), "{\n \"a\": 1\n}\n");
    }
}
