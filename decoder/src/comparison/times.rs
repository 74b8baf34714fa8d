//! Times as text.

use crate::statistics::format_span;

/// A time from the first frame: `55.0 s`.
pub(crate) fn format_seconds(nanoseconds: i64) -> String {
    let tenths = nanoseconds.unsigned_abs().saturating_add(50_000_000) / 100_000_000;
    let sign = if nanoseconds < 0 && tenths > 0 { "-" } else { "" };
    format!("{sign}{}.{} s", tenths / 10, tenths % 10)
}

/// A duration with three digits: `24 ms`.
pub(super) fn format_duration(nanoseconds: i64) -> String {
    format_span(nanoseconds)
}
