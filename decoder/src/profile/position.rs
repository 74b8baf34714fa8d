//! Errors with line, column and an excerpt with a caret, for all TOML files that users write.

use std::fmt;
use std::ops::Range;

/// Error in a text, with its position.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextError {
    /// Problem and expected form.
    pub message: String,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Text of the line.
    excerpt: String,
    /// Number of marked characters, at least one.
    width: usize,
}

impl TextError {
    /// Error at the bytes `span` of `text`; only its first line is shown.
    pub fn at(text: &str, span: Range<usize>, message: impl Into<String>) -> Self {
        let start = floor(text, span.start);
        let before = text.get(..start).unwrap_or_default();
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let rest = text.get(line_start..).unwrap_or_default();
        let excerpt = rest.split('\n').next().unwrap_or_default().trim_end();
        let column = text.get(line_start..start).unwrap_or_default().chars().count() + 1;
        let end = floor(text, span.end.max(start)).min(line_start + excerpt.len());
        let width = text.get(start..end).map_or(1, |marked| marked.chars().count()).max(1);
        Self {
            message: message.into(),
            line: before.matches('\n').count() + 1,
            column,
            excerpt: excerpt.to_owned(),
            width,
        }
    }

    /// Converts an error of the TOML parser.
    pub(crate) fn of_toml(text: &str, error: &toml::de::Error) -> Self {
        let span = error.span().unwrap_or(0..0);
        let line = text.get(span.clone()).and_then(|about| about.lines().next()).unwrap_or_default();
        Self::at(text, span, plain(error.message(), line.trim()))
    }

    /// Prints `FILE:3:9: message`, the line, and a line with a caret below it.
    pub fn show(&self, file: &str) -> String {
        format!("{}:{self}", file.replace(char::is_control, "\u{FFFD}"))
    }
}

/// Prints the error without a file name.
impl fmt::Display for TextError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { line, column, width, .. } = *self;
        let message = self.message.replace('\n', ", ").replace(char::is_control, "\u{FFFD}");
        let excerpt = self.excerpt.replace('\t', " ").replace(char::is_control, "\u{FFFD}");
        let number = line.to_string();
        let gutter = " ".repeat(number.len());
        writeln!(f, "{line}:{column}: {message}")?;
        writeln!(f, "  {number} | {excerpt}")?;
        write!(f, "  {gutter} | {:skip$}{}", "", "^".repeat(width), skip = column - 1)
    }
}

impl std::error::Error for TextError {}

/// Replaces Rust type names in a parser message by terms of the file; `line` is the line with the error.
fn plain(message: &str, line: &str) -> String {
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

/// Character boundary at or before `at`.
fn floor(text: &str, at: usize) -> usize {
    let mut at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_caret_is_below_the_text_after_any_prefix() {
        let text = "a = 1\n\tä = \"x\u{1b}y\"\n";
        let error = TextError::at(text, 8..9, "unknown");
        assert_eq!((error.line, error.column), (2, 2));
        let error = TextError::at(text, text.find('"').unwrap()..text.len() - 1, "not this");
        assert_eq!(error.show("f.toml"), "f.toml:2:6: not this\n  2 |  ä = \"x\u{FFFD}y\"\n    |      ^^^^^");
    }

    #[test]
    fn places_beyond_the_end_are_the_end() {
        let error = TextError::at("a", 7..9, "m");
        assert_eq!((error.line, error.column), (1, 2));
        assert_eq!(TextError::at("", 0..0, "m").to_string(), "1:1: m\n  1 | \n    | ^");
    }
}
