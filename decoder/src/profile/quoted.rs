//! Quotes text of user files in messages.

/// Start of a text in quotes, without control characters.
pub(super) fn quote_start(text: &str) -> String {
    const SHOWN: usize = 40;
    let mut shown: String = text.chars().take(SHOWN).map(printable_char).collect();
    if text.chars().nth(SHOWN).is_some() {
        shown.push('…');
    }
    format!("\"{shown}\"")
}

/// Replaces a character that controls the terminal.
pub(super) fn printable_char(character: char) -> char {
    if character.is_control() { char::REPLACEMENT_CHARACTER } else { character }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quoted_text_is_short_and_printable() {
        assert_eq!(quote_start("a\x1b[2J"), "\"a\u{FFFD}[2J\"");
        assert_eq!(quote_start(&"ä".repeat(100)).chars().count(), 43);
    }
}
