//! Text of a transfer with its value, or the reason of its failure, before all names.
//!
//! ```text
//! 1003:00 = 1, Pre-defined error field, Number of errors
//! 22 F1FF REFUSED 31: out of range, read-data-by-identifier
//! 65260 (FEEC) VI incomplete, 1 packet missing, 21 of 28 bytes: 41 42 … | vehicle identification
//! ```

/// Parts of the text of an SDO transfer, a UDS exchange or a J1939 transport session.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TransferWords {
    /// Object, service with its identifier, or parameter group.
    pub object: String,
    /// Names of object, service and group; may be empty.
    pub name: String,
    /// Value or reason of the failure, and the consequence; a value starts with `=`.
    pub result: String,
}

impl TransferWords {
    /// All parts in one text.
    pub fn joined_text(&self) -> String {
        let Self { object, name, result } = self;
        let separator = match (name.is_empty(), result.contains(" | ")) {
            (true, _) => "",
            (false, true) => " | ",
            (false, false) => ", ",
        };
        let blank = if result.is_empty() { "" } else { " " };
        format!("{object}{blank}{result}{separator}{name}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_follow_the_result() {
        let news = |object: &str, result: &str, name: &str| {
            TransferWords { object: object.into(), name: name.into(), result: result.into() }.joined_text()
        };
        assert_eq!(news("1003:00", "= 1", "Number of errors"), "1003:00 = 1, Number of errors");
        assert_eq!(news("1017:00", "= 0 ms | active now", "time"), "1017:00 = 0 ms | active now | time");
        assert_eq!(news("object unknown", "", ""), "object unknown");
    }
}
