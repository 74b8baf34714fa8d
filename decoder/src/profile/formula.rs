//! Formulas with the node-ID in profiles and device files: `$NODEID+0x180` (CiA 306-1 §4.6.3).

/// Evaluates `$NODEID+0x180`, `0x180+$NODEID`, `$NODEID-0x80`, `0x1A0`, with spaces, in any letter case.
/// `None` for other text, for results below 0, and if the required node-ID is unknown.
pub fn evaluate_formula(text: &str, node: Option<u8>) -> Option<u64> {
    let mut sum: u64 = 0;
    for part in text.replace('-', "+-").split('+').map(str::trim) {
        let (is_less, part) = part.strip_prefix('-').map_or((false, part), |rest| (true, rest.trim()));
        let number = if part.eq_ignore_ascii_case("$NODEID") {
            u64::from(node?)
        } else {
            match part.strip_prefix("0x").or_else(|| part.strip_prefix("0X")) {
                Some(digits) => u64::from_str_radix(digits, 16).ok()?,
                None => part.parse().ok()?,
            }
        };
        sum = if is_less { sum.checked_sub(number)? } else { sum.checked_add(number)? };
    }
    Some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formulas_of_identifiers() {
        assert_eq!(evaluate_formula("$NODEID+0x180", Some(5)), Some(0x185));
        assert_eq!(evaluate_formula("0x180 + $nodeid", Some(5)), Some(0x185));
        assert_eq!(evaluate_formula("0x1A0", None), Some(0x1A0));
        assert_eq!(evaluate_formula("384", Some(5)), Some(0x180));
        assert_eq!(evaluate_formula("$NODEID-0x80", Some(0x83)), Some(3));
        assert_eq!(evaluate_formula("$NODEID - 0x80", Some(5)), None);
        assert_eq!(evaluate_formula("$NODEID+", Some(5)), None);
        assert_eq!(evaluate_formula("$NODEID+0x180", None), None);
        assert_eq!(evaluate_formula("$NODE+1", Some(5)), None);
        assert_eq!(evaluate_formula("", Some(5)), None);
        assert_eq!(evaluate_formula("0xFFFFFFFFFFFFFFFF+1", None), None);
    }
}
