//! Marks that CiA's conformance test tool sets on identifier 7FF around each of its cases.
//!
//! ```text
//! begin  01 GG CC 00 00 00     end  02 GG CC 00 RR 00
//! ```
//!
//! GG is the group, CC the case, RR the tool's result. Read from a published run: the layout is the tool's own.

/// How the tool judged a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TestResult {
    /// Passed (01).
    Passed,
    /// Passed with a warning (03).
    Warning,
    /// Failed (04).
    Failed,
    /// Not run (05).
    Skipped,
    /// Anything else.
    Other(u8),
}

impl TestResult {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Warning => "warning",
            Self::Failed => "failed",
            Self::Skipped => "skipped",
            Self::Other(_) => "unknown",
        }
    }
}

/// One mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TestMarker {
    /// Group of cases.
    pub group: u8,
    /// Case within it.
    pub case: u8,
    /// Of the mark at its end: the result.
    pub result: Option<TestResult>,
}

/// Reads a mark; `None` if it is none.
pub fn parse(data: &[u8]) -> Option<TestMarker> {
    match *data {
        [1, group, case, 0, 0, 0] => Some(TestMarker { group, case, result: None }),
        [2, group, case, 0, result, 0] => {
            let result = match result {
                1 => TestResult::Passed,
                3 => TestResult::Warning,
                4 => TestResult::Failed,
                5 => TestResult::Skipped,
                other => TestResult::Other(other),
            };
            Some(TestMarker { group, case, result: Some(result) })
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_have_six_bytes_of_fixed_form() {
        let begin = TestMarker { group: 7, case: 0x65, result: None };
        assert_eq!(parse(&[1, 7, 0x65, 0, 0, 0]), Some(begin));
        let end = TestMarker { result: Some(TestResult::Skipped), ..begin };
        assert_eq!(parse(&[2, 7, 0x65, 0, 5, 0]), Some(end));
        for other in [&[1, 7, 0x65, 0, 0][..], &[1, 7, 0x65, 1, 0, 0], &[3, 7, 0x65, 0, 0, 0], &[]] {
            assert_eq!(parse(other), None, "{other:?}");
        }
    }
}
