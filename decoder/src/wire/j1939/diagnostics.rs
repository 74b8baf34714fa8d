//! Diagnostic trouble codes in DM1 and DM2.
//!
//! ```text
//! byte 0         1         2    3    4              5              6 ...
//!      lamps     flash     SPN  SPN  SPN 3 | FMI 5  CM | count 7   the next one, or FF FF
//!      MIL  RSL  AWL  PL   two bits each, from bit 7 down (J1939-73 §5.7.1)
//! ```

use nom::Parser;
use nom::combinator::{peek, rest};
use nom::number::complete::u8 as byte;

use crate::wire::MalformedPayload;
use crate::wire::parser::{bit_field, byte_array, field_group, parse_message};

/// Occurrence count "not available" (J1939-73 §5.7.1.13).
const NOT_AVAILABLE: u8 = 127;

/// Bit order of an SPN whose conversion method bit is set (J1939-73 §5.7.1.11). The message does not
/// contain the version.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpnConversion {
    /// Bits 18..11, 10..3, 2..0 in the order of the bytes.
    Version1,
    /// Bits 10..3, 18..11, 2..0.
    Version2,
    /// Bits 7..0, 15..8, 18..16, as if the conversion method bit were clear.
    Version3,
}

/// Accepts `1`, `2` and `3`.
impl TryFrom<u8> for SpnConversion {
    type Error = &'static str;

    fn try_from(version: u8) -> Result<Self, Self::Error> {
        match version {
            1 => Ok(Self::Version1),
            2 => Ok(Self::Version2),
            3 => Ok(Self::Version3),
            _ => Err("spn_conversion is 1, 2 or 3"),
        }
    }
}

/// Lamp status and flashing: four fields of two bits each, from bit 7 down.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LampStates {
    /// 0 = off, 1 = on, 2 = lamp error, 3 = not available.
    pub status: u8,
    /// 0 = 1 Hz, 1 = 2 Hz or faster, 3 = no flashing.
    pub flash: u8,
}

/// Flash rate of a lamp that is on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlashRate {
    /// No flashing.
    Steady,
    /// 1 Hz.
    Slow,
    /// 2 Hz or faster.
    Fast,
}

impl LampStates {
    /// Flash rate of the lamp whose field starts at bit `shift`; `None` if it is off, faulty or missing.
    pub fn flash_rate(self, shift: u8) -> Option<FlashRate> {
        let field = |byte: u8| byte.checked_shr(u32::from(shift)).unwrap_or(0) & 3;
        match (field(self.status), field(self.flash)) {
            (1, 0) => Some(FlashRate::Slow),
            (1, 1) => Some(FlashRate::Fast),
            (1, _) => Some(FlashRate::Steady),
            _ => None,
        }
    }
}

/// One trouble code of a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReportedDtc {
    /// Suspect parameter number, 19 bits.
    pub spn: u32,
    /// Failure mode identifier, 5 bits.
    pub fmi: u8,
    /// Occurrences, 0..=126; `None` if the device does not count.
    pub count: Option<u8>,
    /// The conversion method bit is set, and the bit order is assumed.
    pub is_assumed: bool,
}

impl ReportedDtc {
    /// Reads four bytes; `None` if they mean "no trouble code".
    fn read([first, second, third, fourth]: [u8; 4], conversion: Option<SpnConversion>) -> Option<Self> {
        let is_old = fourth & 0x80 != 0;
        let top: u32 = bit_field(third, 5, 3);
        let (first, second) = (u32::from(first), u32::from(second));
        let spn = match conversion.filter(|_| is_old) {
            Some(SpnConversion::Version1) => first << 11 | second << 3 | top,
            Some(SpnConversion::Version2) => second << 11 | first << 3 | top,
            Some(SpnConversion::Version3) | None => top << 16 | second << 8 | first,
        };
        let fmi = bit_field(third, 0, 5);
        let count = bit_field(fourth, 0, 7);
        let is_none = matches!((spn, fmi), (0, 0) | (0x7_FFFF, 0x1F));
        (!is_none).then_some(Self {
            spn,
            fmi,
            count: (count != NOT_AVAILABLE).then_some(count),
            is_assumed: is_old && conversion.is_none(),
        })
    }
}

/// List of trouble codes in DM1, DM2 and similar messages.
#[derive(Debug, Clone, Copy)]
pub struct TroubleCodeList<'a> {
    /// Lamps, common to all codes.
    pub lamps: LampStates,
    codes: &'a [u8],
}

impl<'a> TroubleCodeList<'a> {
    /// Reads the payload of one message.
    ///
    /// # Errors
    /// If there are fewer than six bytes: lamps and one code, or "no trouble code".
    pub fn read(payload: &'a [u8]) -> Result<Self, MalformedPayload> {
        let message = (field_group((byte, byte, peek(byte_array::<4>))), rest)
            .map(|((status, flash, _), codes)| Self { lamps: LampStates { status, flash }, codes });
        parse_message("trouble-codes", payload, message)
    }

    /// Codes in the order of the message. Fewer than four bytes at the end are padding.
    pub fn codes(&self, conversion: Option<SpnConversion>) -> impl Iterator<Item = ReportedDtc> + use<'a> {
        let (codes, _) = self.codes.as_chunks();
        codes.iter().filter_map(move |code| ReportedDtc::read(*code, conversion))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn codes(payload: &[u8], conversion: Option<SpnConversion>) -> Vec<(u32, u8, Option<u8>, bool)> {
        let list = TroubleCodeList::read(payload).unwrap();
        list.codes(conversion).map(|it| (it.spn, it.fmi, it.count, it.is_assumed)).collect()
    }

    #[test]
    fn codes_of_a_manual() {
        // The PVE manual prints the bytes in reverse order: 0x938FE9 is E9 8F 93. 0x93 = 100 10011: top bits
        // 4, FMI 19; 4 << 16 | 0x8FE9 = 298985.
        assert_eq!(codes(&[4, 0xFF, 0xE9, 0x8F, 0x93, 1, 0xFF, 0xFF], None), [(298_985, 19, Some(1), false)]);
        // 0x878FEC: 0x87 = 100 00111, FMI 7. 0x030273: 0x03 = 000 00011, SPN 0x0273 = 627.
        let both = [0, 0xFF, 0xEC, 0x8F, 0x87, 126, 0x73, 0x02, 0x03, 127];
        assert_eq!(codes(&both, None), [(298_988, 7, Some(126), false), (627, 3, None, false)]);
    }

    #[test]
    fn no_fault_is_no_code() {
        assert_eq!(codes(&[0, 0xFF, 0, 0, 0, 0, 0xFF, 0xFF], None), []);
        assert_eq!(codes(&[0xFF; 8], None), []);
        // A count without SPN and FMI is not a fault; an FMI without SPN is.
        assert_eq!(codes(&[0, 0xFF, 0, 0, 0, 5, 0xFF, 0xFF], None), []);
        assert_eq!(codes(&[0, 0xFF, 0, 0, 3, 0, 0xFF, 0xFF], None), [(0, 3, Some(0), false)]);
    }

    #[test]
    fn three_older_ways_to_code_an_spn() {
        // SPN 298985 = 100 1000 1111 1110 1001: bits 18..11 are 1001 0001 (91), 10..3 are 1111 1101 (FD),
        // 2..0 are 001. FMI 19 = 10011, so byte 3 is 001 10011 = 33. Byte 4: conversion bit, count 2.
        let one = [0, 0xFF, 0x91, 0xFD, 0x33, 0x82];
        let two = [0, 0xFF, 0xFD, 0x91, 0x33, 0x82];
        let three = [0, 0xFF, 0xE9, 0x8F, 0x93, 0x82];
        let read = |payload, version| codes(payload, SpnConversion::try_from(version).ok());
        for (payload, version) in [(&one, 1), (&two, 2), (&three, 3)] {
            assert_eq!(read(payload, version), [(298_985, 19, Some(2), false)], "{version}");
        }
        // Version not configured: the present bit order is assumed.
        assert_eq!(codes(&three, None), [(298_985, 19, Some(2), true)]);
        // Without the conversion method bit nothing is converted.
        assert_eq!(read(&[0, 0xFF, 0xE9, 0x8F, 0x93, 2], 1), [(298_985, 19, Some(2), false)]);
        assert!(SpnConversion::try_from(4).is_err() && SpnConversion::try_from(0).is_err());
    }

    #[test]
    fn lamps_of_two_bits() {
        // 01 00 01 01: malfunction, amber warning and protect lit; flash 00 11 01 11: slow, none, fast, none.
        let lamps = LampStates { status: 0b0100_0101, flash: 0b0011_0111 };
        assert_eq!(
            [6, 4, 2, 0].map(|shift| lamps.flash_rate(shift)),
            [Some(FlashRate::Slow), None, Some(FlashRate::Fast), Some(FlashRate::Steady)]
        );
        // 3 is not available, 2 is a lamp error.
        assert_eq!(LampStates { status: 0b1110, flash: 0 }.flash_rate(0), None);
        assert_eq!(LampStates { status: 0b1110, flash: 0 }.flash_rate(2), None);
        assert_eq!(lamps.flash_rate(8), None);
    }

    #[test]
    fn too_few_bytes() {
        let error = TroubleCodeList::read(&[0, 0xFF, 0, 0, 0]).unwrap_err();
        assert_eq!((error.needed, error.available), (6, 5));
        assert!(TroubleCodeList::read(&[]).is_err());
        // A remainder shorter than one code is padding.
        assert_eq!(codes(&[0, 0xFF, 0x73, 2, 3, 1, 0x73, 2, 3], None).len(), 1);
    }
}
