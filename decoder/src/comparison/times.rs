//! Times as text.

use crate::figures::seconds_to;
use crate::statistics::format_span;

/// A time from the first frame: `55.0 s`; times of two captures are compared in tenths.
pub(crate) fn format_seconds(nanoseconds: i64) -> String {
    format!("{} s", seconds_to(nanoseconds, 1))
}

/// A duration with three digits: `24 ms`.
pub(super) fn format_duration(nanoseconds: i64) -> String {
    format_span(nanoseconds)
}
