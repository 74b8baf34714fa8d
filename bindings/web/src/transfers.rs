//! SDO transfers, J1939 transport sessions and UDS exchanges of a capture.

use cobscope_decoder::event::TransferFigures;
use cobscope_decoder::frame::Timestamp;
use cobscope_decoder::replay::{EventPosition, PlacedEvent};
use cobscope_decoder::sink::escape;
use cobscope_decoder::sink::text::{Line, Tone, TransferWords};

/// Maximum number of transfers kept; later ones are only counted.
const MOST_TRANSFERS: usize = 20_000;

/// A transfer.
pub struct Transfer {
    /// Position of its event.
    pub spot: EventPosition,
    /// End of the transfer.
    pub time: Option<Timestamp>,
    /// Name of the bus.
    pub bus: String,
    /// Client and server, or source and destination.
    pub who: String,
    /// Kind in at most six characters.
    pub kind: &'static str,
    /// Object or service, value, result.
    pub text: String,
    /// Duration in ns.
    pub duration: Option<i64>,
    /// Number of bytes; 0 if unknown.
    pub size: u64,
    /// Outcome, such as `complete`.
    pub outcome: &'static str,
    /// Tone that decides the colour.
    pub tone: Tone,
}

/// Transfers in order of their end.
#[derive(Default)]
pub struct Transfers {
    /// The first ones.
    pub kept: Vec<Transfer>,
    /// Number of further ones.
    pub more: u64,
}

impl Transfers {
    /// Adds the next transfer.
    pub fn add(&mut self, transfer: Transfer) {
        if self.kept.len() < MOST_TRANSFERS {
            self.kept.push(transfer);
        } else {
            self.more = self.more.saturating_add(1);
        }
    }
}

impl Transfer {
    /// The transfer of an event; `None` for other events.
    pub fn of(placed: &PlacedEvent<'_>) -> Option<Self> {
        let event = placed.event;
        let TransferFigures { duration, size, outcome } = event.transfer_figures()?;
        let line = Line::of(event, placed.bus);
        let text =
            TransferWords::of(event, placed.bus).map_or_else(|| line.what.clone(), |words| words.news());
        Some(Self {
            spot: placed.spot,
            time: event.time,
            bus: escape(placed.bus.name()).into(),
            who: escape(&line.who).into(),
            kind: line.kind,
            text: escape(&text).into(),
            duration,
            size,
            outcome: outcome.name(),
            tone: line.tone,
        })
    }
}
