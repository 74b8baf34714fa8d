//! Marks of CiA's conformance test tool: identifier 0x7FF says which case it runs.
//!
//! ```text
//! byte 0  1 begins, 2 ended   byte 1  group   byte 2  case   byte 4  result of one that ended   others 0
//! ```

use crate::frame::CanId;

/// The identifier of the marks. CiA 301 reserves it for nobody.
pub const IDENTIFIER: CanId = CanId::standard(0x7FF);

/// Groups of the test plan.
const GROUPS: u8 = 10;

/// One mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mark {
    /// Group of cases.
    pub group: u8,
    /// Case within the group.
    pub case: u8,
    /// What the tool found, once the case is over: 1 passed, 3 warning, 4 failed, 5 skipped.
    pub result: Option<u8>,
}

/// Reads a mark; `None` for anything else on its identifier.
pub const fn parse(data: &[u8]) -> Option<Mark> {
    match *data {
        [1, group @ 1..=GROUPS, case, 0, 0, 0] => Some(Mark { group, case, result: None }),
        [2, group @ 1..=GROUPS, case, 0, result, 0] => Some(Mark { group, case, result: Some(result) }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn begin_end_and_others() {
        let mark = parse(&[1, 8, 10, 0, 0, 0]);
        assert_eq!(mark, Some(Mark { group: 8, case: 10, result: None }));
        assert_eq!(parse(&[2, 8, 10, 0, 4, 0]).and_then(|mark| mark.result), Some(4));
        assert_eq!(parse(&[3, 8, 10, 0, 0, 0]), None);
        assert_eq!(parse(&[1, 11, 10, 0, 0, 0]), None);
        assert_eq!(parse(&[1, 8, 10, 0, 0]), None);
    }
}
