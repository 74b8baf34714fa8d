//! Requests, acknowledgements and commanded addresses.

use nom::Parser;
use nom::bytes::complete::take;
use nom::number::complete::u8 as byte;

use super::id::Pgn;
use super::name::J1939Name;
use crate::wire::MalformedPayload;
use crate::wire::parser::{field_group, parse_message};

/// An acknowledgement (J1939-21 §5.4.4).
///
/// ```text
/// control  group function value  FF FF  address  PGN, least significant byte first
///    0              1             2  3     4      5 6 7
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Acknowledgement {
    /// 0 = positive, 1 = negative, 2 = access denied, 3 = cannot respond now.
    pub control: u8,
    /// Group function that is acknowledged; 255 for none.
    pub group_function: u8,
    /// Address of the requester; 255 if unknown (the byte was reserved before 2006).
    pub address: u8,
    /// Requested parameter group.
    pub pgn: Pgn,
}

/// Requested parameter group: three bytes (J1939-21 §5.4.2).
///
/// # Errors
/// If there are fewer than three bytes.
pub fn parse_request(data: &[u8]) -> Result<Pgn, MalformedPayload> {
    parse_message("j1939-request", data, field_group(Pgn::parse_field))
}

impl Acknowledgement {
    /// Reads eight bytes.
    ///
    /// # Errors
    /// If there are fewer than eight bytes.
    pub fn read(data: &[u8]) -> Result<Self, MalformedPayload> {
        let message = (byte, byte, take(2_usize), byte, Pgn::parse_field)
            .map(|(control, group_function, _, address, pgn)| Self { control, group_function, address, pgn });
        parse_message("acknowledgement", data, field_group(message))
    }
}

/// A commanded address: NAME of the device and its new address (J1939-81 §4.2.3).
///
/// # Errors
/// If there are fewer than nine bytes.
pub fn commanded_address(data: &[u8]) -> Result<(J1939Name, u8), MalformedPayload> {
    parse_message("commanded-address", data, field_group((J1939Name::parse_field, byte)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_and_its_answer() {
        // Request of 60928 (EE00): 00 EE 00.
        assert_eq!(parse_request(&[0x00, 0xEE, 0x00]), Ok(Pgn::ADDRESS_CLAIMED));
        let short = MalformedPayload { layer: "j1939-request", offset: 0, needed: 3, available: 2 };
        assert_eq!(parse_request(&[0x00, 0xEE]), Err(short));
        // NACK to 0x21 of 65227 (FECB).
        let nack = Acknowledgement::read(&[1, 0xFF, 0xFF, 0xFF, 0x21, 0xCB, 0xFE, 0x00]);
        let wanted = Acknowledgement { control: 1, group_function: 0xFF, address: 0x21, pgn: Pgn::DM2 };
        assert_eq!(nack, Ok(wanted));
        assert!(Acknowledgement::read(&[0; 7]).is_err());
    }

    #[test]
    fn a_commanded_address_has_nine_bytes() {
        let data = [1, 0, 0, 0, 0, 0, 0, 0x80, 0x85];
        assert_eq!(commanded_address(&data), Ok((J1939Name(0x8000_0000_0000_0001), 0x85)));
        assert_eq!(commanded_address(&data[..8]).unwrap_err().needed, 9);
    }
}
