//! Events of ISO-TP and UDS: complete messages, requests with their responses.

use std::sync::Arc;

use super::{FrameRange, TransportTimer};
use crate::frame::CanId;
use crate::profile::{DataType, DecodedValue, ObjectMeaning, ValueIn, WriteEffect, uds_names};
use crate::wire::canopen::emcy::EmcyByteOrder;
use crate::wire::uds::UdsSubFunction;

/// Addresses of sender and receiver.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdsEndpoints {
    /// Address of the sender, with its net in bits 10..8; None for identifiers of the bus file.
    pub source: Option<u16>,
    /// Address of the receiver, in the same form.
    pub target: Option<u16>,
    /// The receiver is a group of servers.
    pub functional: bool,
    /// Name of the server in the bus file.
    pub server: Option<Arc<str>>,
}

/// Result of an ISO-TP message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum MessageOutcome {
    /// All frames were seen.
    Complete,
    /// Completed, but frames are missing.
    Incomplete,
    /// The sender received no flow control in time (N_Bs).
    NoFlowControl,
    /// The sender did not continue in time (N_Cr).
    Timeout,
    /// The receiver reported a buffer overflow.
    Overflow,
    /// The sender started a new message.
    Superseded,
    /// The capture ended before the message.
    Unfinished,
}

impl MessageOutcome {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Complete => "complete",
            Self::Incomplete => "incomplete",
            Self::NoFlowControl | Self::Timeout => "timeout",
            Self::Overflow => "overflow",
            Self::Superseded => "superseded",
            Self::Unfinished => "unfinished",
        }
    }

    /// Time-out that ended the message.
    pub const fn timer(self) -> Option<TransportTimer> {
        match self {
            Self::NoFlowControl => Some(TransportTimer::NBs),
            Self::Timeout => Some(TransportTimer::NCr),
            _ => None,
        }
    }
}

/// An ISO-TP message, single-frame or multi-frame.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct IsoTpTransfer {
    /// Sender and receiver.
    pub ends: UdsEndpoints,
    /// Identifier of the data frames.
    pub id: CanId,
    /// Identifier of the flow control frames, if any were seen.
    pub flow_control: Option<CanId>,
    /// Address byte before the payload (extended and mixed addressing).
    pub address_byte: Option<u8>,
    /// Size in bytes according to the first frame.
    pub announced: u32,
    /// Number of bytes seen.
    pub size: u64,
    /// Data up to 64 KiB or to the first missing frame.
    pub data: Vec<u8>,
    /// `data` is incomplete.
    pub truncated: bool,
    /// Whether it is a single frame.
    pub is_single: bool,
    /// Number of flow control frames with status wait.
    pub waits: u32,
    /// Number of frames, including flow control.
    pub frame_count: u64,
    /// Time from first to last frame, in ns.
    pub duration: Option<i64>,
    /// Result of the message.
    pub outcome: MessageOutcome,
}

/// Result of a request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ExchangeOutcome {
    /// Positive response.
    Positive,
    /// Negative response.
    Negative,
    /// No response.
    NoAnswer,
    /// A response without a visible request.
    Unsolicited,
    /// No response, as the request suppresses a positive one.
    Suppressed,
    /// The capture ended before the response.
    Unfinished,
}

impl ExchangeOutcome {
    /// The name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Positive => "positive",
            Self::Negative => "negative",
            Self::NoAnswer => "no-answer",
            Self::Unsolicited => "unsolicited",
            Self::Suppressed => "suppressed",
            Self::Unfinished => "unfinished",
        }
    }
}

/// A UDS message with its service identifier.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UdsMessage {
    /// Identifier of the frames.
    pub id: CanId,
    /// Message bytes, up to the storage limit.
    pub data: Vec<u8>,
    /// Full size in bytes.
    pub size: u64,
    /// `data` is incomplete.
    pub truncated: bool,
    /// Frames of the message.
    pub frames: FrameRange,
}

/// A UDS request with its response.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct UdsExchange {
    /// Client (source) and server (target).
    pub ends: UdsEndpoints,
    /// Service identifier of the request.
    pub service: u8,
    /// Sub-function.
    pub sub_function: Option<UdsSubFunction>,
    /// Data or routine identifier.
    pub identifier: Option<u16>,
    /// Meaning of the identifier in the device profile.
    pub meaning: Option<Arc<ObjectMeaning>>,
    /// Time of effect of a write according to the profile.
    pub effect: Option<WriteEffect>,
    /// Byte order of numbers and identifiers.
    pub order: EmcyByteOrder,
    /// The request, if it was seen.
    pub request: Option<UdsMessage>,
    /// Final response, if any.
    pub response: Option<UdsMessage>,
    /// Result of the request.
    pub outcome: ExchangeOutcome,
    /// Negative response code.
    pub nrc: Option<u8>,
    /// Number of response-pending messages (NRC 78).
    pub pending: u32,
    /// Time from the last frame of the request to the first frame of the final response, in ns.
    pub latency: Option<i64>,
    /// Time from the first frame of the request to the last frame of the response, in ns.
    pub duration: Option<i64>,
}

impl UdsExchange {
    /// Bytes of the value that is read or written. None if the service has no value, or several values
    /// without visible boundaries.
    pub fn value(&self) -> Option<&[u8]> {
        let service = uds_names().service_by_id(self.service)?;
        let whole = |message: &Option<UdsMessage>| message.as_ref().is_some_and(|it| !it.truncated);
        let (message, shape) = match service.value_in()? {
            ValueIn::Request if whole(&self.request) => (self.request.as_ref()?, service.request()),
            ValueIn::Response if self.outcome == ExchangeOutcome::Positive && whole(&self.response) => {
                let request = self.request.as_ref().and_then(|request| request.data.get(1..));
                if request.is_some_and(|data| !service.request().record(data).is_empty()) {
                    return None;
                }
                (self.response.as_ref()?, service.response())
            }
            _ => return None,
        };
        Some(shape.record(message.data.get(1..)?)).filter(|value| !value.is_empty())
    }

    /// Name of the identifier in the device profile, else in the standard.
    pub fn name(&self) -> Option<&str> {
        match &self.meaning {
            Some(meaning) => Some(&meaning.name),
            None => self.identifier.and_then(|id| uds_names().identifier_name(id)),
        }
    }

    /// Value as described in the profile, else text if all bytes are printable.
    pub fn decoded_value(&self) -> Option<DecodedValue> {
        let value = self.value()?;
        match self.meaning.as_deref() {
            Some(meaning) if meaning.data_type.is_some_and(DataType::is_integer) => {
                let mut bytes = value.to_vec();
                if self.order == EmcyByteOrder::MsbFirst {
                    bytes.reverse();
                }
                Some(meaning.decode(&bytes))
            }
            Some(meaning) if meaning.data_type.is_some() => Some(meaning.decode(value)),
            _ => printable_text(value),
        }
    }
}

/// Bytes as text, if all are printable except for padding at the end.
fn printable_text(value: &[u8]) -> Option<DecodedValue> {
    let end = value.iter().rposition(|byte| !matches!(byte, 0 | 0xFF))?;
    let characters = value.get(..=end)?;
    let printable = characters.iter().all(|byte| byte.is_ascii_graphic() || *byte == b' ');
    (printable && characters.len() > 3).then(|| DataType::VisibleString.decode(characters))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(data: &[u8]) -> UdsMessage {
        let frames = FrameRange::one(1);
        UdsMessage {
            id: CanId::from_standard(1),
            data: data.into(),
            size: data.len() as u64,
            truncated: false,
            frames,
        }
    }

    fn exchange(request: &[u8], response: &[u8]) -> UdsExchange {
        let ends = UdsEndpoints { source: None, target: None, functional: false, server: None };
        UdsExchange {
            ends,
            service: request[0],
            sub_function: None,
            identifier: Some(0xF190),
            meaning: None,
            effect: None,
            order: EmcyByteOrder::MsbFirst,
            request: Some(message(request)),
            response: Some(message(response)),
            outcome: ExchangeOutcome::Positive,
            nrc: None,
            pending: 0,
            latency: None,
            duration: None,
        }
    }

    #[test]
    fn a_value_is_in_the_request_or_in_the_response() {
        let read = exchange(&[0x22, 0xF1, 0x90], b"\x62\xF1\x90WAUZ\0");
        assert_eq!(read.value(), Some(&b"WAUZ\0"[..]));
        assert_eq!(read.decoded_value(), Some(DecodedValue::Text("WAUZ".into())));
        assert_eq!(read.name(), Some("VIN"));
        let written = exchange(&[0x2E, 0xF1, 0x90, 7, 8], &[0x6E, 0xF1, 0x90]);
        assert_eq!((written.value(), written.decoded_value()), (Some(&[7, 8][..]), None));
        // Two identifiers in one request: the boundary between their values is unknown.
        assert_eq!(exchange(&[0x22, 0xF1, 0x90, 0xF1, 0x8C], &[0x62, 0xF1, 0x90, 1]).value(), None);
        assert_eq!(exchange(&[0x3E, 0], &[0x7E, 0]).value(), None);
    }

    #[test]
    fn numbers_have_an_order() {
        let mut read = exchange(&[0x22, 0x10, 0x01], &[0x62, 0x10, 0x01, 0x01, 0x02]);
        let meaning =
            ObjectMeaning { data_type: Some(DataType::unsigned_of(16)), ..ObjectMeaning::default() };
        read.meaning = Some(Arc::new(meaning));
        assert_eq!(read.decoded_value(), Some(DecodedValue::Unsigned(0x0102)));
        read.order = EmcyByteOrder::LsbFirst;
        assert_eq!(read.decoded_value(), Some(DecodedValue::Unsigned(0x0201)));
    }
}
