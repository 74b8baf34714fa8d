//! Error in a filter, with its position.

use std::fmt;
use std::ops::Range;

use crate::marked_line::{MarkedLine, replace_control};

/// Error in a filter. `Display` prints the reason, then the filter with `^` below the position.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FilterError {
    reason: String,
    text: String,
    at: Range<usize>,
}

impl FilterError {
    /// `at` is the position in `text`, in bytes.
    pub(super) fn new(text: &str, at: Range<usize>, reason: impl Into<String>) -> Self {
        Self { reason: reason.into(), text: text.to_owned(), at }
    }

    /// Reason in one line, without position.
    pub fn reason(&self) -> &str {
        &self.reason
    }

    /// Position in the text of the filter, in bytes.
    pub fn at(&self) -> Range<usize> {
        self.at.clone()
    }
}

impl std::error::Error for FilterError {}

impl fmt::Display for FilterError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let MarkedLine { shown, carets } = MarkedLine::mark_place(&self.text, self.at());
        let reason: String = self.reason.chars().map(replace_control).collect();
        write!(f, "{reason}\n  {shown}\n  {carets}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_caret_is_below_the_error() {
        let error = FilterError::new("node == vier", 8..12, "wrong");
        assert_eq!(error.to_string(), "wrong\n  node == vier\n          ^^^^");
    }
}
