//! Error in a filter, with its position.

use std::fmt;
use std::ops::Range;

/// Max characters shown before the position of the error.
const SHOWN_BEFORE: usize = 60;

/// Max characters shown from the position of the error.
const SHOWN_BEHIND: usize = 40;

/// Error in a filter. `Display` prints the reason, then the filter with `^` below the position.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FilterError {
    reason: String,
    text: String,
    at: Range<usize>,
}

impl FilterError {
    /// `at` is the position in `text`, in bytes.
    pub(super) fn new(text: &str, at: Range<usize>, reason: impl Into<String>) -> Self {
        Self { reason: reason.into(), text: text.to_owned(), at }
    }

    /// Reason in one line, without position.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// Position in the text of the filter, in bytes.
    pub fn at(&self) -> Range<usize> {
        self.at.clone()
    }
}

impl std::error::Error for FilterError {}

impl fmt::Display for FilterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let before = self.text.get(..self.at.start).unwrap_or(&self.text).chars().count();
        let width = self.text.get(self.at.clone()).unwrap_or_default().chars().count();
        let skipped = before.saturating_sub(SHOWN_BEFORE);
        let shown = before - skipped + SHOWN_BEHIND;
        let visible = |letter: char| if letter.is_control() { ' ' } else { letter };
        let line: String = self.text.chars().skip(skipped).take(shown).map(visible).collect();
        let width = width.clamp(1, SHOWN_BEHIND);
        let reason: String = self.reason.chars().map(visible).collect();
        write!(f, "{reason}\n  {line}\n  {:indent$}{:^<width$}", "", "", indent = before - skipped)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_caret_is_below_the_error() {
        let error = FilterError::new("node == vier", 8..12, "wrong");
        assert_eq!(error.to_string(), "wrong\n  node == vier\n          ^^^^");
    }

    #[test]
    fn letters_are_counted_rather_than_bytes() {
        let error = FilterError::new("\"äöü\"\t?", 9..10, "wrong");
        assert_eq!(error.to_string(), "wrong\n  \"äöü\" ?\n        ^");
    }

    #[test]
    fn of_long_text_the_surroundings_are_shown() {
        let text = format!("{}?{}", "a".repeat(1_000), "b".repeat(1_000));
        let shown = FilterError::new(&text, 1_000..2_001, "wrong").to_string();
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines[1], format!("  {}?{}", "a".repeat(60), "b".repeat(39)));
        assert_eq!(lines[2], format!("  {}{}", " ".repeat(60), "^".repeat(40)));
    }

    #[test]
    fn at_the_end_the_caret_follows_the_text() {
        assert_eq!(FilterError::new("node ==", 7..7, "x").to_string(), "x\n  node ==\n         ^");
    }
}
