//! Parses numbers in device files.
//!
//! CiA 306-1 §4 defines decimal, hexadecimal (`0x1F`) and octal (`017`) numbers. No known file uses octal:
//! leading zeros are padding (`FileRevision=08`, `VendorNumber=001`). They are therefore read as decimal, and
//! reported if the octal value differs.

/// A number with its notation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct NotedInteger {
    /// Value from -(2^64 - 1) to 2^64 - 1.
    pub(super) value: i128,
    /// Whether it is hexadecimal; with a signed type it can be the bits of a negative number.
    pub(super) is_hex: bool,
    /// Note about an ambiguous notation.
    pub(super) doubt: Option<&'static str>,
}

/// Parses a number; `None` for other text or more than 64 bits.
pub(super) fn parse_integer(text: &str) -> Option<NotedInteger> {
    let text = text.trim();
    let (is_negative, unsigned) = match text.strip_prefix('-') {
        Some(rest) => (true, rest),
        None => (false, text.strip_prefix('+').unwrap_or(text)),
    };
    let (radix, digits, doubt) = split_notation(unsigned);
    if digits.is_empty() || !digits.chars().all(|digit| digit.is_digit(radix)) {
        return None;
    }
    let value = i128::from(u64::from_str_radix(digits, radix).ok()?);
    Some(NotedInteger { value: if is_negative { -value } else { value }, is_hex: radix == 16, doubt })
}

fn split_notation(text: &str) -> (u32, &str, Option<&'static str>) {
    if let Some(digits) = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
        return (16, digits, None);
    }
    if let Some(digits) = text.strip_suffix(['h', 'H'])
        && digits.starts_with(|first: char| first.is_ascii_digit())
    {
        return (16, digits, Some("read as hexadecimal; expected the prefix 0x"));
    }
    let is_octal_too = text.starts_with('0')
        && text.trim_start_matches('0').len() > 1
        && text.chars().all(|digit| digit.is_digit(8));
    (10, text, is_octal_too.then_some("read as decimal, although a leading zero can mean octal"))
}

/// Offset of a `$NODEID` formula; `None` for other text. Accepts one `$NODEID` in any letter case and any
/// number of summands, in any order.
pub(super) fn parse_formula(text: &str) -> Option<u64> {
    let mut offset = 0_u64;
    let mut node_ids = 0_usize;
    for summand in text.split('+').map(str::trim) {
        if summand.eq_ignore_ascii_case("$NODEID") {
            node_ids = node_ids.saturating_add(1);
        } else {
            offset = offset.checked_add(u64::try_from(parse_integer(summand)?.value).ok()?)?;
        }
    }
    (node_ids == 1).then_some(offset)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value(text: &str) -> Option<i128> {
        parse_integer(text).map(|integer| integer.value)
    }

    #[test]
    fn decimal_and_hexadecimal() {
        assert_eq!(value(" 42 "), Some(42));
        assert_eq!(value("-78"), Some(-78));
        assert_eq!(value("0x1F"), Some(31));
        assert_eq!(value("0XfF"), Some(255));
        assert_eq!(value("-0x80000000"), Some(-2_147_483_648));
        assert_eq!(value("0xFFFFFFFFFFFFFFFF"), Some(i128::from(u64::MAX)));
        assert_eq!(value("0x0000000000000000000000001"), Some(1));
        assert_eq!(value("00A0h"), Some(160));
    }

    #[test]
    fn anything_else_is_no_number() {
        for text in
            ["", "-", "+", "0x", "0x+1", "1 2", "1.5", "h", "Ah", "0xG", "--1", "10000000000000000000000"]
        {
            assert_eq!(parse_integer(text), None, "{text}");
        }
    }

    #[test]
    fn leading_zeros_are_padding_and_doubted_only_where_octal_differs() {
        for (text, expected, doubted) in
            [("001", 1, false), ("08", 8, false), ("0", 0, false), ("00", 0, false), ("010", 10, true)]
        {
            let integer = parse_integer(text).unwrap();
            assert_eq!((integer.value, integer.doubt.is_some()), (expected, doubted), "{text}");
        }
    }

    #[test]
    fn formulas_in_every_spelling() {
        for text in
            ["$NODEID+0x180", "$NodeID + 0x180", "0x180+$NODEID", "384 + $nodeid", "$NODEID+0x100+0x80"]
        {
            assert_eq!(parse_formula(text), Some(0x180), "{text}");
        }
        assert_eq!(parse_formula("$NODEID"), Some(0));
        for text in
            ["0x180", "$NODEID-1", "$NODEID+$NODEID", "$NODEID+", "$NODE+1", "$NODEID+0xFFFFFFFFFFFFFFFF+1"]
        {
            assert_eq!(parse_formula(text), None, "{text}");
        }
    }
}
