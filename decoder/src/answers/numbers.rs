//! Units of JSON numbers.

/// Nanoseconds in milliseconds.
#[expect(clippy::cast_precision_loss, reason = "only for display")]
pub(super) fn to_millis(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e6
}

/// Nanoseconds in seconds.
#[expect(clippy::cast_precision_loss, reason = "only for display")]
pub(super) fn to_seconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e9
}
