//! Times, numbers and expressions as text.

/// Maximum length of a printed expression, in characters.
const SHOWN: usize = 80;

/// Expression on one line, shortened to [`SHOWN`] characters.
pub(super) fn clip_expression(expression: &str) -> String {
    let words: Vec<_> = expression.split_whitespace().collect();
    let line = words.join(" ");
    match line.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}…", line.get(..end).unwrap_or_default()),
        None => line,
    }
}

/// Time as text with up to three decimals: `3.1 ms`, `250 ms`, `12.5 s`.
pub(super) fn format_time(nanoseconds: i64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "a time for reading")]
    let milliseconds = nanoseconds as f64 / 1e6;
    match milliseconds.abs() {
        size if size >= 1_000.0 => format!("{} s", format_number(milliseconds / 1e3)),
        _ => format!("{} ms", format_number(milliseconds)),
    }
}

/// Number with up to three decimals.
pub(super) fn format_number(value: f64) -> String {
    let rounded = format!("{value:.3}");
    let short = rounded.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_numbers() {
        assert_eq!(format_time(3_100_000), "3.1 ms");
        assert_eq!(format_time(250_000_000), "250 ms");
        assert_eq!(format_time(1_000_000_000), "1 s");
        assert_eq!(format_time(12_500_000_000), "12.5 s");
        assert_eq!(
            (format_number(-0.0001), format_number(100.0), format_number(1.0 / 3.0)),
            ("0".into(), "100".into(), "0.333".into())
        );
    }

    #[test]
    fn long_expressions_are_cut() {
        assert_eq!(clip_expression("a ==\n   5"), "a == 5");
        assert_eq!(clip_expression(&"ä".repeat(100)).chars().count(), 81);
    }
}
