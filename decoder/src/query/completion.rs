//! Words that can follow at the end of an incomplete filter, for a prompt.
//!
//! ```text
//! ""               ▸ fields
//! "kind "          ▸ operators
//! "kind == em"     ▸ values of `kind` that start with `em`
//! "kind == emcy "  ▸ && ||
//! ```

use super::expression::Operand;
use super::fields::{FieldTarget, FieldType, field_table, resolve_name};
use super::lexer::{FilterToken, PositionedToken, split_tokens};

/// Fields listed before the others.
const FIRST: [&str; 7] = ["kind", "node", "bus", "severity", "rule", "pdo", "object"];

/// A possible continuation of a filter.
#[derive(Debug, Clone)]
pub struct Completion {
    /// Offset of the word to complete, in bytes; the end of the text for a new word.
    pub start: usize,
    /// Meaning of the word.
    pub expected: ExpectedWord,
}

/// Meaning of a word in a filter.
#[derive(Debug, Clone)]
pub enum ExpectedWord {
    /// Name of a field.
    Field,
    /// Operator after a field with these definitions.
    Operator(Vec<FieldTarget>),
    /// Value of a field with these definitions.
    Value(Vec<FieldTarget>),
    /// `&&` or `||`.
    Connective,
}

/// Position in the grammar after some tokens.
enum GrammarState {
    Field,
    AfterField(String),
    Value(String),
    OpenSet(String),
    Set(String),
    AfterTest,
}

impl GrammarState {
    fn next_state(self, token: &FilterToken) -> Option<Self> {
        Some(match (self, token) {
            (Self::Field, FilterToken::Not | FilterToken::Open)
            | (Self::AfterField(_) | Self::AfterTest, FilterToken::And | FilterToken::Or) => Self::Field,
            (Self::Field, FilterToken::Word(Operand { text, is_quoted: false, .. })) => {
                Self::AfterField(text.clone())
            }
            (
                Self::AfterField(field),
                FilterToken::Relation(_) | FilterToken::Contains | FilterToken::Matches,
            ) => Self::Value(field),
            (Self::AfterField(field), FilterToken::In) => Self::OpenSet(field),
            (Self::OpenSet(field), FilterToken::OpenSet)
            | (Self::Set(field), FilterToken::Word(_) | FilterToken::Comma | FilterToken::Range) => {
                Self::Set(field)
            }
            (Self::Value(_), FilterToken::Word(_))
            | (Self::Set(_), FilterToken::CloseSet)
            | (Self::AfterField(_) | Self::AfterTest, FilterToken::Close) => Self::AfterTest,
            _ => return None,
        })
    }
}

/// The continuation at the end of `text`; `None` inside quotes, after an error and after an unknown field.
pub fn complete_filter(text: &str) -> Option<Completion> {
    let mut placed = split_tokens(text).ok()?;
    placed.pop_if(|(token, _)| *token == FilterToken::End);
    let is_open = |(token, at): &mut PositionedToken| {
        at.end == text.len() && matches!(token, FilterToken::Word(word) if !word.is_quoted)
    };
    let start = placed.pop_if(is_open).map_or(text.len(), |(_, at)| at.start);
    let is_reserved = |(token, at): &PositionedToken| {
        let ends_with_letter = text.ends_with(|letter: char| letter.is_alphanumeric() || letter == '"');
        at.end == text.len() && ends_with_letter && !matches!(token, FilterToken::End)
    };
    if start == text.len() && placed.last().is_some_and(is_reserved) {
        return None;
    }
    let state = placed.iter().try_fold(GrammarState::Field, |state, (token, _)| state.next_state(token))?;
    let targets = |field: String| Some(resolve_name(&field)).filter(|targets| !targets.is_empty());
    let expected = match state {
        GrammarState::Field => ExpectedWord::Field,
        GrammarState::AfterField(field) => ExpectedWord::Operator(targets(field)?),
        GrammarState::Value(field) | GrammarState::Set(field) => ExpectedWord::Value(targets(field)?),
        GrammarState::AfterTest => ExpectedWord::Connective,
        GrammarState::OpenSet(_) => return None,
    };
    Some(Completion { start, expected })
}

impl ExpectedWord {
    /// All possible words; empty for values that depend on the capture.
    pub fn possible_words(&self) -> Vec<&'static str> {
        match self {
            Self::Field => field_names(),
            Self::Operator(targets) => possible_operators(targets),
            Self::Value(targets) => unique_words(targets.iter().flat_map(|target| fixed_values(*target))),
            Self::Connective => vec!["&&", "||"],
        }
    }
}

fn field_names() -> Vec<&'static str> {
    let fields = field_table().fields.iter().map(|field| field.key.as_str());
    let parts = field_table().parts.iter().map(|part| part.key.as_str());
    unique_words(FIRST.into_iter().chain(fields).chain(parts))
}

fn possible_operators(targets: &[FieldTarget]) -> Vec<&'static str> {
    let of = |target: &FieldTarget| -> &'static [&'static str] {
        match target.value() {
            FieldType::Text | FieldType::Any => &["==", "!=", "contains", "matches", "in"],
            FieldType::Bytes => &["==", "!=", "contains"],
            FieldType::Bool => &["==", "!="],
            FieldType::Group => &[],
            _ => &["==", "!=", "<", "<=", ">", ">=", "in"],
        }
    };
    unique_words(targets.iter().flat_map(of).copied().chain(["&&", "||"]))
}

fn fixed_values(target: FieldTarget) -> Vec<&'static str> {
    match target.value() {
        FieldType::Bool => vec!["true", "false"],
        _ if target.field.key == "kind" => target.field.kinds.names().collect(),
        _ => target.field.values.iter().map(String::as_str).collect(),
    }
}

fn unique_words(words: impl Iterator<Item = &'static str>) -> Vec<&'static str> {
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
        let Some(found) = complete_filter(text) else { return "-".to_owned() };
        let name = match &found.expected {
            ExpectedWord::Field => "field",
            ExpectedWord::Operator(_) => "operator",
            ExpectedWord::Value(_) => "value",
            ExpectedWord::Connective => "connective",
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
        for field in ExpectedWord::Field.possible_words() {
            assert!(field.parse::<Filter>().is_ok(), "{field}");
            let Some(found) = complete_filter(&format!("{field} == ")) else { panic!("{field}") };
            for value in found.expected.possible_words() {
                let filter = format!("{field} == {value}");
                assert!(filter.parse::<Filter>().is_ok(), "{filter}");
            }
        }
        let kinds =
            complete_filter("kind == ").map(|found| found.expected.possible_words()).unwrap_or_default();
        assert!(kinds.contains(&"emcy") && kinds.len() > 20, "{kinds:?}");
        assert_eq!(ExpectedWord::Operator(resolve_name("node")).possible_words()[..3], ["==", "!=", "<"]);
    }
}
