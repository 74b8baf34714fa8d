//! Sizes as options take them.

/// `100M`: bytes, with k, M or G for powers of 1,024.
pub(super) fn bytes(text: &str) -> Result<u64, String> {
    let wrong = || format!("found {text}, expected a size such as 100M or 2G");
    let (number, unit) = match text.char_indices().last() {
        Some((at, 'k' | 'K')) => (text.get(..at), 10),
        Some((at, 'M')) => (text.get(..at), 20),
        Some((at, 'G')) => (text.get(..at), 30),
        _ => (Some(text), 0),
    };
    let number: u64 = number.and_then(|number| number.parse().ok()).ok_or_else(wrong)?;
    number.checked_mul(1 << unit).filter(|bytes| *bytes > 0).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        assert_eq!(bytes("100M"), Ok(104_857_600));
        assert_eq!(bytes("2G"), Ok(2_147_483_648));
        assert_eq!(bytes("512"), Ok(512));
        for text in ["", "0", "M", "-1", "99999999999G", "1T"] {
            assert!(bytes(text).is_err(), "{text}");
        }
    }
}
