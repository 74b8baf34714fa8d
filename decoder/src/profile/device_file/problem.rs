//! What could not be read, with its line, and no more of it than people can use.

use std::fmt;

use super::MOST_PROBLEMS;
use crate::profile::quoted::printable;
use crate::words::plural;

/// Characters of a reason.
const LONGEST_REASON: usize = 300;

/// Something in the file that could not be read, or only by a guess.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// Line, from 1; 0 if the whole file is meant.
    pub line: usize,
    /// What was found and what was expected or made of it. No control characters.
    pub reason: String,
}

/// `line 3: reason`
impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => f.write_str(&self.reason),
            line => write!(f, "line {line}: {}", self.reason),
        }
    }
}

/// Problems in the order they were found.
#[derive(Debug, Default)]
pub(super) struct Problems {
    list: Vec<Problem>,
    others: usize,
}

impl Problems {
    /// One more. Its reason may hold what stands in the file.
    pub(super) fn add(&mut self, line: usize, reason: impl Into<String>) {
        if self.list.len() < MOST_PROBLEMS {
            let reason = reason.into().chars().take(LONGEST_REASON).map(printable).collect();
            self.list.push(Problem { line, reason });
        } else {
            self.others = self.others.saturating_add(1);
        }
    }

    /// All by line; the last one says how many were left out.
    pub(super) fn finish(mut self) -> Vec<Problem> {
        self.list.sort_by_key(|problem| problem.line);
        if self.others > 0 {
            self.list.push(Problem { line: 0, reason: plural(self.others, "more problem") });
        }
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_many_problems_the_first_are_told_and_the_rest_counted() {
        let mut problems = Problems::default();
        for line in 1..=MOST_PROBLEMS + 5 {
            problems.add(line, "x");
        }
        let list = problems.finish();
        assert_eq!(list.len(), MOST_PROBLEMS + 1);
        assert_eq!(list.last().unwrap().to_string(), "5 more problems");
        assert_eq!(list[0].to_string(), "line 1: x");
    }
}
