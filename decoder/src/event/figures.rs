//! Figures that all transfers of data have: SDO, J1939 transport, ISO-TP, UDS.

use super::{Event, EventKind, MessageOutcome};

/// Duration, size and outcome of a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransferFigures {
    /// Duration in ns, if it is known.
    pub duration: Option<i64>,
    /// Number of bytes; 0 if unknown.
    pub size: u64,
    /// Outcome as in JSON, such as `complete`.
    pub outcome: &'static str,
}

impl Event {
    /// Figures of a transfer; `None` for other events, and for complete ISO-TP messages, which belong to a UDS exchange.
    pub fn transfer_figures(&self) -> Option<TransferFigures> {
        let (duration, size, outcome) = match &self.kind {
            EventKind::SdoTransfer(transfer) => (transfer.duration, transfer.size, transfer.outcome.name()),
            EventKind::J1939Transfer(transfer) => (transfer.duration, transfer.size, transfer.outcome.name()),
            EventKind::UdsExchange(exchange) => (exchange.duration, 0, exchange.outcome.name()),
            EventKind::IsoTpTransfer(transfer) if transfer.outcome != MessageOutcome::Complete => {
                (transfer.duration, transfer.size, transfer.outcome.name())
            }
            _ => return None,
        };
        Some(TransferFigures { duration, size, outcome })
    }
}
