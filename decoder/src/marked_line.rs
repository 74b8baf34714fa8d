//! A line of a text with a caret below the place of an error.

use std::ops::Range;

/// Max characters shown before the place.
const BEFORE: usize = 60;

/// Max characters shown of a line, and marked.
const SHOWN: usize = 100;

/// The surroundings of a place in a line, which may be very long.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct MarkedLine {
    /// Characters around the place, without control characters.
    pub(crate) shown: String,
    /// Blanks and carets below the place.
    pub(crate) carets: String,
}

impl MarkedLine {
    /// Marks the bytes `place` of a line, at least one character; a place beyond the end is the end.
    pub(crate) fn mark_place(line: &str, place: Range<usize>) -> Self {
        let start = line.floor_char_boundary(place.start);
        let (before, rest) = line.split_at(start);
        let marked =
            rest.get(..rest.floor_char_boundary(place.end.saturating_sub(start))).unwrap_or_default();
        let before = before.chars().count();
        let skipped = before.saturating_sub(BEFORE);
        let indent = before - skipped;
        let width = marked.chars().take(SHOWN - indent).count().max(1);
        let shown = line.chars().skip(skipped).take(SHOWN).map(replace_control).collect();
        Self { shown, carets: format!("{}{}", " ".repeat(indent), "^".repeat(width)) }
    }
}

/// Control characters as one column.
pub(crate) fn replace_control(letter: char) -> char {
    match letter {
        '\t' | '\n' => ' ',
        letter if letter.is_control() => char::REPLACEMENT_CHARACTER,
        letter => letter,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn marked(line: &str, place: Range<usize>) -> (String, String) {
        let MarkedLine { shown, carets } = MarkedLine::mark_place(line, place);
        (shown, carets)
    }

    #[test]
    fn letters_are_counted_rather_than_bytes() {
        assert_eq!(marked("\"äöü\"\t?", 9..10), ("\"äöü\" ?".into(), "      ^".into()));
        assert_eq!(marked("ä = \u{1b}", 5..6), ("ä = \u{FFFD}".into(), "    ^".into()));
    }

    #[test]
    fn at_the_end_the_caret_follows_the_text() {
        assert_eq!(marked("node ==", 7..7), ("node ==".into(), "       ^".into()));
        assert_eq!(marked("a", 7..9), ("a".into(), " ^".into()));
        assert_eq!(marked("", 0..0), (String::new(), "^".into()));
    }

    #[test]
    fn of_a_long_line_the_surroundings_are_shown() {
        let text = format!("{}?{}", "a".repeat(100_000), "b".repeat(1_000));
        let (shown, carets) = marked(&text, 100_000..101_001);
        assert_eq!(shown, format!("{}?{}", "a".repeat(60), "b".repeat(39)));
        assert_eq!(carets, format!("{}{}", " ".repeat(60), "^".repeat(40)));
    }

    proptest! {
        #[test]
        fn any_place_is_marked_within_the_width(line in ".{0,300}", start in 0_usize..400, length in 0_usize..400) {
            let MarkedLine { shown, carets } = MarkedLine::mark_place(&line, start..start + length);
            prop_assert!(shown.chars().count() <= SHOWN);
            prop_assert!(carets.len() <= SHOWN && carets.ends_with('^'));
            prop_assert!(!shown.contains(char::is_control));
        }
    }
}
