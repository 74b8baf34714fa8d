//! Errors with line, column and an excerpt with a caret, for all TOML files that users write.

use std::fmt;
use std::ops::Range;

use crate::marked_line::{MarkedLine, replace_control};

/// Max characters shown of a message, which may quote the text.
const LONGEST_MESSAGE: usize = 1_000;

/// Error in a text, with its position.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextError {
    /// Problem and expected form.
    pub message: String,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    marked: MarkedLine,
}

impl TextError {
    /// Error at the bytes `span` of `text`; only its first line is shown.
    pub fn at_place(text: &str, span: Range<usize>, message: impl Into<String>) -> Self {
        let start = text.floor_char_boundary(span.start);
        let before = text.get(..start).unwrap_or_default();
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let line =
            text.get(line_start..).unwrap_or_default().split('\n').next().unwrap_or_default().trim_end();
        Self {
            message: message.into(),
            line: before.matches('\n').count() + 1,
            column: text.get(line_start..start).unwrap_or_default().chars().count() + 1,
            marked: MarkedLine::mark_place(line, start - line_start..span.end.saturating_sub(line_start)),
        }
    }

    /// Converts an error of the TOML parser.
    pub(crate) fn of_toml(text: &str, error: &toml::de::Error) -> Self {
        let span = error.span().unwrap_or(0..0);
        let line = text.get(span.clone()).and_then(|about| about.lines().next()).unwrap_or_default();
        Self::at_place(text, span, plain_message(error.message(), line.trim()))
    }

    /// Prints `FILE:3:9: message`, the line, and a line with a caret below it.
    pub fn show_in_file(&self, file: &str) -> String {
        format!("{}:{self}", file.replace(char::is_control, "\u{FFFD}"))
    }
}

/// Prints the error without a file name.
impl fmt::Display for TextError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, column, marked: MarkedLine { shown, carets }, .. } = self;
        let message = self.message.replace('\n', ", ");
        let message: String = message.chars().take(LONGEST_MESSAGE).map(replace_control).collect();
        let number = line.to_string();
        let gutter = " ".repeat(number.len());
        writeln!(f, "{line}:{column}: {message}")?;
        writeln!(f, "  {number} | {shown}")?;
        write!(f, "  {gutter} | {carets}")
    }
}

impl std::error::Error for TextError {}

/// Replaces Rust type names in a parser message by terms of the file; `line` is the line with the error.
fn plain_message(message: &str, line: &str) -> String {
    let Some((found, expected)) =
        message.strip_prefix("invalid type: ").and_then(|rest| rest.split_once(", expected "))
    else {
        return message.to_owned();
    };
    let value = found.split_once(' ').map_or(found, |(_, value)| value).trim_matches('`');
    let found = match found.split(' ').next() {
        Some("map") => "a table",
        Some("sequence") => "a list",
        Some("string" | "integer" | "boolean") => value,
        Some("floating") => value.trim_start_matches("point `"),
        _ => found,
    };
    let expected = match expected.split([' ', ',']).next() {
        Some("f32" | "f64") => "a number".to_owned(),
        Some("i8" | "i16" | "i32" | "i64" | "u8" | "u16" | "u32" | "u64" | "usize") => {
            "a whole number".to_owned()
        }
        Some("struct") => "a table".to_owned(),
        Some("bool" | "boolean") => "true or false".to_owned(),
        _ if expected == "a map" => "a table".to_owned(),
        _ if expected == "a sequence" => match line.strip_prefix('[').and_then(|name| name.strip_suffix(']'))
        {
            Some(name) if found == "a table" => format!("[[{name}]]"),
            _ => "a list".to_owned(),
        },
        _ => expected.to_owned(),
    };
    format!("found {found}, expected {expected}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_caret_is_below_the_text_after_any_prefix() {
        let text = "a = 1\n\tä = \"x\u{1b}y\"\n";
        let error = TextError::at_place(text, 8..9, "unknown");
        assert_eq!((error.line, error.column), (2, 2));
        let error = TextError::at_place(text, text.find('"').unwrap()..text.len() - 1, "not this");
        assert_eq!(
            error.show_in_file("f.toml"),
            "f.toml:2:6: not this\n  2 |  ä = \"x\u{FFFD}y\"\n    |      ^^^^^"
        );
    }

    #[test]
    fn places_beyond_the_end_are_the_end() {
        let error = TextError::at_place("a", 7..9, "m");
        assert_eq!((error.line, error.column), (1, 2));
        assert_eq!(TextError::at_place("", 0..0, "m").to_string(), "1:1: m\n  1 | \n    | ^");
    }

    #[test]
    fn of_a_very_long_line_the_surroundings_are_shown() {
        let zeros = "\0".repeat(100_000);
        let shown = TextError::at_place(&zeros, 99_999..100_000, "m".repeat(100_000)).to_string();
        assert!(shown.starts_with("1:100000: m"), "{shown}");
        assert!(shown.len() < 2_000, "{}", shown.len());
    }
}
