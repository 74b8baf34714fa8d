//! Splits a DBC into statements, so that an error in one does not affect the others.
//!
//! ```text
//! BO_ 100 Name: 8 Node          a message: its line and the SG_ lines below it
//!  SG_ Signal : 0|8@1+ …
//! VAL_ 100 Signal 0 "off" ;     all other statements: up to the semicolon outside a string
//! ```
//!
//! A statement starts at the start of a line. After an error, parsing resumes at the next line that starts a
//! statement; an unclosed string ends before the next message.

use std::ops::Range;

use super::{LONGEST_STRING, MOST_PROBLEMS};

/// Kind of a statement, by its first keyword.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum StatementKind {
    /// `BO_` with its `SG_`.
    Message,
    /// `VAL_TABLE_`.
    ValueTable,
    /// `VAL_`.
    Values,
    /// `SIG_VALTYPE_`.
    FloatType,
    /// `SG_MUL_VAL_`.
    Multiplexed,
    /// `BA_`.
    Attribute,
    /// Ignored: comments, attribute definitions, groups, environment variables.
    Other,
    /// Ignored, without semicolon: `VERSION`, `BS_`, `BU_`.
    Line,
    /// `NS_`: list of keywords, one per line.
    Symbols,
}

/// Keywords at the start of a line.
const KEYWORDS: &[(&str, StatementKind)] = &[
    ("BO_", StatementKind::Message),
    ("VAL_TABLE_", StatementKind::ValueTable),
    ("VAL_", StatementKind::Values),
    ("SIG_VALTYPE_", StatementKind::FloatType),
    ("SG_MUL_VAL_", StatementKind::Multiplexed),
    ("BA_", StatementKind::Attribute),
    ("VERSION", StatementKind::Line),
    ("BS_", StatementKind::Line),
    ("BU_", StatementKind::Line),
    ("NS_", StatementKind::Symbols),
    ("CM_", StatementKind::Other),
    ("BA_DEF_", StatementKind::Other),
    ("BA_DEF_DEF_", StatementKind::Other),
    ("BA_DEF_REL_", StatementKind::Other),
    ("BA_REL_", StatementKind::Other),
    ("BA_DEF_DEF_REL_", StatementKind::Other),
    ("BA_DEF_SGTYPE_", StatementKind::Other),
    ("BA_SGTYPE_", StatementKind::Other),
    ("BO_TX_BU_", StatementKind::Other),
    ("SIG_GROUP_", StatementKind::Other),
    ("SIG_TYPE_REF_", StatementKind::Other),
    ("SIGTYPE_VALTYPE_", StatementKind::Other),
    ("SGTYPE_", StatementKind::Other),
    ("SGTYPE_VAL_", StatementKind::Other),
    ("EV_", StatementKind::Other),
    ("EV_DATA_", StatementKind::Other),
    ("ENVVAR_DATA_", StatementKind::Other),
    ("CAT_DEF_", StatementKind::Other),
    ("CAT_", StatementKind::Other),
    ("FILTER", StatementKind::Other),
];

/// Kind and position of a statement.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct DbcStatement {
    pub(super) kind: StatementKind,
    /// Range from its first word to its end, in bytes.
    pub(super) at: Range<usize>,
}

/// Position and reason of a syntax error.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct SyntaxError {
    pub(super) at: usize,
    pub(super) reason: &'static str,
}

/// Iterator over the statements of a text, in file order.
pub(super) struct DbcStatements<'a> {
    text: &'a str,
    at: usize,
    /// Whether text up to the next keyword is ignored: after an error, or the rest of `BU_`.
    recovering: bool,
    /// Number of unclosed strings; limited, because each one costs a search for its end.
    open_strings: usize,
}

impl<'a> DbcStatements<'a> {
    pub(super) const fn statements_in(text: &'a str) -> Self {
        Self { text, at: 0, recovering: false, open_strings: 0 }
    }

    /// Line at `at`, and start of the next one.
    fn line_at(&self, at: usize) -> (&'a str, usize) {
        let rest = self.text.get(at..).unwrap_or_default();
        let end = memchr::memchr(b'\n', rest.as_bytes()).unwrap_or(rest.len());
        (rest.get(..end).unwrap_or_default(), at + end + 1)
    }

    /// End of the statement at `start`: after its semicolon, or before a line that starts the next statement.
    ///
    /// # Errors
    /// Position of an unclosed string.
    fn statement_end(&self, start: usize) -> Result<usize, usize> {
        let bytes = self.text.as_bytes();
        let mut string = None;
        let mut at = start;
        while let Some(byte) = bytes.get(at) {
            let next = bytes.get(at + 1);
            match (string, byte) {
                (Some(_), b'\\') if next == Some(&b'"') => at += 1,
                (Some(_), b'"') => string = None,
                (Some(begin), b'\n') if at - begin > LONGEST_STRING || self.is_message(at + 1) => {
                    return Err(begin);
                }
                (None, b'"') => string = Some(at),
                (None, b';') => return Ok(at + 1),
                (None, b'\n') if statement_keyword(self.line_at(at + 1).0).is_some() => return Ok(at),
                (None, b'/') if next == Some(&b'/') => at = self.line_at(at).1 - 2,
                _ => {}
            }
            at += 1;
        }
        string.map_or(Ok(bytes.len()), Err)
    }

    /// Whether the line at `at` is the first one of a message, independent of its context.
    fn is_message(&self, at: usize) -> bool {
        let Some(rest) = self.line_at(at).0.trim_start().strip_prefix("BO_ ") else { return false };
        let Some((head, size)) = rest.split_once(':') else { return false };
        let mut words = head.split_whitespace();
        let id = words.next().is_some_and(|id| id.bytes().all(|byte| byte.is_ascii_digit()));
        let name = words.next().is_some_and(is_word);
        id && name
            && words.next().is_none()
            && size.trim_start().starts_with(|first: char| first.is_ascii_digit())
    }

    /// End of the message at `start`: after its last signal.
    fn end_of_message(&self, start: usize) -> usize {
        let (line, mut at) = self.line_at(start);
        let mut end = start + line.len();
        while at < self.text.len() {
            let (line, next) = self.line_at(at);
            if is_signal(line) {
                end = at + line.len();
            } else if !is_empty(line) {
                break;
            }
            at = next;
        }
        end
    }

    /// End of the keyword list at `start`: entries are indented, or alone on their line.
    fn end_of_symbols(&self, start: usize) -> usize {
        let mut at = self.line_at(start).1;
        while at < self.text.len() {
            let (line, next) = self.line_at(at);
            let is_symbol = line.starts_with([' ', '\t']) || is_word(line.trim());
            if !is_symbol && !line.trim().is_empty() {
                break;
            }
            at = next;
        }
        at.min(self.text.len())
    }

    /// Parses the statement at `start` and advances past it; `None` if the line is ignored.
    fn parse_statement(&mut self, line: &str, start: usize) -> Option<Result<DbcStatement, SyntaxError>> {
        let Some(kind) = statement_keyword(line) else {
            let reason = if is_signal(line) {
                "signal outside a message; skipped"
            } else {
                "unknown statement; skipped"
            };
            let reported = self.recovering || is_word(line.trim());
            self.recovering = true;
            return (!reported).then_some(Err(SyntaxError { at: start, reason }));
        };
        self.recovering = false;
        let end = match kind {
            StatementKind::Message => self.end_of_message(start),
            StatementKind::Symbols => self.end_of_symbols(start),
            StatementKind::Line => {
                // Node names may continue on indented lines.
                self.recovering = true;
                start + line.len()
            }
            _ => match self.statement_end(start) {
                Ok(end) => end,
                Err(at) => return Some(Err(self.open_string(at))),
            },
        };
        self.at = end;
        Some(Ok(DbcStatement { kind, at: start..end }))
    }

    /// Reports an unclosed string; parsing resumes on the line after its statement's first one.
    fn open_string(&mut self, at: usize) -> SyntaxError {
        self.recovering = true;
        self.open_strings += 1;
        if self.open_strings < MOST_PROBLEMS {
            return SyntaxError { at, reason: "missing closing quote of this string; statement skipped" };
        }
        self.at = self.text.len();
        SyntaxError { at, reason: "missing closing quote again; rest of the file skipped" }
    }
}

impl Iterator for DbcStatements<'_> {
    type Item = Result<DbcStatement, SyntaxError>;

    fn next(&mut self) -> Option<Self::Item> {
        while self.at < self.text.len() {
            let (line, next) = self.line_at(self.at);
            let start = self.at + (line.len() - line.trim_start().len());
            self.at = next;
            // Text after a semicolon belongs to the statement before it.
            if is_empty(line) || line.trim() == ";" {
                continue;
            }
            if let Some(found) = self.parse_statement(line.trim_start(), start) {
                return Some(found);
            }
        }
        None
    }
}

/// Keyword at the start of a line with further text; a keyword alone is an entry of `NS_`.
fn statement_keyword(line: &str) -> Option<StatementKind> {
    let line = line.trim_start();
    let end = line.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(line.len());
    let (word, rest) = line.split_at_checked(end)?;
    let kind = KEYWORDS.iter().find(|(name, _)| *name == word).map(|(_, kind)| *kind)?;
    (!rest.trim().is_empty()).then_some(kind)
}

fn is_signal(line: &str) -> bool {
    line.trim_start().strip_prefix("SG_").is_some_and(|rest| rest.starts_with([' ', '\t']))
}

fn is_empty(line: &str) -> bool {
    let line = line.trim_start();
    line.is_empty() || line.starts_with("//")
}

fn is_word(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

#[cfg(test)]
mod tests {
    use super::*;

    type Read<'a> = Result<(StatementKind, &'a str), (usize, &'static str)>;

    fn read(text: &str) -> Vec<Read<'_>> {
        let show = |it: Result<DbcStatement, SyntaxError>| match it {
            Ok(statement) => Ok((statement.kind, &text[statement.at])),
            Err(broken) => Err((broken.at, broken.reason)),
        };
        DbcStatements::statements_in(text).map(show).collect()
    }

    #[test]
    fn messages_with_their_signals_and_strings_over_lines() {
        let text = "VERSION \"\"\nNS_ :\n\tCM_\n\tBA_\nBS_:\nBU_: A\n B\n\nBO_ 1 M: 8 A\n\n SG_ a\n// SG_ x\n\tSG_ b\n\n\
                    CM_ \"BO_ \\\" ;\nVAL_ \";\nVAL_ 1 a 0 \"x;\"\n 1 \"y\" ;\nBA_ \"n\" 1\nBO_ 2 N: 8 A";
        let expected = [
            (StatementKind::Line, "VERSION \"\""),
            (StatementKind::Symbols, "NS_ :\n\tCM_\n\tBA_\n"),
            (StatementKind::Line, "BS_:"),
            (StatementKind::Line, "BU_: A"),
            (StatementKind::Message, "BO_ 1 M: 8 A\n\n SG_ a\n// SG_ x\n\tSG_ b"),
            (StatementKind::Other, "CM_ \"BO_ \\\" ;\nVAL_ \";"),
            (StatementKind::Values, "VAL_ 1 a 0 \"x;\"\n 1 \"y\" ;"),
            (StatementKind::Attribute, "BA_ \"n\" 1"),
            (StatementKind::Message, "BO_ 2 N: 8 A"),
        ];
        assert_eq!(read(text), expected.map(Ok));
    }

    #[test]
    fn what_is_broken_costs_no_other_statement() {
        let text = "hello there\nworld\nBO_ 1 M: 8 A\nCM_ \"open\nBO_ 2 N: 8 A\n SG_ a \"unit\" X\n\n; \nVAL_ 1 a 1 \"x\n";
        let expected = [
            Err((0, "unknown statement; skipped")),
            Ok((StatementKind::Message, "BO_ 1 M: 8 A")),
            Err((text.find("\"open").unwrap(), "missing closing quote of this string; statement skipped")),
            Ok((StatementKind::Message, "BO_ 2 N: 8 A\n SG_ a \"unit\" X")),
            Err((text.find("\"x").unwrap(), "missing closing quote of this string; statement skipped")),
        ];
        assert_eq!(read(text), expected);
        assert_eq!(read(" SG_ a : 0|1"), [Err((1, "signal outside a message; skipped"))]);
    }

    #[test]
    fn after_a_hundred_open_strings_reading_ends() {
        let text = "VAL_ \\\"\n".repeat(20_000);
        let found = read(&text);
        assert_eq!(found.len(), MOST_PROBLEMS);
        assert!(found[MOST_PROBLEMS - 1].unwrap_err().1.ends_with("rest of the file skipped"));
    }
}
