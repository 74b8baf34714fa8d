//! Problems in a database file with their positions: skipped parts and assumptions, limited in number.

use std::fmt;

use super::MOST_PROBLEMS;
use crate::profile::quoted::printable_char;
use crate::words::count_noun;

/// Max length of a reason, in characters.
const LONGEST_REASON: usize = 300;

/// A skipped part of a file, or an assumption about one.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct DbcProblem {
    /// Line, from 1; 0 for the whole file.
    pub line: usize,
    /// Column in characters, from 1; 0 for the whole line or file.
    pub column: usize,
    /// Problem and its effect, without control characters.
    pub reason: String,
}

/// `3:7: reason`, to be printed after the file name and a colon.
impl fmt::Display for DbcProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.line, self.column) {
            (0, _) => write!(f, " {}", self.reason),
            (line, 0) => write!(f, "{line}: {}", self.reason),
            (line, column) => write!(f, "{line}:{column}: {}", self.reason),
        }
    }
}

impl DbcProblem {
    /// Problem at a line and column.
    pub(super) fn new(line: usize, column: usize, reason: &str) -> Self {
        let reason = reason.chars().take(LONGEST_REASON).map(printable_char).collect();
        Self { line, column, reason }
    }
}

/// Collects the problems of one text.
#[derive(Debug)]
pub(super) struct DbcProblems<'a> {
    text: &'a str,
    list: Vec<DbcProblem>,
    others: usize,
}

impl<'a> DbcProblems<'a> {
    pub(super) const fn problems_in(text: &'a str) -> Self {
        Self { text, list: Vec::new(), others: 0 }
    }

    /// Adds a problem at byte `at`. The reason may contain text from the file.
    pub(super) fn add_problem(&mut self, at: usize, reason: &str) {
        if self.list.len() >= MOST_PROBLEMS {
            self.others = self.others.saturating_add(1);
            return;
        }
        let before = self.text.get(..at).unwrap_or(self.text);
        let start = before.rfind('\n').map_or(0, |end| end + 1);
        let line = before.matches('\n').count() + 1;
        let column = before.get(start..).map_or(0, |before| before.chars().count()) + 1;
        self.list.push(DbcProblem::new(line, column, reason));
    }

    /// Adds a problem of the whole file.
    pub(super) fn add_of_file(&mut self, reason: &str) {
        if self.list.len() >= MOST_PROBLEMS {
            self.others = self.others.saturating_add(1);
        } else {
            self.list.push(DbcProblem::new(0, 0, reason));
        }
    }

    /// All problems by position; the last one states the number of omitted ones.
    pub(super) fn finish(mut self) -> Vec<DbcProblem> {
        self.list.sort_by_key(|problem| (problem.line, problem.column));
        if self.others > 0 {
            self.list.push(DbcProblem::new(0, 0, &count_noun(self.others, "more problem")));
        }
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_problems_are_listed_and_all_are_counted() {
        let text = "a\n  ä\u{1b}x\n";
        let mut problems = DbcProblems::problems_in(text);
        problems.add_problem(text.find('x').unwrap(), "b\u{1b}");
        problems.add_problem(0, "a");
        problems.add_problem(text.len() + 1, "end");
        for _ in 0..MOST_PROBLEMS {
            problems.add_problem(0, "z");
        }
        let list = problems.finish();
        assert_eq!(list.len(), MOST_PROBLEMS + 1);
        let shown = |at: usize| list[at].to_string();
        assert_eq!((shown(0), shown(MOST_PROBLEMS - 2)), ("1:1: a".into(), "2:5: b\u{FFFD}".into()));
        assert_eq!(
            (shown(MOST_PROBLEMS - 1), shown(MOST_PROBLEMS)),
            ("3:1: end".into(), " 3 more problems".into())
        );
    }
}
