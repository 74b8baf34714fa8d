//! Removes terminal control characters from texts of device files.

/// Replaces characters that control a terminal or reorder text.
pub(super) fn replace_controls(text: &str) -> String {
    text.chars().map(|c| if is_terminal_control(c) { char::REPLACEMENT_CHARACTER } else { c }).collect()
}

/// Whether it is a control character or reorders text (Unicode bidirectional formatting).
pub(super) fn is_terminal_control(c: char) -> bool {
    c.is_control() || matches!(c, '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}')
}
