//! What of a file was left out or read by a guess, with its place, and no more of it than people can use.

use std::fmt;

use super::MOST_PROBLEMS;
use crate::profile::quoted::printable;
use crate::words::plural;

/// Characters of a reason.
const LONGEST_REASON: usize = 300;

/// Something in the file that is left out, or read only by a guess.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Problem {
    /// Line, from 1; 0 if the whole file is meant.
    pub line: usize,
    /// Column in characters, from 1; 0 if the whole line or file is meant.
    pub column: usize,
    /// What was found, and what was made of it. No control characters.
    pub reason: String,
}

/// `3:7: reason`, to stand behind the name of the file and a colon.
impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.line, self.column) {
            (0, _) => write!(f, " {}", self.reason),
            (line, 0) => write!(f, "{line}: {}", self.reason),
            (line, column) => write!(f, "{line}:{column}: {}", self.reason),
        }
    }
}

impl Problem {
    /// One of a place given in lines and columns.
    pub(super) fn new(line: usize, column: usize, reason: &str) -> Self {
        let reason = reason.chars().take(LONGEST_REASON).map(printable).collect();
        Self { line, column, reason }
    }
}

/// Problems of one text.
#[derive(Debug)]
pub(super) struct Problems<'a> {
    text: &'a str,
    list: Vec<Problem>,
    others: usize,
}

impl<'a> Problems<'a> {
    pub(super) const fn of(text: &'a str) -> Self {
        Self { text, list: Vec::new(), others: 0 }
    }

    /// One more, about what stands at byte `at`. The reason may hold what stands in the file.
    pub(super) fn add(&mut self, at: usize, reason: &str) {
        if self.list.len() >= MOST_PROBLEMS {
            self.others = self.others.saturating_add(1);
            return;
        }
        let before = self.text.get(..at).unwrap_or(self.text);
        let start = before.rfind('\n').map_or(0, |end| end + 1);
        let line = before.matches('\n').count() + 1;
        let column = before.get(start..).map_or(0, |before| before.chars().count()) + 1;
        self.list.push(Problem::new(line, column, reason));
    }

    /// One more, about the file.
    pub(super) fn add_of_file(&mut self, reason: &str) {
        if self.list.len() >= MOST_PROBLEMS {
            self.others = self.others.saturating_add(1);
        } else {
            self.list.push(Problem::new(0, 0, reason));
        }
    }

    /// All by place; the last one says how many were left out.
    pub(super) fn finish(mut self) -> Vec<Problem> {
        self.list.sort_by_key(|problem| (problem.line, problem.column));
        if self.others > 0 {
            self.list.push(Problem::new(0, 0, &plural(self.others, "more problem")));
        }
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_problems_the_first_are_told_and_the_rest_counted() {
        let text = "a\n  ä\u{1b}x\n";
        let mut problems = Problems::of(text);
        problems.add(text.find('x').unwrap(), "b\u{1b}");
        problems.add(0, "a");
        problems.add(text.len() + 1, "end");
        for _ in 0..MOST_PROBLEMS {
            problems.add(0, "z");
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
