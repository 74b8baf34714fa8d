//! Syntax tree of a filter.

use std::fmt;
use std::ops::Range;

/// Relational operator of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RelationalOperator {
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

impl RelationalOperator {
    const fn sign(self) -> &'static str {
        match self {
            Self::Equal => "==",
            Self::NotEqual => "!=",
            Self::Less => "<",
            Self::LessOrEqual => "<=",
            Self::Greater => ">",
            Self::GreaterOrEqual => ">=",
        }
    }
}

/// A name or value with its position.
#[derive(Debug, Clone)]
pub(super) struct Operand {
    /// Text with escapes resolved.
    pub(super) text: String,
    /// Whether it is written in quotes.
    pub(super) is_quoted: bool,
    /// Position in the filter, in bytes.
    pub(super) at: Range<usize>,
}

impl Operand {
    pub(super) fn from_word(text: &str, at: Range<usize>) -> Self {
        Self { text: text.to_owned(), is_quoted: false, at }
    }

    pub(super) fn from_quoted(text: String, at: Range<usize>) -> Self {
        Self { text, is_quoted: true, at }
    }
}

/// Ignores the position.
impl PartialEq for Operand {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text && self.is_quoted == other.is_quoted
    }
}

/// Member of a set: a single value, or a range that includes both ends.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SetMember {
    pub(super) from: Operand,
    pub(super) to: Option<Operand>,
}

/// Condition on a field.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum FieldCondition {
    Present,
    Compare(RelationalOperator, Operand),
    In(Vec<SetMember>),
    Contains(Operand),
    Matches(Operand),
}

/// A filter or a part of it. `And` and `Or` have at least two parts.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Expression {
    And(Vec<Expression>),
    Or(Vec<Expression>),
    Not(Box<Expression>),
    Test { field: Operand, question: FieldCondition },
}

impl FieldCondition {
    /// The only value that fulfils the condition, if there is exactly one.
    fn only_answer(&self) -> Option<&str> {
        match self {
            Self::Compare(RelationalOperator::Equal, value) => Some(&value.text),
            Self::In(members) => match members.as_slice() {
                [SetMember { from, to: None }] => Some(&from.text),
                _ => None,
            },
            _ => None,
        }
    }

    /// Values in `==`, `!=` and sets; ranges excluded.
    fn condition_values(&self) -> Vec<&str> {
        match self {
            Self::Compare(RelationalOperator::Equal | RelationalOperator::NotEqual, value) => {
                vec![&value.text]
            }
            Self::In(members) => {
                let single = members.iter().filter(|member| member.to.is_none());
                single.map(|member| member.from.text.as_str()).collect()
            }
            _ => Vec::new(),
        }
    }
}

impl Expression {
    /// Collects values that fields of these names must equal for the filter to match.
    pub(super) fn collect_required<'a>(&'a self, is_meant: &dyn Fn(&str) -> bool, found: &mut Vec<&'a str>) {
        match self {
            Self::And(parts) => parts.iter().for_each(|part| part.collect_required(is_meant, found)),
            Self::Test { field, question } if is_meant(&field.text) => {
                if let Some(value) = question.only_answer() {
                    found.push(value);
                }
            }
            Self::Or(_) | Self::Not(_) | Self::Test { .. } => {}
        }
    }

    /// Collects all values that fields of these names are compared with, anywhere in the filter.
    pub(super) fn collect_compared<'a>(&'a self, is_meant: &dyn Fn(&str) -> bool, found: &mut Vec<&'a str>) {
        match self {
            Self::And(parts) | Self::Or(parts) => {
                for part in parts {
                    part.collect_compared(is_meant, found);
                }
            }
            Self::Not(inner) => inner.collect_compared(is_meant, found),
            Self::Test { field, question } if is_meant(&field.text) => {
                found.extend(question.condition_values());
            }
            Self::Test { .. } => {}
        }
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::And(parts) => {
                join_parts(parts, " && ", |part| matches!(part, Self::And(_) | Self::Or(_)), f)
            }
            Self::Or(parts) => join_parts(parts, " || ", |part| matches!(part, Self::Or(_)), f),
            Self::Not(inner) => match **inner {
                Self::Not(_) | Self::Test { question: FieldCondition::Present, .. } => write!(f, "!{inner}"),
                _ => write!(f, "!({inner})"),
            },
            Self::Test { field, question } => write!(f, "{field}{question}"),
        }
    }
}

fn join_parts(
    parts: &[Expression],
    sign: &str,
    needs_parentheses: fn(&Expression) -> bool,
    f: &mut fmt::Formatter<'_>,
) -> fmt::Result {
    for (place, part) in parts.iter().enumerate() {
        if place > 0 {
            f.write_str(sign)?;
        }
        if needs_parentheses(part) {
            write!(f, "({part})")?;
        } else {
            write!(f, "{part}")?;
        }
    }
    Ok(())
}

impl fmt::Display for FieldCondition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Present => Ok(()),
            Self::Compare(relation, operand) => write!(f, " {} {operand}", relation.sign()),
            Self::Contains(operand) => write!(f, " contains {operand}"),
            Self::Matches(operand) => write!(f, " matches {operand}"),
            Self::In(members) => {
                f.write_str(" in {")?;
                for (place, member) in members.iter().enumerate() {
                    let separator = if place > 0 { ", " } else { "" };
                    write!(f, "{separator}{}", member.from)?;
                    if let Some(to) = &member.to {
                        // Without the space, a trailing point would be parsed as part of `..`.
                        let gap =
                            if !member.from.is_quoted && member.from.text.ends_with('.') { " " } else { "" };
                        write!(f, "{gap}..{to}")?;
                    }
                }
                f.write_str("}")
            }
        }
    }
}

impl fmt::Display for Operand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if !self.is_quoted {
            return f.write_str(&self.text);
        }
        f.write_str("\"")?;
        for letter in self.text.chars() {
            match letter {
                '"' => f.write_str("\\\"")?,
                '\\' => f.write_str("\\\\")?,
                '\n' => f.write_str("\\n")?,
                '\r' => f.write_str("\\r")?,
                '\t' => f.write_str("\\t")?,
                '\0'..='\x1f' | '\x7f' => write!(f, "\\x{:02X}", u32::from(letter))?,
                _ => write!(f, "{letter}")?,
            }
        }
        f.write_str("\"")
    }
}
