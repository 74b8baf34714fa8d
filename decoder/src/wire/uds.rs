//! UDS (ISO 14229-1): requests, positive responses and negative responses.
//!
//! ```text
//! byte 0        bytes 1..
//! SID           parameters                  request
//! SID + 40      parameters                  positive response
//! 7F            SID of the request, NRC     negative response
//! ```
//!
//! The positions of sub-function and identifier depend on the service (`lookups/uds_services.toml`); the
//! caller passes them as a [`ServiceLayout`].

use nom::Parser;
use nom::bytes::complete::take;
use nom::number::Endianness;
use nom::number::complete::{u8 as byte, u16 as two_bytes};
use nom::sequence::preceded;

use super::MalformedPayload;
use super::canopen::emcy::EmcyByteOrder;
use super::parser::{Parsed, bit_field, field_group, parse_message};

/// One UDS message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum UdsPdu<'a> {
    /// Request of a client.
    Request {
        /// Service identifier.
        service: u8,
        /// Bytes after the service identifier.
        data: &'a [u8],
    },
    /// Positive response of a server.
    Positive {
        /// Service identifier of the request.
        service: u8,
        /// Bytes after the service identifier.
        data: &'a [u8],
    },
    /// Negative response of a server, also "response pending".
    Negative {
        /// Service identifier of the request.
        service: u8,
        /// Negative response code.
        code: u8,
    },
}

/// Service identifier of a negative response (§8.5).
const NEGATIVE: u8 = 0x7F;
/// Bit of the service identifier that marks a response.
const RESPONSE: u8 = 0x40;
/// Negative response code "response pending": the final response follows later (Annex A.1).
pub(crate) const RESPONSE_PENDING: u8 = 0x78;

/// Reads one message.
///
/// # Errors
/// If `data` is empty, or a negative response lacks its service or its code.
pub fn parse(data: &[u8]) -> Result<UdsPdu<'_>, MalformedPayload> {
    parse_message("uds", data, parse_fields)
}

fn parse_fields(data: &[u8]) -> Parsed<'_, UdsPdu<'_>> {
    let (rest, service) = byte(data)?;
    match service {
        NEGATIVE => {
            field_group((byte, byte)).map(|(service, code)| UdsPdu::Negative { service, code }).parse(rest)
        }
        _ if service & RESPONSE != 0 => {
            Ok((rest, UdsPdu::Positive { service: service & !RESPONSE, data: rest }))
        }
        _ => Ok((rest, UdsPdu::Request { service, data: rest })),
    }
}

/// Positions of sub-function and identifier after the service identifier.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct ServiceLayout {
    /// The first byte is a sub-function; bit 7 of it suppresses the positive response (§8.2.2).
    pub sub_function: bool,
    /// Position of the identifier; `None` if the service has no identifier.
    pub identifier: Option<IdentifierPlace>,
}

/// Position of an identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IdentifierPlace {
    /// Bytes between the service identifier and the identifier.
    pub offset: u8,
    /// High byte of the identifier, if only the low byte is sent.
    pub high: Option<u8>,
}

/// Sub-function of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UdsSubFunction {
    /// Sub-function, 0..=127.
    pub value: u8,
    /// Bit 7: the server must not send a positive response.
    pub suppress_response: bool,
}

impl ServiceLayout {
    /// Sub-function in `data`, the bytes after the service identifier.
    pub fn sub_function(self, data: &[u8]) -> Option<UdsSubFunction> {
        let byte = data.first().copied().filter(|_| self.sub_function)?;
        Some(UdsSubFunction { value: bit_field(byte, 0, 7), suppress_response: byte & 0x80 != 0 })
    }

    /// Data or routine identifier in `data`, the bytes after the service identifier. The standard sends the
    /// high byte first; `order` is the byte order of the device.
    pub fn identifier(self, data: &[u8], order: EmcyByteOrder) -> Option<u16> {
        let place = self.identifier?;
        let order = match order {
            EmcyByteOrder::MsbFirst => Endianness::Big,
            EmcyByteOrder::LsbFirst => Endianness::Little,
        };
        let identifier = |rest| match place.high {
            Some(high) => byte.map(|low| u16::from_be_bytes([high, low])).parse(rest),
            None => two_bytes(order)(rest),
        };
        let parsed: Parsed<'_, u16> = preceded(take(place.offset), identifier).parse(data);
        parsed.ok().map(|(_, identifier)| identifier)
    }

    /// Bytes after identifier and sub-function: data record or parameters.
    pub fn record(self, data: &[u8]) -> &[u8] {
        let begin = match self.identifier {
            Some(place) => usize::from(place.offset) + if place.high.is_some() { 1 } else { 2 },
            None => usize::from(self.sub_function),
        };
        data.get(begin..).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BY_IDENTIFIER: ServiceLayout =
        ServiceLayout { sub_function: false, identifier: Some(IdentifierPlace { offset: 0, high: None }) };
    const ROUTINE: ServiceLayout =
        ServiceLayout { sub_function: true, identifier: Some(IdentifierPlace { offset: 1, high: None }) };
    const PERIODIC: ServiceLayout = ServiceLayout {
        sub_function: false,
        identifier: Some(IdentifierPlace { offset: 1, high: Some(0xF2) }),
    };

    #[test]
    fn three_kinds_of_message() {
        // ISO 14229-1 §8.4, §8.5: request 22 F1 90, responses 62 F1 90 … and 7F 22 31.
        assert_eq!(parse(&[0x22, 0xF1, 0x90]), Ok(UdsPdu::Request { service: 0x22, data: &[0xF1, 0x90] }));
        assert_eq!(parse(&[0x62, 0xF1, 0x90]), Ok(UdsPdu::Positive { service: 0x22, data: &[0xF1, 0x90] }));
        assert_eq!(parse(&[0x7F, 0x22, 0x31]), Ok(UdsPdu::Negative { service: 0x22, code: 0x31 }));
        // C5 responds to 85, FA to BA: bit 6 is set, 40h is not added.
        assert_eq!(parse(&[0xC5, 0x02]), Ok(UdsPdu::Positive { service: 0x85, data: &[0x02] }));
        assert_eq!(parse(&[0x85, 0x02]), Ok(UdsPdu::Request { service: 0x85, data: &[0x02] }));
    }

    #[test]
    fn missing_bytes_are_reported() {
        assert_eq!(parse(&[]).unwrap_err().needed, 1);
        let error = parse(&[0x7F, 0x22]).unwrap_err();
        assert_eq!((error.layer, error.offset, error.needed, error.available), ("uds", 1, 2, 1));
    }

    #[test]
    fn identifiers_and_sub_functions() {
        let (msb, lsb) = (EmcyByteOrder::MsbFirst, EmcyByteOrder::LsbFirst);
        assert_eq!(BY_IDENTIFIER.identifier(&[0xF1, 0x90], msb), Some(0xF190));
        assert_eq!(BY_IDENTIFIER.identifier(&[0x01, 0x10, 0x21], lsb), Some(0x1001));
        assert_eq!(BY_IDENTIFIER.identifier(&[0xF1], msb), None);
        assert_eq!(BY_IDENTIFIER.record(&[0x01, 0x10, 0x21]), [0x21]);
        // 31 01 FF00: start routine FF00; sub-function 81 suppresses the positive response.
        assert_eq!(ROUTINE.identifier(&[0x01, 0xFF, 0x00], msb), Some(0xFF00));
        assert_eq!(
            ROUTINE.sub_function(&[0x81, 0xFF, 0x00]),
            Some(UdsSubFunction { value: 1, suppress_response: true })
        );
        assert_eq!(ROUTINE.record(&[0x01, 0xFF, 0x00, 7]), [7]);
        assert_eq!(PERIODIC.identifier(&[0x02, 0x15], msb), Some(0xF215));
        assert_eq!(PERIODIC.record(&[0x02, 0x15, 0x16]), [0x16]);
        assert_eq!(ServiceLayout::default().sub_function(&[1]), None);
        assert_eq!(ServiceLayout::default().record(&[1, 2]), [1, 2]);
    }
}
