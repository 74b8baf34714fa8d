//! Comparison of numbers within tolerances.

/// Whether two positive quantities differ by more than `percent` of the smaller one, and by more than `floor`.
#[expect(clippy::cast_precision_loss, reason = "a tolerance needs few digits")]
pub(super) fn exceeds_tolerance(good: i64, bad: i64, percent: f64, floor: i64) -> bool {
    let gap = good.abs_diff(bad);
    gap > floor.unsigned_abs() && gap as f64 > good.min(bad).max(0) as f64 * percent / 100.0
}

/// Whether counts differ as rates: not equal, and their rates differ by more than `percent`. Without durations the
/// counts themselves are compared.
#[expect(clippy::cast_precision_loss, reason = "a tolerance needs few digits")]
pub(super) fn counts_differ(good: (u64, f64), bad: (u64, f64), percent: f64) -> bool {
    let rate =
        |(count, seconds): (u64, f64)| if seconds > 0.0 { count as f64 / seconds } else { count as f64 };
    let (one, other) = (rate(good), rate(bad));
    good.0 != bad.0 && (one - other).abs() > one.min(other) * percent / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_difference_exceeds_both_limits() {
        assert!(!exceeds_tolerance(100, 105, 5.0, 0));
        assert!(exceeds_tolerance(100, 106, 5.0, 0));
        assert!(!exceeds_tolerance(100, 120, 5.0, 20));
        assert!(!exceeds_tolerance(0, 1, 5.0, 1));
    }

    /// 5 % of 1000 are 50, of 1051 52.55; the limit is that of the smaller value. A floor of 20 is not exceeded by 20.
    #[test]
    fn the_smaller_value_sets_the_limit() {
        for (good, bad, is_other) in
            [(1000, 1050, false), (1000, 1051, true), (1051, 1000, true), (1050, 1000, false)]
        {
            assert_eq!(exceeds_tolerance(good, bad, 5.0, 0), is_other, "{good} {bad}");
        }
        assert!(!exceeds_tolerance(100, 80, 5.0, 20));
        assert!(exceeds_tolerance(100, 79, 5.0, 20));
        // A negative value has no percentage: the floor decides.
        assert!(exceeds_tolerance(-5, 1, 5.0, 5));
        assert!(!exceeds_tolerance(-5, 0, 5.0, 5));
    }

    /// Rates of 10/s and 11/s differ by 10 % of the smaller one, which is 9.1 % of the larger one.
    #[test]
    fn the_smaller_rate_sets_the_limit() {
        assert!(!counts_differ((10, 1.0), (11, 1.0), 10.0));
        assert!(counts_differ((10, 1.0), (11, 1.0), 9.5));
        assert!(counts_differ((11, 1.0), (10, 1.0), 9.5));
        // Without durations the counts are compared.
        assert!(counts_differ((10, 0.0), (20, 0.0), 99.0));
        assert!(!counts_differ((10, 0.0), (20, 0.0), 100.0));
    }

    #[test]
    fn counts_are_compared_as_rates() {
        // 10 in 100 s and 4 in 40 s are the same rate; 3 in 40 s instead of 1 in 60 s is more than twice as often.
        assert!(!counts_differ((10, 100.0), (4, 40.0), 100.0));
        assert!(!counts_differ((1, 10.0), (1, 100.0), 100.0));
        assert!(counts_differ((1, 60.0), (3, 40.0), 100.0));
    }
}
