//! Parsers of durations and sizes.

use std::time::Duration;

/// Maximum duration of a window on one side of a trigger.
const LONGEST_SIDE: Duration = Duration::from_hours(24);

/// Parses a duration above 0, such as `90s`, `10min` or `1h`.
pub fn parse_duration(text: &str) -> Result<Duration, String> {
    let wrong = || format!("found {text}; expected a time such as 90s, 10min or 1h");
    parse_any(text).filter(|time| !time.is_zero() && time.subsec_nanos() == 0).ok_or_else(wrong)
}

/// Parses the part of a window before or after a trigger, such as `500ms`, `30s` or `0s`.
pub fn parse_side(text: &str) -> Result<Duration, String> {
    let wrong = || format!("found {text}; expected a time up to 24h, such as 500ms, 30s or 5min");
    parse_any(text).filter(|time| *time <= LONGEST_SIDE).ok_or_else(wrong)
}

fn parse_any(text: &str) -> Option<Duration> {
    let at = text.find(|character: char| !character.is_ascii_digit())?;
    let (number, unit) = text.split_at_checked(at)?;
    let number: u64 = number.parse().ok()?;
    let seconds = match unit {
        "ms" => return Some(Duration::from_millis(number)),
        "s" => 1,
        "min" | "m" => 60,
        "h" => 3_600,
        _ => return None,
    };
    number.checked_mul(seconds).map(Duration::from_secs)
}

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
    fn times() {
        assert_eq!(parse_duration("10min"), Ok(Duration::from_mins(10)));
        assert_eq!(parse_duration("90s"), Ok(Duration::from_secs(90)));
        for text in ["", "10", "min", "0s", "1d", "500ms"] {
            assert!(parse_duration(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sides_of_a_window() {
        assert_eq!(parse_side("500ms"), Ok(Duration::from_millis(500)));
        assert_eq!(parse_side("0s"), Ok(Duration::ZERO));
        assert_eq!(parse_side("24h"), Ok(LONGEST_SIDE));
        for text in ["", "-1s", "1.5s", "25h", "99999999999999999999s", "9999999999999999h"] {
            assert!(parse_side(text).is_err(), "{text}");
        }
    }

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
