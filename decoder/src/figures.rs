//! Formatting of numbers: times, rates, bits.
//!
//! ```text
//! 7.204 (seconds)   99.745 (milliseconds)   29.5 (tenths)   12 kbit   1.6 MB   256 MiB (limits)
//! ```

/// A number of tenths, with one decimal place below 100.
pub fn format_tenths(tenths: u128) -> String {
    if tenths < 1_000 { format!("{}.{}", tenths / 10, tenths % 10) } else { (tenths / 10).to_string() }
}

/// Bus load of `bits` within `window` ns at a bit rate in bit/s, in percent: `3.4 %`. Its text names the window.
pub fn format_load(bits: u128, window: u128, rate: u32) -> String {
    let most = window.saturating_mul(u128::from(rate)).max(1);
    format!("{} %", format_tenths(bits.saturating_mul(1_000 * 1_000_000_000) / most))
}

/// Bits as `590 bit` or `48 kbit`.
pub fn format_bits(count: u128) -> String {
    if count < 10_000 { format!("{count} bit") } else { format!("{} kbit", count / 1000) }
}

/// Nanoseconds as milliseconds, with three decimal places, or one from 100 ms on.
pub fn format_millis(nanoseconds: i64) -> String {
    let micros = nanoseconds.unsigned_abs() / 1_000;
    if micros >= 100_000 {
        format!("{}.{}", micros / 1_000, micros % 1_000 / 100)
    } else {
        format!("{}.{:03}", micros / 1_000, micros % 1_000)
    }
}

/// A time from the first frame: `7.204 s`; truncated as in the time column, so that an event has one time everywhere.
pub fn format_time(nanoseconds: i64) -> String {
    format!("{} s", format_seconds(nanoseconds))
}

/// Nanoseconds as seconds with three decimal places, truncated.
pub fn format_seconds(nanoseconds: i64) -> String {
    seconds_to(nanoseconds, 3)
}

/// Nanoseconds as seconds with up to nine decimal places, truncated.
pub fn seconds_to(nanoseconds: i64, decimals: u32) -> String {
    let unit = 10_u64.pow(9_u32.saturating_sub(decimals));
    let (per_second, digits) = (1_000_000_000 / unit, decimals.min(9) as usize);
    let parts = nanoseconds.unsigned_abs() / unit;
    let sign = if nanoseconds < 0 && parts > 0 { "-" } else { "" };
    match digits {
        0 => format!("{sign}{parts}"),
        _ => format!("{sign}{}.{:0digits$}", parts / per_second, parts % per_second),
    }
}

/// Nanoseconds as seconds with one decimal place below 1000 s.
pub fn short_seconds(nanoseconds: i64) -> String {
    let tenths = nanoseconds.unsigned_abs() / 100_000_000;
    if tenths < 10_000 { format!("{}.{}", tenths / 10, tenths % 10) } else { (tenths / 10).to_string() }
}

/// Bytes with a unit and about three digits.
pub fn format_bytes(count: u64) -> String {
    match count {
        ..1_000 => format!("{count} B"),
        1_000..1_000_000 => format!("{} kB", format_tenths(u128::from(count / 100))),
        1_000_000..1_000_000_000 => format!("{} MB", format_tenths(u128::from(count / 100_000))),
        _ => format!("{} GB", format_tenths(u128::from(count / 100_000_000))),
    }
}

/// A limit in bytes, with units of 1,024 as its option has them: `256 MiB`, `1.5 GiB`; about three digits.
pub fn format_limit(count: u64) -> String {
    let (unit, name) = match count {
        ..1_024 => return format!("{count} B"),
        1_024..1_048_576 => (10_u32, "KiB"),
        1_048_576..1_073_741_824 => (20, "MiB"),
        _ => (30, "GiB"),
    };
    let parts = u128::from(count).saturating_mul(10) >> unit;
    if parts % 10 == 0 {
        format!("{} {name}", parts / 10)
    } else {
        format!("{} {name}", format_tenths(parts))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_significant_digits_only() {
        assert_eq!([format_tenths(295), format_tenths(10_990)], ["29.5", "1099"]);
        // 8,500 of 250,000 bits within 1 s, and of 500,000 within 2 s.
        let second = 1_000_000_000;
        assert_eq!(format_load(8_500, second, 250_000), "3.4 %");
        assert_eq!(format_load(8_500, 2 * second, 250_000), "1.7 %");
        assert_eq!(format_load(1, 0, 250_000), format_load(1, 0, 0));
        assert_eq!([format_bits(9_999), format_bits(48_500)], ["9999 bit", "48 kbit"]);
        assert_eq!([format_millis(99_745_900), format_millis(100_049_000)], ["99.745", "100.0"]);
        assert_eq!(
            [format_seconds(7_204_999_999), format_seconds(-50_000_000), format_seconds(-999)],
            ["7.204", "-0.050", "0.000"]
        );
        assert_eq!([seconds_to(7_206_000_999, 6), seconds_to(-1_500_000_000, 1)], ["7.206000", "-1.5"]);
        assert_eq!([seconds_to(1_999_999_999, 0), seconds_to(-1, 3)], ["1", "0.000"]);
        assert_eq!(seconds_to(i64::MIN, 9), "-9223372036.854775808");
        assert_eq!([format_time(999_900_000), format_time(-1_999_900_000)], ["0.999 s", "-1.999 s"]);
        assert_eq!(
            [format_bytes(999), format_bytes(12_345), format_bytes(1_640_000_000)],
            ["999 B", "12.3 kB", "1.6 GB"]
        );
        // 64 × 1024, 256 × 1024², 1.5 × 1024³, 1 × 1024³ - 1.
        assert_eq!(
            [
                format_limit(65_536),
                format_limit(268_435_456),
                format_limit(1_610_612_736),
                format_limit(1_073_741_823),
                format_limit(1_023)
            ],
            ["64 KiB", "256 MiB", "1.5 GiB", "1023 MiB", "1023 B"]
        );
    }
}
