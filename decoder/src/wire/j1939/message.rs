//! Requests, acknowledgements and commanded addresses.

use super::id::Pgn;
use super::name::Name;
use crate::wire::Malformed;

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

fn pgn(low: u8, middle: u8, high: u8) -> Pgn {
    Pgn::new(u32::from_le_bytes([low, middle, high, 0]))
}

fn malformed(layer: &'static str, needed: u8, data: &[u8]) -> Malformed {
    Malformed { layer, offset: 0, needed, available: u8::try_from(data.len()).unwrap_or(u8::MAX) }
}

/// Requested parameter group: three bytes (J1939-21 §5.4.2).
///
/// # Errors
/// If there are fewer than three bytes.
pub fn request(data: &[u8]) -> Result<Pgn, Malformed> {
    match data {
        [low, middle, high, ..] => Ok(pgn(*low, *middle, *high)),
        _ => Err(malformed("j1939-request", 3, data)),
    }
}

impl Acknowledgement {
    /// Reads eight bytes.
    ///
    /// # Errors
    /// If there are fewer than eight bytes.
    pub fn read(data: &[u8]) -> Result<Self, Malformed> {
        match *data {
            [control, group_function, _, _, address, low, middle, high, ..] => {
                Ok(Self { control, group_function, address, pgn: pgn(low, middle, high) })
            }
            _ => Err(malformed("acknowledgement", 8, data)),
        }
    }
}

/// A commanded address: NAME of the device and its new address (J1939-81 §4.2.3).
///
/// # Errors
/// If there are fewer than nine bytes.
pub fn commanded_address(data: &[u8]) -> Result<(Name, u8), Malformed> {
    match (Name::read(data), data.get(8)) {
        (Some(name), Some(address)) => Ok((name, *address)),
        _ => Err(malformed("commanded-address", 9, data)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_and_its_answer() {
        // Request of 60928 (EE00): 00 EE 00.
        assert_eq!(request(&[0x00, 0xEE, 0x00]), Ok(Pgn::ADDRESS_CLAIMED));
        let short = Malformed { layer: "j1939-request", offset: 0, needed: 3, available: 2 };
        assert_eq!(request(&[0x00, 0xEE]), Err(short));
        // NACK to 0x21 of 65227 (FECB).
        let nack = Acknowledgement::read(&[1, 0xFF, 0xFF, 0xFF, 0x21, 0xCB, 0xFE, 0x00]);
        let wanted = Acknowledgement { control: 1, group_function: 0xFF, address: 0x21, pgn: Pgn::DM2 };
        assert_eq!(nack, Ok(wanted));
        assert!(Acknowledgement::read(&[0; 7]).is_err());
    }

    #[test]
    fn a_commanded_address_has_nine_bytes() {
        let data = [1, 0, 0, 0, 0, 0, 0, 0x80, 0x85];
        assert_eq!(commanded_address(&data), Ok((Name(0x8000_0000_0000_0001), 0x85)));
        assert_eq!(commanded_address(&data[..8]).unwrap_err().needed, 9);
    }
}
