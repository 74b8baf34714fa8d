//! EMCY (CiA 301 §7.2.7.3): identifier 0x80 + node-ID by default.
//!
//! ```text
//! bytes 0..2  error code   byte 2  error register (0x1001)   bytes 3..8  manufacturer specific
//! ```
//!
//! CiA 301 sends the code least significant byte first; some devices send the most significant byte
//! first. The caller passes the order of the device. An EMCY without data is the "ready" message of
//! CiA 301 version 3.

use nom::Parser;
use nom::bytes::complete::take;
use nom::combinator::opt;
use nom::number::complete::u8 as byte;

use crate::wire::MalformedPayload;
use crate::wire::parser::{Parsed, parse_message};

/// Byte order of the error code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum EmcyByteOrder {
    /// Least significant byte first (CiA 301).
    #[default]
    LsbFirst,
    /// Most significant byte first.
    MsbFirst,
}

impl EmcyByteOrder {
    /// Name used in all output.
    pub const fn name(self) -> &'static str {
        match self {
            Self::LsbFirst => "lsb-first",
            Self::MsbFirst => "msb-first",
        }
    }
}

/// An emergency message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EmcyMessage {
    /// No data: boot-up without error (CiA 301 version 3).
    Ready,
    /// An error, or an error reset (code 0).
    Error {
        /// Error code; 0 = error reset or no error.
        code: u16,
        /// Error register, object 0x1001; `None` if the message is too short for it.
        register: Option<u8>,
        /// Manufacturer-specific bytes; only the first `vendor_length` are valid.
        vendor: [u8; 5],
        /// Number of manufacturer-specific bytes received, 0..=5.
        vendor_length: u8,
    },
}

/// Reads an emergency message; bytes missing from a message of fewer than eight are tolerated.
///
/// # Errors
/// If the message has exactly one byte: half an error code.
pub fn parse(data: &[u8], order: EmcyByteOrder) -> Result<EmcyMessage, MalformedPayload> {
    parse_message("emcy", data, |data| parse_fields(data, order))
}

fn parse_fields(data: &[u8], order: EmcyByteOrder) -> Parsed<'_, EmcyMessage> {
    if data.is_empty() {
        return Ok((data, EmcyMessage::Ready));
    }
    let (rest, (first, second)) = (byte, byte).parse(data)?;
    let (rest, register) = opt(byte).parse(rest)?;
    let mut vendor = [0; 5];
    let (rest, received) = take(rest.len().min(vendor.len())).parse(rest)?;
    for (target, source) in vendor.iter_mut().zip(received) {
        *target = *source;
    }
    let code = match order {
        EmcyByteOrder::LsbFirst => u16::from_le_bytes([first, second]),
        EmcyByteOrder::MsbFirst => u16::from_be_bytes([first, second]),
    };
    let vendor_length = u8::try_from(received.len()).unwrap_or(5);
    Ok((rest, EmcyMessage::Error { code, register, vendor, vendor_length }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_code_in_both_orders() {
        // 0x8130, register 0x11, vendor byte 0x20.
        let data = [0x30, 0x81, 0x11, 0x20, 0, 0, 0, 0];
        let Ok(EmcyMessage::Error { code, register, vendor, vendor_length }) =
            parse(&data, EmcyByteOrder::LsbFirst)
        else {
            panic!("expected an error")
        };
        assert_eq!((code, register, vendor, vendor_length), (0x8130, Some(0x11), [0x20, 0, 0, 0, 0], 5));
        let Ok(EmcyMessage::Error { code, .. }) = parse(&data, EmcyByteOrder::MsbFirst) else {
            panic!("expected an error")
        };
        assert_eq!(code, 0x3081);
    }

    #[test]
    fn empty_is_ready_and_one_byte_is_malformed() {
        assert_eq!(parse(&[], EmcyByteOrder::LsbFirst), Ok(EmcyMessage::Ready));
        assert_eq!(parse(&[1], EmcyByteOrder::LsbFirst).unwrap_err().offset, 1);
    }

    #[test]
    fn a_short_message_has_no_register() {
        let Ok(EmcyMessage::Error { register, vendor_length, .. }) =
            parse(&[0x10, 0x81], EmcyByteOrder::LsbFirst)
        else {
            panic!("expected an error")
        };
        assert_eq!((register, vendor_length), (None, 0));
    }
}
