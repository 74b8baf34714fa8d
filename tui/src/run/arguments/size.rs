//! Parsers for sizes.

/// Parses a size in bytes, such as `100M`; k, M and G are powers of 1,024.
pub fn parse_size(text: &str) -> Result<u64, String> {
    let wrong = || format!("found {text}; expected a size such as 100M or 2G");
    let (number, unit) = match text.char_indices().last() {
        Some((at, 'k' | 'K')) => (text.get(..at), 10),
        Some((at, 'M')) => (text.get(..at), 20),
        Some((at, 'G')) => (text.get(..at), 30),
        _ => (Some(text), 0),
    };
    let number: u64 = number.and_then(|number| number.parse().ok()).ok_or_else(wrong)?;
    number.checked_mul(1 << unit).filter(|bytes| *bytes > 0).ok_or_else(wrong)
}

/// Minimum size of a file written by `--record`: the write buffer.
const LEAST_PART: u64 = 64 << 10;

/// Parses the size of a file written by `--record`; smaller files would fill the folder on a busy bus.
pub fn part_bytes(text: &str) -> Result<u64, String> {
    let size = parse_size(text)?;
    if size < LEAST_PART {
        return Err(format!("found {text}; expected 64k or more"));
    }
    Ok(size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        assert_eq!(parse_size("100M"), Ok(104_857_600));
        assert_eq!(parse_size("2G"), Ok(2_147_483_648));
        assert_eq!(parse_size("512"), Ok(512));
        for text in ["", "0", "M", "-1", "99999999999G", "1T"] {
            assert!(parse_size(text).is_err(), "{text}");
        }
        assert_eq!((part_bytes("64k"), part_bytes("100M")), (Ok(65_536), Ok(104_857_600)));
        assert!(part_bytes("65535").unwrap_err().contains("64k or more"));
    }
}
