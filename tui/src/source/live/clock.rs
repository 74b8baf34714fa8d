//! This computer's clock, as frames carry it.

use std::time::{SystemTime, UNIX_EPOCH};

use cobscope_decoder::frame::Timestamp;

/// Nanoseconds since 1970, now.
pub fn now() -> Timestamp {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    Timestamp(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
}
