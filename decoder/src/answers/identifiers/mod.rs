//! Identifiers at a position of a capture. Their texts are escaped.

use serde::Serialize;

use super::numbers::{format_bytes, to_millis};
use crate::escape::escape;
use crate::frame::Timestamp;
use crate::session::Bus;
use crate::statistics::IdentifierRow;

/// An identifier with its frames so far.
#[derive(Debug, Clone, Serialize)]
pub struct IdentifierState {
    /// Seconds since its last frame.
    pub age: Option<f64>,
    /// Name of the bus.
    pub bus: String,
    /// Number of frames.
    pub count: u64,
    /// Last payload.
    pub data: String,
    /// Identifier.
    pub id: String,
    /// Largest deviation from the mean interval, in ms.
    pub jitter: Option<f64>,
    /// Mean interval, in ms.
    pub mean: Option<f64>,
    /// Meaning of the identifier.
    pub message: String,
    /// Remote frames.
    pub remote: bool,
}

impl IdentifierState {
    /// The identifier at `now`; `bus` is the one of the row.
    pub fn new(bus: Option<&Bus>, row: &IdentifierRow, now: Option<Timestamp>) -> Self {
        Self {
            age: now.zip(row.last_time).map(|(now, last)| to_millis(now.since(last)) / 1e3),
            bus: bus.map_or(String::new(), |bus| escape(bus.name()).into_owned()),
            count: row.count,
            data: format_bytes(row.payload()),
            id: row.id.to_string(),
            jitter: row.intervals.jitter().map(to_millis),
            mean: row.intervals.mean().map(to_millis),
            message: bus.map_or(String::new(), |bus| escape(&bus.describe_id(row.id)).into_owned()),
            remote: row.is_remote,
        }
    }
}
