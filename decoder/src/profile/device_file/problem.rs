//! Problems in a device file with their lines: skipped parts and assumptions, limited in number.

use std::fmt;

use super::MOST_PROBLEMS;
use crate::profile::quoted::printable_char;
use crate::words::count_noun;

/// Max length of a reason, in characters.
const LONGEST_REASON: usize = 300;

/// A skipped part of a file, or an assumption about one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DescriptionProblem {
    /// Line, from 1; 0 for the whole file.
    pub line: usize,
    /// Problem, and the expected form or the effect; without control characters.
    pub reason: String,
}

/// Prints `line 3: reason`.
impl fmt::Display for DescriptionProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => f.write_str(&self.reason),
            line => write!(f, "line {line}: {}", self.reason),
        }
    }
}

/// Collects the problems of one file.
#[derive(Debug, Default)]
pub(super) struct DescriptionProblems {
    list: Vec<DescriptionProblem>,
    others: usize,
}

impl DescriptionProblems {
    /// Adds a problem. The reason may contain text from the file.
    pub(super) fn add_problem(&mut self, line: usize, reason: impl Into<String>) {
        if self.list.len() < MOST_PROBLEMS {
            let reason = reason.into().chars().take(LONGEST_REASON).map(printable_char).collect();
            self.list.push(DescriptionProblem { line, reason });
        } else {
            self.others = self.others.saturating_add(1);
        }
    }

    /// All problems by line; the last one states the number of omitted ones.
    pub(super) fn finish(mut self) -> Vec<DescriptionProblem> {
        self.list.sort_by_key(|problem| problem.line);
        if self.others > 0 {
            self.list.push(DescriptionProblem { line: 0, reason: count_noun(self.others, "more problem") });
        }
        self.list
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_problems_are_listed_and_all_are_counted() {
        let mut problems = DescriptionProblems::default();
        for line in 1..=MOST_PROBLEMS + 5 {
            problems.add_problem(line, "x");
        }
        let list = problems.finish();
        assert_eq!(list.len(), MOST_PROBLEMS + 1);
        assert_eq!(list.last().unwrap().to_string(), "5 more problems");
        assert_eq!(list[0].to_string(), "line 1: x");
    }
}
