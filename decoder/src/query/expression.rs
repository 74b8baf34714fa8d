//! A filter as it was written.

use std::fmt;
use std::ops::Range;

/// How two values are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Relation {
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

impl Relation {
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

/// A name or value, and where it stands.
#[derive(Debug, Clone)]
pub(super) struct Operand {
    /// The text, escapes resolved.
    pub(super) text: String,
    /// It stands in quotes.
    pub(super) is_quoted: bool,
    /// Where, in bytes of the filter.
    pub(super) at: Range<usize>,
}

impl Operand {
    pub(super) fn word(text: &str, at: Range<usize>) -> Self {
        Self { text: text.to_owned(), is_quoted: false, at }
    }

    pub(super) fn quoted(text: String, at: Range<usize>) -> Self {
        Self { text, is_quoted: true, at }
    }
}

/// Wherever they stand.
impl PartialEq for Operand {
    fn eq(&self, other: &Self) -> bool {
        self.text == other.text && self.is_quoted == other.is_quoted
    }
}

/// One member of a set: a value, or a range with both its ends.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Member {
    pub(super) from: Operand,
    pub(super) to: Option<Operand>,
}

/// What a field is asked.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Question {
    Present,
    Compare(Relation, Operand),
    In(Vec<Member>),
    Contains(Operand),
    Matches(Operand),
}

/// A filter or a part of it. `And` and `Or` have two parts or more.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Expression {
    And(Vec<Expression>),
    Or(Vec<Expression>),
    Not(Box<Expression>),
    Test { field: Operand, question: Question },
}

impl Question {
    /// The one value a field must equal.
    fn only_answer(&self) -> Option<&str> {
        match self {
            Self::Compare(Relation::Equal, value) => Some(&value.text),
            Self::In(members) => match members.as_slice() {
                [Member { from, to: None }] => Some(&from.text),
                _ => None,
            },
            _ => None,
        }
    }

    /// Values a field is said to equal or not to equal.
    fn compared(&self) -> Vec<&str> {
        match self {
            Self::Compare(Relation::Equal | Relation::NotEqual, value) => vec![&value.text],
            Self::In(members) => {
                let single = members.iter().filter(|member| member.to.is_none());
                single.map(|member| member.from.text.as_str()).collect()
            }
            _ => Vec::new(),
        }
    }
}

impl Expression {
    /// Values that fields of these names must equal for the whole to be true.
    pub(super) fn required<'a>(&'a self, is_meant: &dyn Fn(&str) -> bool, found: &mut Vec<&'a str>) {
        match self {
            Self::And(parts) => parts.iter().for_each(|part| part.required(is_meant, found)),
            Self::Test { field, question } if is_meant(&field.text) => {
                if let Some(value) = question.only_answer() {
                    found.push(value);
                }
            }
            Self::Or(_) | Self::Not(_) | Self::Test { .. } => {}
        }
    }

    /// Values that fields of these names are compared with, wherever in it.
    pub(super) fn compared<'a>(&'a self, is_meant: &dyn Fn(&str) -> bool, found: &mut Vec<&'a str>) {
        match self {
            Self::And(parts) | Self::Or(parts) => {
                for part in parts {
                    part.compared(is_meant, found);
                }
            }
            Self::Not(inner) => inner.compared(is_meant, found),
            Self::Test { field, question } if is_meant(&field.text) => found.extend(question.compared()),
            Self::Test { .. } => {}
        }
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::And(parts) => joined(parts, " && ", |part| matches!(part, Self::And(_) | Self::Or(_)), f),
            Self::Or(parts) => joined(parts, " || ", |part| matches!(part, Self::Or(_)), f),
            Self::Not(inner) => match **inner {
                Self::Not(_) | Self::Test { question: Question::Present, .. } => write!(f, "!{inner}"),
                _ => write!(f, "!({inner})"),
            },
            Self::Test { field, question } => write!(f, "{field}{question}"),
        }
    }
}

fn joined(
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

impl fmt::Display for Question {
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
                        // A point at the end of a word would be read as one of the two.
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
