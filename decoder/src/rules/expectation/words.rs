//! Words of findings: times and expressions.

/// Letters of an expression that are shown.
const SHOWN: usize = 80;

/// An expression within a line: its beginning where it is long, its lines joined.
pub(super) fn clipped(expression: &str) -> String {
    let words: Vec<_> = expression.split_whitespace().collect();
    let line = words.join(" ");
    match line.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}…", line.get(..end).unwrap_or_default()),
        None => line,
    }
}

/// `3.1 ms`, `250 ms`, `12.5 s`: with as many digits as tell something.
pub(super) fn time(nanoseconds: i64) -> String {
    #[expect(clippy::cast_precision_loss, reason = "a time for reading")]
    let milliseconds = nanoseconds as f64 / 1e6;
    match milliseconds.abs() {
        size if size >= 1_000.0 => format!("{} s", number(milliseconds / 1e3)),
        _ => format!("{} ms", number(milliseconds)),
    }
}

/// A number with at most three digits behind the point.
pub(super) fn number(value: f64) -> String {
    let rounded = format!("{value:.3}");
    let short = rounded.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

/// `31st`.
pub(super) fn nth(count: u64) -> String {
    let ending = match (count % 10, count % 100) {
        (_, 11..=13) => "th",
        (1, _) => "st",
        (2, _) => "nd",
        (3, _) => "rd",
        _ => "th",
    };
    format!("{count}{ending}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_numbers_and_places_in_a_row() {
        assert_eq!(time(3_100_000), "3.1 ms");
        assert_eq!(time(250_000_000), "250 ms");
        assert_eq!(time(1_000_000_000), "1 s");
        assert_eq!(time(12_500_000_000), "12.5 s");
        assert_eq!(
            (number(-0.0001), number(100.0), number(1.0 / 3.0)),
            ("0".into(), "100".into(), "0.333".into())
        );
        assert_eq!(
            (nth(1), nth(12), nth(22), nth(113)),
            ("1st".into(), "12th".into(), "22nd".into(), "113th".into())
        );
    }

    #[test]
    fn long_expressions_are_cut() {
        assert_eq!(clipped("a ==\n   5"), "a == 5");
        assert_eq!(clipped(&"ä".repeat(100)).chars().count(), 81);
    }
}
