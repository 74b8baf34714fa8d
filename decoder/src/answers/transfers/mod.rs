//! SDO transfers, J1939 transport sessions and UDS exchanges. Their texts are escaped.

use serde::Serialize;

use super::numbers::{seconds_after, to_millis};
use crate::escape::escape;
use crate::frame::{BusIndex, Timestamp};
use crate::reading::{Survey, TransferRow};
use crate::session::Buses;

/// Part of the list of transfers.
#[derive(Debug, Clone, Serialize)]
pub struct TransferList {
    /// Transfers beyond those kept.
    pub more: u64,
    /// Transfers of this part, in order of their end.
    pub rows: Vec<TransferRecord>,
    /// Number of transfers kept.
    pub total: usize,
}

/// A transfer of several messages.
#[derive(Debug, Clone, Serialize)]
pub struct TransferRecord {
    /// Name of the bus.
    pub bus: String,
    /// Time from the first to the last frame, in ms.
    pub duration: Option<f64>,
    /// Last frame.
    pub frame: u64,
    /// Kind in at most six characters.
    pub kind: &'static str,
    /// Number of the event among those of the frame.
    pub ordinal: u32,
    /// Outcome, as in filters.
    pub outcome: &'static str,
    /// Number of bytes transferred.
    pub size: u64,
    /// Value or failure, and name of the object or service.
    pub text: String,
    /// Seconds from the first frame to the end of the transfer.
    pub time: Option<f64>,
    /// Class of the colour.
    pub tone: &'static str,
    /// Client and server, or source and destination.
    pub who: String,
}

impl TransferList {
    /// At most `count` transfers from number `from` on; `zero` is the time of the first frame.
    pub fn new(
        survey: &Survey,
        buses: Buses<'_>,
        zero: Option<Timestamp>,
        (from, count): (usize, usize),
    ) -> Self {
        let transfers = &survey.transfers;
        let bus_name = |index: BusIndex| {
            buses.get(usize::from(index.0)).map_or(String::new(), |bus| escape(bus.name()).into_owned())
        };
        let shown = transfers.iter().skip(from).take(count);
        Self {
            more: transfers.more,
            rows: shown.map(|row| TransferRecord::new(row, bus_name(row.bus), zero)).collect(),
            total: transfers.len(),
        }
    }
}

impl TransferRecord {
    fn new(row: &TransferRow, bus: String, zero: Option<Timestamp>) -> Self {
        Self {
            bus,
            duration: row.duration.map(to_millis),
            frame: row.spot.frame,
            kind: row.kind,
            ordinal: row.spot.ordinal,
            outcome: row.outcome.name(),
            size: row.size,
            text: row.news.to_string(),
            time: seconds_after(row.time, zero),
            tone: row.tone.name(),
            who: row.who.to_string(),
        }
    }
}
