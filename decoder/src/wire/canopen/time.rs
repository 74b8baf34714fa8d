//! TIME (CiA 301 §7.2.6.3 and TIME_OF_DAY, §7.1.6.5): identifier 0x100 by default.
//!
//! ```text
//! bytes 0..4  milliseconds after midnight, low 28 bits, little-endian
//! bytes 4..6  days since 1 January 1984, little-endian
//! ```

use nom::Parser;
use nom::number::complete::{le_u16, le_u32};

use crate::wire::MalformedPayload;
use crate::wire::parser::{bit_field, field_group, parse_message};

/// Date and time of day; no time zone is defined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeOfDay {
    /// Milliseconds after midnight (28 bits; a day has 86,400,000).
    pub milliseconds: u32,
    /// Days since 1984-01-01.
    pub days: u16,
}

/// Reads six bytes; further bytes are ignored.
///
/// # Errors
/// If there are fewer than six bytes.
pub fn parse(data: &[u8]) -> Result<TimeOfDay, MalformedPayload> {
    let time = (le_u32, le_u16)
        .map(|(milliseconds, days)| TimeOfDay { milliseconds: bit_field(milliseconds, 0, 28), days });
    parse_message("time", data, field_group(time))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reserved_bits_are_cut() {
        // 43,200,000 ms = noon = 0x0293_2E00; 14,610 days = 2024-01-01 = 0x3912.
        let time = parse(&[0x00, 0x2E, 0x93, 0xF2, 0x12, 0x39]).unwrap();
        assert_eq!(time, TimeOfDay { milliseconds: 43_200_000, days: 14_610 });
    }

    #[test]
    fn five_bytes_are_too_short() {
        assert_eq!(parse(&[0; 5]).unwrap_err().needed, 6);
    }
}
