//! BLF objects about bus errors, converted to error frames.
//!
//! ```text
//! CAN_ERROR, CAN_OVERLOAD   0 channel (2)
//! CAN_ERROR_EXT             0 channel (2)   4 valid (4)   8 code (1)  20 extended code (2)
//! CAN_FD_ERROR_64           0 channel (1)   3 code (1)    4 valid (2)  6 extended code (2)
//! CAN_DRIVER_ERROR, _EXT    0 channel (2)   2 transmit error counter (1)  3 receive error counter (1)
//!
//! valid 1: register of the SJA1000      7 6 error type   5 receiving   4…0 location
//! valid 2: Vector's extended code       13 12 direction (1, 3 transmitting)  11…6 error type  4…0 location
//! ```
//!
//! Error types, directions and locations have the same codes in ASC captures.

use crate::capture::bus_error::{Counters, Violation, violation_frame};
use crate::capture::byte_order::ByteOrder::Little;
use crate::frame::Frame;

const SJA1000: u16 = 1;
const EXTENDED: u16 = 2;

/// Error types; a register of the SJA1000 contains the first four.
const KINDS: &[Violation] = &[
    Violation::Bit,
    Violation::Form,
    Violation::Stuff,
    Violation::Other,
    Violation::Checksum,
    Violation::AcknowledgeDelimiter,
    Violation::Other,
    Violation::Acknowledgement,
    Violation::Overload,
    // Error in the FDF bit, which distinguishes FD frames from classic frames.
    Violation::Bit,
];

/// Error frame of an object without details.
pub(super) fn bare_violation(kind: Violation) -> Frame {
    violation_frame(kind, false, 0, None)
}

/// Parses `CAN_ERROR_EXT`.
pub(super) fn parse_extended(body: &[u8]) -> Option<Frame> {
    // The validity field has four bytes here; only the lower two are used.
    Some(detailed_violation(Little.u16(body, 4)?, *body.get(8)?, Little.u16(body, 20)?))
}

/// Parses `CAN_FD_ERROR_64`.
pub(super) fn parse_fd(body: &[u8]) -> Option<Frame> {
    Some(detailed_violation(Little.u16(body, 4)?, *body.get(3)?, Little.u16(body, 6)?))
}

/// Error counters of a controller. The error code of the object is undocumented and ignored.
pub(super) fn parse_counters(body: &[u8]) -> Option<Counters> {
    let (transmit, receive) = (*body.get(2)?, *body.get(3)?);
    Some(Counters { receive, transmit })
}

fn detailed_violation(valid: u16, code: u8, extended: u16) -> Frame {
    let kind = |number: u16| KINDS.get(usize::from(number)).copied().unwrap_or(Violation::Other);
    if valid & SJA1000 != 0 {
        return violation_frame(kind(u16::from(code >> 6)), code & 0x20 == 0, code & 0x1F, None);
    }
    if valid & EXTENDED != 0 {
        let is_sending = matches!(extended >> 12 & 3, 1 | 3);
        let place = u8::try_from(extended & 0x1F).unwrap_or(0);
        return violation_frame(kind(extended >> 6 & 0x3F), is_sending, place, None);
    }
    bare_violation(Violation::Other)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::CanId;

    /// Body of a `CAN_ERROR_EXT` on channel 1.
    fn body(valid: u8, code: u8, extended_code: u16) -> [u8; 32] {
        let mut body = [0; 32];
        (body[0], body[4], body[8]) = (1, valid, code);
        body[20..22].copy_from_slice(&extended_code.to_le_bytes());
        body
    }

    #[test]
    fn a_stuff_error_in_both_codes() {
        let by_register = parse_extended(&body(1, 0b1010_0010, 0)).unwrap();
        assert_eq!(by_register.data(), [0, 0, 0x04, 0x02, 0, 0, 0, 0], "receiving, ID.28 to ID.21");
        assert_eq!(parse_extended(&body(2, 0, 0x20A2)).unwrap(), by_register);
        let fd_body = [1, 8, 0, 0, 2, 0, 0xA2, 0x20];
        assert_eq!(parse_fd(&fd_body).unwrap(), by_register);
    }

    #[test]
    fn a_missing_acknowledgement_while_sending() {
        let frame = parse_extended(&body(0x0E, 0xC7, 0x31CA)).unwrap();
        assert_eq!((frame.id, frame.data()[2]), (CanId::Extended(0x0A8), 0x80));
    }

    #[test]
    fn without_a_valid_code_it_is_an_error_of_any_kind() {
        let frame = parse_extended(&body(0, 0xFF, 0xFFFF)).unwrap();
        assert_eq!((frame.id, frame.data()), (CanId::Extended(0x088), &[0; 8][..]));
        assert_eq!(parse_extended(&body(0, 0, 0)[..21]), None);
    }

    #[test]
    fn counters_stand_where_socketcan_has_them() {
        let found = parse_counters(&[1, 0, 130, 7, 0, 0, 0, 0]).unwrap();
        assert_eq!(crate::capture::bus_error::counter_frame(found).data(), [0, 0, 0, 0, 0, 0, 130, 7]);
    }
}
