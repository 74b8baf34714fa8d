//! Events of ISO-TP and UDS: whole messages, requests with their answers.

use std::sync::Arc;

use super::{FrameRange, Timer};
use crate::frame::CanId;
use crate::profile::{DataType, Effect, Meaning, Value, ValueIn, uds};
use crate::wire::canopen::emcy::ByteOrder;
use crate::wire::uds::SubFunction;

/// Who talks to whom.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ends {
    /// Address of the sender, its net in bits 10..8; `None` where the identifiers are those of the bus file.
    pub source: Option<u16>,
    /// Address of the receiver, alike.
    pub target: Option<u16>,
    /// The receiver is a group of servers.
    pub functional: bool,
    /// What the bus file calls the server.
    pub server: Option<Arc<str>>,
}

/// How an ISO-TP message ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum MessageOutcome {
    /// All of it was seen.
    Complete,
    /// It came to its end, but frames of it were not seen.
    Incomplete,
    /// The sender waited for flow control and got none (N_Bs).
    NoFlowControl,
    /// The sender did not go on (N_Cr).
    Timeout,
    /// The receiver has no room for it.
    Overflow,
    /// The sender began another one.
    Superseded,
    /// The capture ended first.
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

    /// The time-out that ended it.
    pub const fn timer(self) -> Option<Timer> {
        match self {
            Self::NoFlowControl => Some(Timer::NBs),
            Self::Timeout => Some(Timer::NCr),
            _ => None,
        }
    }
}

/// One ISO-TP message, in one frame or several.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct IsoTpTransfer {
    /// Sender and receiver.
    pub ends: Ends,
    /// Identifier of its data.
    pub id: CanId,
    /// Identifier of its flow control, if any was seen.
    pub flow_control: Option<CanId>,
    /// Address before the payload (extended and mixed addressing).
    pub address_byte: Option<u8>,
    /// Bytes it has by its first frame.
    pub announced: u32,
    /// Bytes seen.
    pub size: u64,
    /// Data, cut at 64 KiB and where a frame is missing.
    pub data: Vec<u8>,
    /// Data is not all that was sent.
    pub truncated: bool,
    /// Whether it is a single frame.
    pub is_single: bool,
    /// Flow controls that said wait.
    pub waits: u32,
    /// Frames it took, flow control included.
    pub frame_count: u64,
    /// Nanoseconds from first to last frame.
    pub duration: Option<i64>,
    /// How it ended.
    pub outcome: MessageOutcome,
}

/// How a request ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ExchangeOutcome {
    /// Done.
    Positive,
    /// Refused.
    Negative,
    /// Nothing came.
    NoAnswer,
    /// A response to no request that was seen.
    Unsolicited,
    /// Nothing came, and a positive response was not asked for.
    Suppressed,
    /// The capture ended first.
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
pub struct Message {
    /// Identifier of its frames.
    pub id: CanId,
    /// Its bytes as far as they were kept.
    pub data: Vec<u8>,
    /// Bytes it has.
    pub size: u64,
    /// Bytes are missing.
    pub truncated: bool,
    /// Its frames.
    pub frames: FrameRange,
}

/// One UDS request with its answer.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct UdsExchange {
    /// Client (source) and server (target).
    pub ends: Ends,
    /// Service identifier of the request.
    pub service: u8,
    /// Sub-function.
    pub sub_function: Option<SubFunction>,
    /// Data or routine identifier.
    pub identifier: Option<u16>,
    /// What the device's profile says of the identifier.
    pub meaning: Option<Arc<Meaning>>,
    /// When a write acts, if the profile says.
    pub effect: Option<Effect>,
    /// Byte order of numbers and identifiers.
    pub order: ByteOrder,
    /// The request, if it was seen.
    pub request: Option<Message>,
    /// The final response, if one came.
    pub response: Option<Message>,
    /// How it ended.
    pub outcome: ExchangeOutcome,
    /// Negative response code.
    pub nrc: Option<u8>,
    /// Responses that said the answer takes longer.
    pub pending: u32,
    /// Nanoseconds from the last frame of the request to the first of the final response.
    pub latency: Option<i64>,
    /// Nanoseconds from the first frame of the request to the last of the response.
    pub duration: Option<i64>,
}

impl UdsExchange {
    /// The bytes of the identifier's value: read, or to be written. `None` where the service carries none,
    /// or several values without a sign where one ends.
    pub fn value(&self) -> Option<&[u8]> {
        let service = uds().service(self.service)?;
        let whole = |message: &Option<Message>| message.as_ref().is_some_and(|it| !it.truncated);
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

    /// Name of the identifier: the device's own, or the standard's.
    pub fn name(&self) -> Option<&str> {
        match &self.meaning {
            Some(meaning) => Some(&meaning.name),
            None => self.identifier.and_then(|id| uds().identifier(id)),
        }
    }

    /// The value as the profile describes it; a run of characters as text; else `None`.
    pub fn decoded(&self) -> Option<Value> {
        let value = self.value()?;
        match self.meaning.as_deref() {
            Some(meaning) if meaning.data_type.is_some_and(DataType::is_integer) => {
                let mut bytes = value.to_vec();
                if self.order == ByteOrder::MsbFirst {
                    bytes.reverse();
                }
                Some(meaning.decode(&bytes))
            }
            Some(meaning) if meaning.data_type.is_some() => Some(meaning.decode(value)),
            _ => text(value),
        }
    }
}

/// Bytes that are a text: all printable but padding at the end.
fn text(value: &[u8]) -> Option<Value> {
    let end = value.iter().rposition(|byte| !matches!(byte, 0 | 0xFF))?;
    let characters = value.get(..=end)?;
    let printable = characters.iter().all(|byte| byte.is_ascii_graphic() || *byte == b' ');
    (printable && characters.len() > 3).then(|| DataType::VisibleString.decode(characters))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(data: &[u8]) -> Message {
        let frames = FrameRange::one(1);
        Message {
            id: CanId::standard(1),
            data: data.into(),
            size: data.len() as u64,
            truncated: false,
            frames,
        }
    }

    fn exchange(request: &[u8], response: &[u8]) -> UdsExchange {
        let ends = Ends { source: None, target: None, functional: false, server: None };
        UdsExchange {
            ends,
            service: request[0],
            sub_function: None,
            identifier: Some(0xF190),
            meaning: None,
            effect: None,
            order: ByteOrder::MsbFirst,
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
    fn a_value_stands_in_the_request_or_in_the_response() {
        let read = exchange(&[0x22, 0xF1, 0x90], b"\x62\xF1\x90WAUZ\0");
        assert_eq!(read.value(), Some(&b"WAUZ\0"[..]));
        assert_eq!(read.decoded(), Some(Value::Text("WAUZ".into())));
        assert_eq!(read.name(), Some("VIN"));
        let written = exchange(&[0x2E, 0xF1, 0x90, 7, 8], &[0x6E, 0xF1, 0x90]);
        assert_eq!((written.value(), written.decoded()), (Some(&[7, 8][..]), None));
        // Two identifiers at once: nothing tells where the first value ends.
        assert_eq!(exchange(&[0x22, 0xF1, 0x90, 0xF1, 0x8C], &[0x62, 0xF1, 0x90, 1]).value(), None);
        assert_eq!(exchange(&[0x3E, 0], &[0x7E, 0]).value(), None);
    }

    #[test]
    fn numbers_have_an_order() {
        let mut read = exchange(&[0x22, 0x10, 0x01], &[0x62, 0x10, 0x01, 0x01, 0x02]);
        let meaning = Meaning { data_type: Some(DataType::unsigned(16)), ..Meaning::default() };
        read.meaning = Some(Arc::new(meaning));
        assert_eq!(read.decoded(), Some(Value::Unsigned(0x0102)));
        read.order = ByteOrder::LsbFirst;
        assert_eq!(read.decoded(), Some(Value::Unsigned(0x0201)));
    }
}
