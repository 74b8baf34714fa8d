//! Words that can follow at the end of an incomplete filter, for a prompt.
//!
//! ```text
//! ""               ▸ fields
//! "kind "          ▸ operators
//! "kind == em"     ▸ values of `kind` that start with `em`
//! "kind == emcy "  ▸ && ||
//! ```

use super::expression::Operand;
use super::fields::{FieldType, Target, resolve, table};
use super::lexer::{PositionedToken, Token, tokens};

/// Fields listed before the others.
const FIRST: [&str; 7] = ["kind", "node", "bus", "severity", "rule", "pdo", "object"];

/// A possible continuation of a filter.
#[derive(Debug, Clone)]
pub struct Completion {
    /// Offset of the word to complete, in bytes; the end of the text for a new word.
    pub start: usize,
    /// Meaning of the word.
    pub expected: Expected,
}

/// Meaning of a word in a filter.
#[derive(Debug, Clone)]
pub enum Expected {
    /// Name of a field.
    Field,
    /// Operator after a field with these definitions.
    Operator(Vec<Target>),
    /// Value of a field with these definitions.
    Value(Vec<Target>),
    /// `&&` or `||`.
    Connective,
}

/// Position in the grammar after some tokens.
enum State {
    Field,
    AfterField(String),
    Value(String),
    OpenSet(String),
    Set(String),
    AfterTest,
}

impl State {
    fn after(self, token: &Token) -> Option<Self> {
        Some(match (self, token) {
            (Self::Field, Token::Not | Token::Open)
            | (Self::AfterField(_) | Self::AfterTest, Token::And | Token::Or) => Self::Field,
            (Self::Field, Token::Word(Operand { text, is_quoted: false, .. })) => {
                Self::AfterField(text.clone())
            }
            (Self::AfterField(field), Token::Relation(_) | Token::Contains | Token::Matches) => {
                Self::Value(field)
            }
            (Self::AfterField(field), Token::In) => Self::OpenSet(field),
            (Self::OpenSet(field), Token::OpenSet)
            | (Self::Set(field), Token::Word(_) | Token::Comma | Token::Range) => Self::Set(field),
            (Self::Value(_), Token::Word(_))
            | (Self::Set(_), Token::CloseSet)
            | (Self::AfterField(_) | Self::AfterTest, Token::Close) => Self::AfterTest,
            _ => return None,
        })
    }
}

/// The continuation at the end of `text`; `None` inside quotes, after an error and after an unknown field.
pub fn completion(text: &str) -> Option<Completion> {
    let mut placed = tokens(text).ok()?;
    placed.pop_if(|(token, _)| *token == Token::End);
    let is_open = |(token, at): &mut PositionedToken| {
        at.end == text.len() && matches!(token, Token::Word(word) if !word.is_quoted)
    };
    let start = placed.pop_if(is_open).map_or(text.len(), |(_, at)| at.start);
    let is_reserved = |(token, at): &PositionedToken| {
        let ends_with_letter = text.ends_with(|letter: char| letter.is_alphanumeric() || letter == '"');
        at.end == text.len() && ends_with_letter && !matches!(token, Token::End)
    };
    if start == text.len() && placed.last().is_some_and(is_reserved) {
        return None;
    }
    let state = placed.iter().try_fold(State::Field, |state, (token, _)| state.after(token))?;
    let targets = |field: String| Some(resolve(&field)).filter(|targets| !targets.is_empty());
    let expected = match state {
        State::Field => Expected::Field,
        State::AfterField(field) => Expected::Operator(targets(field)?),
        State::Value(field) | State::Set(field) => Expected::Value(targets(field)?),
        State::AfterTest => Expected::Connective,
        State::OpenSet(_) => return None,
    };
    Some(Completion { start, expected })
}

impl Expected {
    /// All possible words; empty for values that depend on the capture.
    pub fn words(&self) -> Vec<&'static str> {
        match self {
            Self::Field => field_names(),
            Self::Operator(targets) => operators(targets),
            Self::Value(targets) => unique(targets.iter().flat_map(|target| fixed_values(*target))),
            Self::Connective => vec!["&&", "||"],
        }
    }
}

fn field_names() -> Vec<&'static str> {
    let fields = table().fields.iter().map(|field| field.key.as_str());
    let parts = table().parts.iter().map(|part| part.key.as_str());
    unique(FIRST.into_iter().chain(fields).chain(parts))
}

fn operators(targets: &[Target]) -> Vec<&'static str> {
    let of = |target: &Target| -> &'static [&'static str] {
        match target.value() {
            FieldType::Text | FieldType::Any => &["==", "!=", "contains", "matches", "in"],
            FieldType::Bytes => &["==", "!=", "contains"],
            FieldType::Bool => &["==", "!="],
            FieldType::Group => &[],
            _ => &["==", "!=", "<", "<=", ">", ">=", "in"],
        }
    };
    unique(targets.iter().flat_map(of).copied().chain(["&&", "||"]))
}

fn fixed_values(target: Target) -> Vec<&'static str> {
    match target.value() {
        FieldType::Bool => vec!["true", "false"],
        _ if target.field.key == "kind" => target.field.kinds.names().collect(),
        _ => target.field.values.iter().map(String::as_str).collect(),
    }
}

fn unique(words: impl Iterator<Item = &'static str>) -> Vec<&'static str> {
    let mut found = Vec::new();
    for word in words {
        if !found.contains(&word) {
            found.push(word);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::Filter;

    /// Kind of word and its start.
    fn expected(text: &str) -> String {
        let Some(found) = completion(text) else { return "-".to_owned() };
        let name = match &found.expected {
            Expected::Field => "field",
            Expected::Operator(_) => "operator",
            Expected::Value(_) => "value",
            Expected::Connective => "connective",
        };
        format!("{name} {}", found.start)
    }

    #[test]
    fn the_grammar_decides_what_follows() {
        assert_eq!(expected(""), "field 0");
        assert_eq!(expected("ki"), "field 0");
        assert_eq!(expected("kind "), "operator 5");
        assert_eq!(expected("kind con"), "operator 5");
        assert_eq!(expected("kind =="), "value 7");
        assert_eq!(expected("kind == em"), "value 8");
        assert_eq!(expected("kind == emcy "), "connective 13");
        assert_eq!(expected("!(kind == emcy && no"), "field 18");
        assert_eq!(expected("kind in {emcy, nm"), "value 15");
        assert_eq!(expected("kind in {emcy} "), "connective 15");
        assert_eq!(expected("bus == \"a b\" and "), "field 17");
    }

    #[test]
    fn nothing_follows_an_error_or_a_complete_word() {
        let texts = [
            "bus == \"ca",
            "kind = ",
            "nofield == ",
            "kind in ",
            "a b c",
            "kind == emcy and",
            "bus == \"a\"",
        ];
        for text in texts {
            assert_eq!(expected(text), "-", "{text}");
        }
    }

    #[test]
    fn each_word_gives_a_valid_filter() {
        for field in Expected::Field.words() {
            assert!(field.parse::<Filter>().is_ok(), "{field}");
            let Some(found) = completion(&format!("{field} == ")) else { panic!("{field}") };
            for value in found.expected.words() {
                let filter = format!("{field} == {value}");
                assert!(filter.parse::<Filter>().is_ok(), "{filter}");
            }
        }
        let kinds = completion("kind == ").map(|found| found.expected.words()).unwrap_or_default();
        assert!(kinds.contains(&"emcy") && kinds.len() > 20, "{kinds:?}");
        assert_eq!(Expected::Operator(resolve("node")).words()[..3], ["==", "!=", "<"]);
    }
}
