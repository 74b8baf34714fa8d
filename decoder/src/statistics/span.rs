//! Time spans as text.

/// A time span with three digits, in the largest unit that gives a value of at least 1.
pub fn span(nanoseconds: i64) -> String {
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
