//! Texts of device files without what a terminal would obey.

/// Text without characters that steer a terminal or reorder text.
pub(super) fn printable(text: &str) -> String {
    text.chars().map(|c| if steers(c) { char::REPLACEMENT_CHARACTER } else { c }).collect()
}

/// Control characters, and the marks that reorder text (Unicode's bidirectional formatting).
pub(super) fn steers(c: char) -> bool {
    c.is_control() || matches!(c, '\u{200E}' | '\u{200F}' | '\u{202A}'..='\u{202E}' | '\u{2066}'..='\u{2069}')
}
