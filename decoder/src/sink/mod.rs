//! Events to bytes, one format a file.

mod ascii;
pub mod jsonl;
pub mod text;

/// `text` with control characters shown as `\u{1b}`, so that nothing from a capture steers a terminal.
pub fn escape(text: &str) -> std::borrow::Cow<'_, str> {
    if text.chars().any(char::is_control) {
        text.chars()
            .map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() })
            .collect::<String>()
            .into()
    } else {
        text.into()
    }
}
