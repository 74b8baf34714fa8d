//! Markers that the conformance test tool of CiA sends on identifier 7FF around each test case.
//!
//! ```text
//! begin  01 GG CC 00 00 00     end  02 GG CC 00 RR 00
//! ```
//!
//! GG is the group, CC the case, RR the result. The layout is specific to the tool; the source is a
//! published test run.

/// Result of a test case.
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
    /// Any other code.
    Other(u8),
}

impl TestResult {
    /// Name used in all output.
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

/// Marker at the start or end of a test case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TestMarker {
    /// Group of test cases.
    pub group: u8,
    /// Test case within the group.
    pub case: u8,
    /// Result; `None` in the start marker.
    pub result: Option<TestResult>,
}

/// Reads a marker; `None` if the payload is not a marker.
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
