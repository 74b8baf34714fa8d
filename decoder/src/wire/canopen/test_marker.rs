//! Markers that the conformance test tool of CiA sends on identifier 7FF around each test case.
//!
//! ```text
//! begin  01 GG CC 00 00 00     end  02 GG CC 00 RR 00
//! ```
//!
//! GG is the group, CC the case, RR the result. The layout is specific to the tool; the source is a
//! published test run.

use nom::Parser;
use nom::branch::alt;
use nom::bytes::complete::tag;
use nom::combinator::all_consuming;
use nom::number::complete::u8 as byte;

use crate::wire::parser::Parsed;

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
    const fn from_code(code: u8) -> Self {
        match code {
            1 => Self::Passed,
            3 => Self::Warning,
            4 => Self::Failed,
            5 => Self::Skipped,
            other => Self::Other(other),
        }
    }

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
    parse_fields(data).ok().map(|(_, marker)| marker)
}

fn parse_fields(data: &[u8]) -> Parsed<'_, TestMarker> {
    let begin = (tag(&[1][..]), byte, byte, tag(&[0, 0, 0][..])).map(|(_, group, case, _)| TestMarker {
        group,
        case,
        result: None,
    });
    let end = (tag(&[2][..]), byte, byte, tag(&[0][..]), byte.map(TestResult::from_code), tag(&[0][..]))
        .map(|(_, group, case, _, result, _)| TestMarker { group, case, result: Some(result) });
    all_consuming(alt((begin, end))).parse_complete(data)
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
