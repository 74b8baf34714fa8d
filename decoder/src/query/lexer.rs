//! Splits a filter into tokens.

use std::ops::Range;

use super::error::FilterError;
use super::expression::{Operand, RelationalOperator};

#[derive(Debug, Clone, PartialEq)]
pub(super) enum FilterToken {
    /// A field name or a value; `..` splits words.
    Word(Operand),
    /// `==`, `eq` and the other relational operators.
    Relation(RelationalOperator),
    /// `contains`.
    Contains,
    /// `matches`.
    Matches,
    /// `in`.
    In,
    /// `&&`, `and`.
    And,
    /// `||`, `or`.
    Or,
    /// `!`, `not`.
    Not,
    /// `(`
    Open,
    /// `)`
    Close,
    /// `{`
    OpenSet,
    /// `}`
    CloseSet,
    /// `,`
    Comma,
    /// `..`
    Range,
    /// End of the filter.
    End,
}

/// A token and its position.
pub(super) type PositionedToken = (FilterToken, Range<usize>);

/// Operators and punctuation; longer ones first.
const SIGNS: &[(&str, FilterToken)] = &[
    ("==", FilterToken::Relation(RelationalOperator::Equal)),
    ("!=", FilterToken::Relation(RelationalOperator::NotEqual)),
    ("<=", FilterToken::Relation(RelationalOperator::LessOrEqual)),
    (">=", FilterToken::Relation(RelationalOperator::GreaterOrEqual)),
    ("&&", FilterToken::And),
    ("||", FilterToken::Or),
    ("..", FilterToken::Range),
    ("<", FilterToken::Relation(RelationalOperator::Less)),
    (">", FilterToken::Relation(RelationalOperator::Greater)),
    ("!", FilterToken::Not),
    ("(", FilterToken::Open),
    (")", FilterToken::Close),
    ("{", FilterToken::OpenSet),
    ("}", FilterToken::CloseSet),
    (",", FilterToken::Comma),
];

/// Reserved words; as values they need quotes.
const WORDS: &[(&str, FilterToken)] = &[
    ("and", FilterToken::And),
    ("or", FilterToken::Or),
    ("not", FilterToken::Not),
    ("in", FilterToken::In),
    ("contains", FilterToken::Contains),
    ("matches", FilterToken::Matches),
    ("eq", FilterToken::Relation(RelationalOperator::Equal)),
    ("ne", FilterToken::Relation(RelationalOperator::NotEqual)),
    ("lt", FilterToken::Relation(RelationalOperator::Less)),
    ("le", FilterToken::Relation(RelationalOperator::LessOrEqual)),
    ("gt", FilterToken::Relation(RelationalOperator::Greater)),
    ("ge", FilterToken::Relation(RelationalOperator::GreaterOrEqual)),
];

/// Splits a filter into tokens; the last one is [`FilterToken::End`].
pub(super) fn split_tokens(text: &str) -> Result<Vec<PositionedToken>, FilterError> {
    let mut lexer = FilterLexer { text, at: 0 };
    let mut all = Vec::new();
    loop {
        let placed = lexer.next()?;
        let is_end = placed.0 == FilterToken::End;
        all.push(placed);
        if is_end {
            return Ok(all);
        }
    }
}

struct FilterLexer<'a> {
    text: &'a str,
    at: usize,
}

impl<'a> FilterLexer<'a> {
    fn remaining_text(&self) -> &'a str {
        self.text.get(self.at..).unwrap_or_default()
    }

    fn next(&mut self) -> Result<PositionedToken, FilterError> {
        let rest = self.remaining_text();
        self.at += rest.len() - rest.trim_start().len();
        let (start, rest) = (self.at, self.remaining_text());
        let Some(first) = rest.chars().next() else { return Ok((FilterToken::End, start..start)) };
        if let Some(text) = rest.strip_prefix("r\"") {
            self.at += 2;
            return self.raw_text(text, start);
        }
        if first == '"' {
            self.at += 1;
            return self.quoted_text(start);
        }
        if let Some((sign, token)) = SIGNS.iter().find(|(sign, _)| rest.starts_with(sign)) {
            self.at += sign.len();
            return Ok((token.clone(), start..self.at));
        }
        let length = word_length(rest);
        if length == 0 {
            let end = start + first.len_utf8();
            return Err(FilterError::new(self.text, start..end, unexpected_text(first)));
        }
        self.at += length;
        let word = rest.get(..length).unwrap_or_default();
        let token = WORDS.iter().find(|(name, _)| *name == word).map(|(_, token)| token.clone());
        let token = token.unwrap_or_else(|| FilterToken::Word(Operand::from_word(word, start..self.at)));
        Ok((token, start..self.at))
    }

    /// Raw text `r"…"`: no escapes, ends at the next quote.
    fn raw_text(&mut self, rest: &str, start: usize) -> Result<PositionedToken, FilterError> {
        let Some((text, _)) = rest.split_once('"') else { return Err(self.unclosed_error(start)) };
        self.at += text.len() + 1;
        Ok((FilterToken::Word(Operand::from_quoted(text.to_owned(), start..self.at)), start..self.at))
    }

    /// Text `"…"` with the escapes `\"`, `\\`, `\n`, `\r`, `\t`, `\xHH`.
    fn quoted_text(&mut self, start: usize) -> Result<PositionedToken, FilterError> {
        let mut text = String::new();
        loop {
            let at = self.at;
            let Some(letter) = self.next_letter() else { return Err(self.unclosed_error(start)) };
            match letter {
                '"' => {
                    return Ok((
                        FilterToken::Word(Operand::from_quoted(text, start..self.at)),
                        start..self.at,
                    ));
                }
                '\\' => text.push(self.escaped_letter().ok_or_else(|| {
                    let reason = "unknown escape; expected \\\\ \\\" \\n \\r \\t or \\x00 to \\x7F; \
                                  use r\"…\" for text without escapes";
                    FilterError::new(self.text, at..self.at, reason)
                })?),
                _ => text.push(letter),
            }
        }
    }

    fn next_letter(&mut self) -> Option<char> {
        let letter = self.remaining_text().chars().next()?;
        self.at += letter.len_utf8();
        Some(letter)
    }

    fn escaped_letter(&mut self) -> Option<char> {
        match self.next_letter()? {
            letter @ ('"' | '\\') => Some(letter),
            'n' => Some('\n'),
            'r' => Some('\r'),
            't' => Some('\t'),
            'x' => {
                let digits = self
                    .remaining_text()
                    .get(..2)
                    .filter(|two| two.bytes().all(|b| b.is_ascii_hexdigit()))?;
                self.at += 2;
                u8::from_str_radix(digits, 16).ok().filter(u8::is_ascii).map(char::from)
            }
            _ => None,
        }
    }

    fn unclosed_error(&self, start: usize) -> FilterError {
        FilterError::new(self.text, start..self.text.len(), "missing closing quote")
    }
}

/// Length of the word at the start of `text`, in bytes; 0 if there is none.
fn word_length(text: &str) -> usize {
    let belongs = |letter: char| letter.is_alphanumeric() || matches!(letter, '_' | '-' | '.' | ':');
    let length = text.find(|letter| !belongs(letter)).unwrap_or(text.len());
    let word = text.get(..length).unwrap_or_default();
    word.find("..").unwrap_or(length)
}

fn unexpected_text(letter: char) -> String {
    match letter {
        '=' => "use == to compare".into(),
        '&' => "use && or and".into(),
        '|' => "use || or or".into(),
        '~' => "use matches".into(),
        '\'' => "use double quotes for text".into(),
        _ => format!("unexpected '{letter}'; use double quotes for text"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinds(text: &str) -> Vec<FilterToken> {
        split_tokens(text).unwrap().into_iter().map(|(token, _)| token).collect()
    }

    fn word(text: &str) -> FilterToken {
        FilterToken::Word(Operand::from_word(text, 0..0))
    }

    #[test]
    fn words_need_no_spaces_around_signs() {
        let equal = FilterToken::Relation(RelationalOperator::Equal);
        assert_eq!(
            kinds("node==-5&&!x"),
            [
                word("node"),
                equal,
                word("-5"),
                FilterToken::And,
                FilterToken::Not,
                word("x"),
                FilterToken::End
            ]
        );
    }

    #[test]
    fn two_dots_split_words() {
        let expected = [
            FilterToken::OpenSet,
            word("0x100"),
            FilterToken::Range,
            word("0x1FF"),
            word("1.5"),
            FilterToken::CloseSet,
            FilterToken::End,
        ];
        assert_eq!(kinds("{0x100..0x1FF 1.5}"), expected);
    }

    #[test]
    fn quoted_texts() {
        let text = |text: &str| match split_tokens(text).map(|all| all[0].0.clone()) {
            Ok(FilterToken::Word(operand)) => Ok(operand.text),
            Ok(other) => panic!("{other:?}"),
            Err(error) => Err(error.at()),
        };
        assert_eq!(text(r#""a\"b\\\n\x41""#), Ok("a\"b\\\nA".into()));
        assert_eq!(text(r#"r"\d+""#), Ok(r"\d+".into()));
        assert_eq!(text(r#""\d""#), Err(1..3));
        assert_eq!(text(r#""\xFF""#), Err(1..5));
        assert_eq!(text(r#""abc"#), Err(0..4));
        assert_eq!(text(r#"r"abc"#), Err(0..5));
    }

    #[test]
    fn places_are_bytes() {
        let places: Vec<_> = split_tokens("ä in").unwrap().into_iter().map(|(_, at)| at).collect();
        assert_eq!(places, [0..2, 3..5, 5..5]);
        assert_eq!(split_tokens("a = 1").unwrap_err().at(), 2..3);
    }
}
