//! Units of JSON numbers, and payloads.

use crate::frame::Timestamp;

/// Maximum number of bytes shown per payload or value.
const SHOWN_BYTES: usize = 64;

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

/// Seconds from the first frame to a time.
pub fn seconds_after(time: Option<Timestamp>, zero: Option<Timestamp>) -> Option<f64> {
    Some(to_seconds(time?.since(zero?)))
}

/// Bytes as pairs of hexadecimal digits with spaces, of many only the first.
pub(super) fn format_bytes(bytes: &[u8]) -> String {
    let shown = bytes.iter().take(SHOWN_BYTES).map(|byte| format!("{byte:02X}"));
    let more = if bytes.len() > SHOWN_BYTES { " …" } else { "" };
    format!("{}{more}", shown.collect::<Vec<_>>().join(" "))
}
