//! What events of several kinds have in common: figures of transfers (SDO, J1939 transport, ISO-TP, UDS), and errors.

use super::{DtcAction, EmcyAction, Event, EventKind, ExchangeOutcome, MessageOutcome, Outcome};

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

    /// Whether the event reports an error: of a device, of a transfer, of the bus, or of the capture.
    pub fn is_error(&self) -> bool {
        match &self.kind {
            EventKind::Emcy(emergency) => emergency.action == EmcyAction::Raised,
            EventKind::Dtc(dtc) => dtc.action == DtcAction::Raised,
            EventKind::NodeLost(_)
            | EventKind::CanError(_)
            | EventKind::LostFrames { .. }
            | EventKind::Malformed { .. }
            | EventKind::MessageGap(_) => true,
            EventKind::DeviceState(state) => state.fault,
            EventKind::SdoTransfer(transfer) => {
                matches!(transfer.outcome, Outcome::Aborted | Outcome::Timeout)
            }
            EventKind::J1939Transfer(transfer) => {
                !matches!(transfer.outcome, Outcome::Complete | Outcome::Unfinished)
            }
            EventKind::UdsExchange(exchange) => {
                matches!(exchange.outcome, ExchangeOutcome::Negative | ExchangeOutcome::NoAnswer)
            }
            _ => false,
        }
    }
}
