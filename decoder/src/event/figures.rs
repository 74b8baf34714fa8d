//! What events of several kinds have in common: figures of transfers (SDO, J1939 transport, ISO-TP, UDS), and errors.

use super::{DtcAction, EmcyAction, Event, EventKind, ExchangeOutcome, MessageOutcome, SdoOutcome};

/// Duration, size and outcome of a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TransferFigures {
    /// Duration in ns, if it is known.
    pub duration: Option<i64>,
    /// Number of bytes; 0 if unknown.
    pub size: u64,
    /// Outcome of the transfer.
    pub outcome: TransferOutcome,
}

/// Outcome of a transfer of any protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransferOutcome {
    /// Outcome of an SDO or J1939 transfer.
    Transfer(SdoOutcome),
    /// Outcome of an ISO-TP message.
    Message(MessageOutcome),
    /// Outcome of a UDS exchange.
    Exchange(ExchangeOutcome),
}

/// Group of the outcomes of all protocols.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OutcomeGroup {
    /// Complete, or nothing is missing: a request that wants no response, a response on its own.
    Complete,
    /// A side refused or aborted it.
    Refused,
    /// A side did not answer in time.
    TimedOut,
    /// The end is not known.
    Other,
}

impl TransferOutcome {
    /// The name used in all output, such as `complete`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Transfer(outcome) => outcome.name(),
            Self::Message(outcome) => outcome.name(),
            Self::Exchange(outcome) => outcome.name(),
        }
    }

    /// Group of the outcome.
    pub const fn group(self) -> OutcomeGroup {
        match self {
            Self::Transfer(SdoOutcome::Complete)
            | Self::Message(MessageOutcome::Complete)
            | Self::Exchange(
                ExchangeOutcome::Positive | ExchangeOutcome::Suppressed | ExchangeOutcome::Unsolicited,
            ) => OutcomeGroup::Complete,
            Self::Transfer(SdoOutcome::Aborted)
            | Self::Message(MessageOutcome::Overflow)
            | Self::Exchange(ExchangeOutcome::Negative) => OutcomeGroup::Refused,
            Self::Transfer(SdoOutcome::Timeout)
            | Self::Message(MessageOutcome::Timeout | MessageOutcome::NoFlowControl)
            | Self::Exchange(ExchangeOutcome::NoAnswer) => OutcomeGroup::TimedOut,
            Self::Transfer(SdoOutcome::Superseded | SdoOutcome::Incomplete | SdoOutcome::Unfinished)
            | Self::Message(
                MessageOutcome::Superseded | MessageOutcome::Incomplete | MessageOutcome::Unfinished,
            )
            | Self::Exchange(ExchangeOutcome::Unfinished) => OutcomeGroup::Other,
        }
    }
}

impl Event {
    /// Figures of a transfer; `None` for other events, and for complete ISO-TP messages, which belong to a UDS exchange.
    pub fn transfer_figures(&self) -> Option<TransferFigures> {
        let (duration, size, outcome) = match &self.kind {
            EventKind::SdoTransfer(transfer) => {
                (transfer.duration, transfer.size, TransferOutcome::Transfer(transfer.outcome))
            }
            EventKind::J1939Transfer(transfer) => {
                (transfer.duration, transfer.size, TransferOutcome::Transfer(transfer.outcome))
            }
            EventKind::UdsExchange(exchange) => {
                (exchange.duration, 0, TransferOutcome::Exchange(exchange.outcome))
            }
            EventKind::IsoTpTransfer(transfer) if transfer.outcome != MessageOutcome::Complete => {
                (transfer.duration, transfer.size, TransferOutcome::Message(transfer.outcome))
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
                matches!(transfer.outcome, SdoOutcome::Aborted | SdoOutcome::Timeout)
            }
            EventKind::J1939Transfer(transfer) => {
                !matches!(transfer.outcome, SdoOutcome::Complete | SdoOutcome::Unfinished)
            }
            EventKind::UdsExchange(exchange) => {
                matches!(exchange.outcome, ExchangeOutcome::Negative | ExchangeOutcome::NoAnswer)
            }
            _ => false,
        }
    }
}
