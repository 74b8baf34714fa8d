//! Grammar of filters.
//!
//! ```text
//! or     = and { ("||" | "or") and }
//! and    = unary { ("&&" | "and") unary }
//! unary  = ("!" | "not") unary | "(" or ")" | test
//! test   = field [ relation value | "in" set | "contains" value | "matches" value ]
//! set    = "{" member { [","] member } "}"
//! member = value [ ".." value ]
//! ```

use super::error::FilterError;
use super::expression::{Expression, FieldCondition, Operand, SetMember};
use super::lexer::{FilterToken, PositionedToken, split_tokens};

/// Max length of a filter, in bytes.
pub const MAX_LENGTH: usize = 8 * 1024;

/// Max nesting depth of parentheses and negations.
pub const MAX_DEPTH: usize = 64;

/// Parses a filter into a syntax tree.
pub(super) fn parse_filter(text: &str) -> Result<Expression, FilterError> {
    if text.len() > MAX_LENGTH {
        let reason = format!("filter too long (max {MAX_LENGTH} bytes)");
        return Err(FilterError::new(text, text.len()..text.len(), reason));
    }
    let mut parser = FilterParser { text, tokens: split_tokens(text)?, at: 0, depth: 0 };
    let expression = parser.parse_or()?;
    match parser.peek_token() {
        FilterToken::End => Ok(expression),
        FilterToken::Close => Err(parser.error_here("closing parenthesis without an opening one")),
        _ => Err(parser.error_here("expected && or ||")),
    }
}

struct FilterParser<'a> {
    text: &'a str,
    tokens: Vec<PositionedToken>,
    at: usize,
    depth: usize,
}

impl FilterParser<'_> {
    fn peek_token(&self) -> &FilterToken {
        self.tokens.get(self.at).map_or(&FilterToken::End, |(token, _)| token)
    }

    /// Consumes the next token if it equals `token`.
    fn take_if(&mut self, token: &FilterToken) -> bool {
        let is_next = self.peek_token() == token && *token != FilterToken::End;
        self.at += usize::from(is_next);
        is_next
    }

    /// Error at the next token.
    fn error_here(&self, reason: impl Into<String>) -> FilterError {
        let end = self.text.len();
        let at = self.tokens.get(self.at).map_or(end..end, |(_, at)| at.clone());
        FilterError::new(self.text, at, reason)
    }

    fn parse_or(&mut self) -> Result<Expression, FilterError> {
        let first = self.parse_and()?;
        let mut parts = Vec::new();
        while self.take_if(&FilterToken::Or) {
            parts.push(self.parse_and()?);
        }
        Ok(with_first(first, parts, Expression::Or))
    }

    fn parse_and(&mut self) -> Result<Expression, FilterError> {
        let first = self.parse_unary()?;
        let mut parts = Vec::new();
        while self.take_if(&FilterToken::And) {
            parts.push(self.parse_unary()?);
        }
        Ok(with_first(first, parts, Expression::And))
    }

    fn parse_unary(&mut self) -> Result<Expression, FilterError> {
        if !matches!(self.peek_token(), FilterToken::Not | FilterToken::Open) {
            return self.parse_test();
        }
        if self.depth == MAX_DEPTH {
            return Err(self.error_here(format!("nested too deep (max {MAX_DEPTH} levels)")));
        }
        self.depth += 1;
        let expression = if self.take_if(&FilterToken::Not) {
            Expression::Not(Box::new(self.parse_unary()?))
        } else {
            self.take_if(&FilterToken::Open);
            let inner = self.parse_or()?;
            if !self.take_if(&FilterToken::Close) {
                return Err(self.error_here("missing closing parenthesis"));
            }
            inner
        };
        self.depth -= 1;
        Ok(expression)
    }

    fn parse_test(&mut self) -> Result<Expression, FilterError> {
        let nothing = self.tokens.len() == 1;
        let reason = if nothing { "empty filter" } else { "expected a field" };
        let field = match self.peek_token() {
            FilterToken::Word(word) if !word.is_quoted => word.clone(),
            _ => return Err(self.error_here(reason)),
        };
        self.at += 1;
        let question = match *self.peek_token() {
            FilterToken::Relation(relation) => {
                self.at += 1;
                FieldCondition::Compare(relation, self.parse_value()?)
            }
            FilterToken::Contains => {
                self.at += 1;
                FieldCondition::Contains(self.parse_value()?)
            }
            FilterToken::Matches => {
                self.at += 1;
                FieldCondition::Matches(self.parse_value()?)
            }
            FilterToken::In => {
                self.at += 1;
                FieldCondition::In(self.parse_set()?)
            }
            _ => FieldCondition::Present,
        };
        Ok(Expression::Test { field, question })
    }

    fn parse_value(&mut self) -> Result<Operand, FilterError> {
        let FilterToken::Word(operand) = self.peek_token() else {
            return Err(self.error_here("expected a value"));
        };
        let operand = operand.clone();
        self.at += 1;
        Ok(operand)
    }

    fn parse_set(&mut self) -> Result<Vec<SetMember>, FilterError> {
        if !self.take_if(&FilterToken::OpenSet) {
            return Err(self.error_here("expected a set, e.g. {1 2 5..7}"));
        }
        let mut members = Vec::new();
        loop {
            let from = self.parse_value()?;
            let to = if self.take_if(&FilterToken::Range) { Some(self.parse_value()?) } else { None };
            members.push(SetMember { from, to });
            let has_comma = self.take_if(&FilterToken::Comma);
            match self.peek_token() {
                FilterToken::CloseSet if !has_comma => break,
                FilterToken::End => return Err(self.error_here("missing closing brace of the set")),
                _ => {}
            }
        }
        self.take_if(&FilterToken::CloseSet);
        Ok(members)
    }
}

/// Joins the parts; a single part is returned as it is.
fn with_first(
    first: Expression,
    mut others: Vec<Expression>,
    join: fn(Vec<Expression>) -> Expression,
) -> Expression {
    if others.is_empty() {
        return first;
    }
    others.insert(0, first);
    join(others)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn printed(text: &str) -> String {
        parse_filter(text)
            .map_or_else(|error| format!("{:?} {}", error.at(), error.reason()), |e| e.to_string())
    }

    #[test]
    fn and_binds_more_than_or_and_not_most() {
        assert_eq!(printed("a or b and not c == 1"), "a || b && !(c == 1)");
        assert_eq!(parse_filter("a || b && c").unwrap(), parse_filter("a || (b && c)").unwrap());
        assert_ne!(parse_filter("a || b && c").unwrap(), parse_filter("(a || b) && c").unwrap());
        assert_eq!(printed("((a) || b) && !!c"), "(a || b) && !!c");
    }

    #[test]
    fn words_stand_for_signs() {
        let words = "a eq 1 and b ne 2 and c lt 3 and d le 4 and e gt 5 and f ge 6";
        assert_eq!(printed(words), "a == 1 && b != 2 && c < 3 && d <= 4 && e > 5 && f >= 6");
    }

    #[test]
    fn sets() {
        assert_eq!(printed("a in {1 2,3 .. 4 \"x\"..\"y\"}"), "a in {1, 2, 3..4, \"x\"..\"y\"}");
        assert_eq!(printed("a in {1. ..4 x..y}"), "a in {1. ..4, x..y}");
        assert_eq!(printed("a in {}"), "6..7 expected a value");
        assert_eq!(printed("a in {1,}"), "8..9 expected a value");
        assert_eq!(printed("a in {1"), "7..7 missing closing brace of the set");
        assert_eq!(printed("a in 1"), "5..6 expected a set, e.g. {1 2 5..7}");
    }

    #[test]
    fn errors_have_places() {
        assert_eq!(printed(""), "0..0 empty filter");
        assert_eq!(printed("a &&"), "4..4 expected a field");
        assert_eq!(printed("a =="), "4..4 expected a value");
        assert_eq!(printed("a == and"), "5..8 expected a value");
        assert_eq!(printed("(a"), "2..2 missing closing parenthesis");
        assert_eq!(printed("a)"), "1..2 closing parenthesis without an opening one");
        assert_eq!(printed("a b"), "2..3 expected && or ||");
        assert_eq!(printed("\"a\" == 1"), "0..3 expected a field");
    }

    #[test]
    fn hostile_filters_are_refused_not_run_into() {
        let deep = format!("{}a{}", "(".repeat(4_000), ")".repeat(4_000));
        assert_eq!(printed(&deep), "64..65 nested too deep (max 64 levels)");
        assert!(parse_filter(&format!("{}a", "!".repeat(MAX_DEPTH))).is_ok());
        assert!(parse_filter(&format!("{}a", "!".repeat(MAX_DEPTH + 1))).is_err());
        assert!(parse_filter(&"a".repeat(MAX_LENGTH + 1)).is_err());
        let wide = vec!["a"; 1_000].join("||");
        assert!(parse_filter(&wide).is_ok());
    }
}
