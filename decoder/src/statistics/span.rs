//! Time spans as text.

/// A time span with three digits, in the largest unit that gives a value of at least 1.
pub fn format_span(nanoseconds: i64) -> String {
    const UNITS: [(i64, &str); 5] = [
        (86_400_000_000_000, "days"),
        (3_600_000_000_000, "h"),
        (60_000_000_000, "min"),
        (1_000_000_000, "s"),
        (1_000_000, "ms"),
    ];
    let fits = UNITS.iter().find(|(unit, _)| nanoseconds.saturating_abs() >= *unit);
    let (unit, name) = fits.copied().unwrap_or((1_000, "µs"));
    #[expect(clippy::cast_precision_loss, reason = "only three digits are printed")]
    let value = nanoseconds as f64 / unit as f64;
    let digits = if value.abs() < 9.995 { 2 } else { usize::from(value.abs() < 99.95) };
    let text = format!("{value:.digits$}");
    let text = if digits > 0 { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    let name = if (text, name) == ("1", "days") { "day" } else { name };
    format!("{text} {name}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits_in_the_largest_unit_of_at_least_1() {
        for (nanoseconds, text) in [
            (0, "0 µs"),
            (1_500, "1.5 µs"),
            (999_000, "999 µs"),
            (1_000_000, "1 ms"),
            (-1_500_000, "-1.5 ms"),
            (9_994_000, "9.99 ms"),
            (9_996_000, "10 ms"),
            (99_940_000, "99.9 ms"),
            (99_960_000, "100 ms"),
            (999_000_000, "999 ms"),
            (1_000_000_000, "1 s"),
            (59_400_000_000, "59.4 s"),
            (60_000_000_000, "1 min"),
            (3_594_000_000_000, "59.9 min"),
            (3_600_000_000_000, "1 h"),
            (86_040_000_000_000, "23.9 h"),
            (86_400_000_000_000, "1 day"),
            (172_800_000_000_000, "2 days"),
        ] {
            assert_eq!(format_span(nanoseconds), text);
        }
    }
}
