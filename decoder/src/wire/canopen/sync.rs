//! SYNC (CiA 301 §7.2.5.3): identifier 0x80 by default, no data or one counter byte.

/// Counter, 1..=240; `None` for a SYNC without data.
pub const fn parse(data: &[u8]) -> Option<u8> {
    match data {
        [counter, ..] => Some(*counter),
        [] => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_and_without_counter() {
        assert_eq!(parse(&[]), None);
        assert_eq!(parse(&[240]), Some(240));
    }
}
