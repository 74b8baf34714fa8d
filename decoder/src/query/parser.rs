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
use super::expression::{Expression, FieldCondition, Member, Operand};
use super::lexer::{PositionedToken, Token, tokens};

/// Max length of a filter, in bytes.
pub const MAX_LENGTH: usize = 8 * 1024;

/// Max nesting depth of parentheses and negations.
pub const MAX_DEPTH: usize = 64;

/// Parses a filter into a syntax tree.
pub(super) fn parse(text: &str) -> Result<Expression, FilterError> {
    if text.len() > MAX_LENGTH {
        let reason = format!("filter too long (max {MAX_LENGTH} bytes)");
        return Err(FilterError::new(text, text.len()..text.len(), reason));
    }
    let mut parser = Parser { text, tokens: tokens(text)?, at: 0, depth: 0 };
    let expression = parser.or()?;
    match parser.peek() {
        Token::End => Ok(expression),
        Token::Close => Err(parser.error("closing parenthesis without an opening one")),
        _ => Err(parser.error("expected && or ||")),
    }
}

struct Parser<'a> {
    text: &'a str,
    tokens: Vec<PositionedToken>,
    at: usize,
    depth: usize,
}

impl Parser<'_> {
    fn peek(&self) -> &Token {
        self.tokens.get(self.at).map_or(&Token::End, |(token, _)| token)
    }

    /// Consumes the next token if it equals `token`.
    fn takes(&mut self, token: &Token) -> bool {
        let is_next = self.peek() == token && *token != Token::End;
        self.at += usize::from(is_next);
        is_next
    }

    /// Error at the next token.
    fn error(&self, reason: impl Into<String>) -> FilterError {
        let end = self.text.len();
        let at = self.tokens.get(self.at).map_or(end..end, |(_, at)| at.clone());
        FilterError::new(self.text, at, reason)
    }

    fn or(&mut self) -> Result<Expression, FilterError> {
        let first = self.and()?;
        let mut parts = Vec::new();
        while self.takes(&Token::Or) {
            parts.push(self.and()?);
        }
        Ok(with_first(first, parts, Expression::Or))
    }

    fn and(&mut self) -> Result<Expression, FilterError> {
        let first = self.unary()?;
        let mut parts = Vec::new();
        while self.takes(&Token::And) {
            parts.push(self.unary()?);
        }
        Ok(with_first(first, parts, Expression::And))
    }

    fn unary(&mut self) -> Result<Expression, FilterError> {
        if !matches!(self.peek(), Token::Not | Token::Open) {
            return self.test();
        }
        if self.depth == MAX_DEPTH {
            return Err(self.error(format!("nested too deep (max {MAX_DEPTH} levels)")));
        }
        self.depth += 1;
        let expression = if self.takes(&Token::Not) {
            Expression::Not(Box::new(self.unary()?))
        } else {
            self.takes(&Token::Open);
            let inner = self.or()?;
            if !self.takes(&Token::Close) {
                return Err(self.error("missing closing parenthesis"));
            }
            inner
        };
        self.depth -= 1;
        Ok(expression)
    }

    fn test(&mut self) -> Result<Expression, FilterError> {
        let nothing = self.tokens.len() == 1;
        let reason = if nothing { "empty filter" } else { "expected a field" };
        let field = match self.peek() {
            Token::Word(word) if !word.is_quoted => word.clone(),
            _ => return Err(self.error(reason)),
        };
        self.at += 1;
        let question = match *self.peek() {
            Token::Relation(relation) => {
                self.at += 1;
                FieldCondition::Compare(relation, self.value()?)
            }
            Token::Contains => {
                self.at += 1;
                FieldCondition::Contains(self.value()?)
            }
            Token::Matches => {
                self.at += 1;
                FieldCondition::Matches(self.value()?)
            }
            Token::In => {
                self.at += 1;
                FieldCondition::In(self.set()?)
            }
            _ => FieldCondition::Present,
        };
        Ok(Expression::Test { field, question })
    }

    fn value(&mut self) -> Result<Operand, FilterError> {
        let Token::Word(operand) = self.peek() else {
            return Err(self.error("expected a value"));
        };
        let operand = operand.clone();
        self.at += 1;
        Ok(operand)
    }

    fn set(&mut self) -> Result<Vec<Member>, FilterError> {
        if !self.takes(&Token::OpenSet) {
            return Err(self.error("expected a set, e.g. {1 2 5..7}"));
        }
        let mut members = Vec::new();
        loop {
            let from = self.value()?;
            let to = if self.takes(&Token::Range) { Some(self.value()?) } else { None };
            members.push(Member { from, to });
            let has_comma = self.takes(&Token::Comma);
            match self.peek() {
                Token::CloseSet if !has_comma => break,
                Token::End => return Err(self.error("missing closing brace of the set")),
                _ => {}
            }
        }
        self.takes(&Token::CloseSet);
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
        parse(text).map_or_else(|error| format!("{:?} {}", error.at(), error.reason()), |e| e.to_string())
    }

    #[test]
    fn and_binds_more_than_or_and_not_most() {
        assert_eq!(printed("a or b and not c == 1"), "a || b && !(c == 1)");
        assert_eq!(parse("a || b && c").unwrap(), parse("a || (b && c)").unwrap());
        assert_ne!(parse("a || b && c").unwrap(), parse("(a || b) && c").unwrap());
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
        assert!(parse(&format!("{}a", "!".repeat(MAX_DEPTH))).is_ok());
        assert!(parse(&format!("{}a", "!".repeat(MAX_DEPTH + 1))).is_err());
        assert!(parse(&"a".repeat(MAX_LENGTH + 1)).is_err());
        let wide = vec!["a"; 1_000].join("||");
        assert!(parse(&wide).is_ok());
    }
}
