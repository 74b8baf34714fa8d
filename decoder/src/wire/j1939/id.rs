//! Identifiers and parameter group numbers.

use std::fmt;

use nom::Parser;
use nom::number::complete::le_u24;

use crate::wire::parser::Parsed;

/// Global destination address (J1939-21 §5.2.6).
pub const ALL: u8 = 255;

/// Null address: source address of a device without an address (J1939-81 §4.2.2).
pub(crate) const NO_ADDRESS: u8 = 254;

/// First PDU format of PDU2, sent to all (J1939-21 §5.2.4).
const FIRST_PDU2: u8 = 240;

/// A parameter group number of 18 bits: EDP and DP, PDU format, PDU specific or 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Pgn(u32);

impl Pgn {
    /// Request (J1939-21 §5.4.2).
    pub const REQUEST: Self = Self(0xEA00);
    /// Acknowledgement (J1939-21 §5.4.4).
    pub const ACKNOWLEDGEMENT: Self = Self(0xE800);
    /// Connection management of the transport protocol (J1939-21 §5.10.3).
    pub const TP_CM: Self = Self(0xEC00);
    /// Data transfer of the transport protocol (J1939-21 §5.10.3).
    pub const TP_DT: Self = Self(0xEB00);
    /// Connection management of the extended transport protocol (ISO 11783-3).
    pub const ETP_CM: Self = Self(0xC800);
    /// Data transfer of the extended transport protocol (ISO 11783-3).
    pub const ETP_DT: Self = Self(0xC700);
    /// ISO-TP with mixed addresses to one receiver (ISO 15765-2 §10.3.5).
    pub const MIXED_ADDRESSING: Self = Self(0xCE00);
    /// ISO-TP with mixed addresses to a group (ISO 15765-2 §10.3.5).
    pub const MIXED_GROUP: Self = Self(0xCD00);
    /// Address claimed and cannot claim (J1939-81 §4.2.2).
    pub const ADDRESS_CLAIMED: Self = Self(0xEE00);
    /// Commanded address (J1939-81 §4.2.3).
    pub(crate) const COMMANDED_ADDRESS: Self = Self(0xFED8);
    /// Active diagnostic trouble codes (J1939-73 §5.7.1).
    pub const DM1: Self = Self(0xFECA);
    /// Previously active diagnostic trouble codes (J1939-73 §5.7.2).
    pub const DM2: Self = Self(0xFECB);
    /// Clears the previously active trouble codes (J1939-73 §5.7.3).
    pub(crate) const DM3: Self = Self(0xFECC);
    /// Clears the active trouble codes (J1939-73 §5.7.11).
    pub(crate) const DM11: Self = Self(0xFED3);

    /// Creates a PGN from the low 18 bits; higher bits are removed.
    pub const fn new(number: u32) -> Self {
        Self(number & 0x3_FFFF)
    }

    /// Parses three bytes, least significant byte first.
    #[inline]
    pub(super) fn parse_field(data: &[u8]) -> Parsed<'_, Self> {
        le_u24.map(Self::new).parse(data)
    }

    /// PGN as a plain number.
    pub const fn number(self) -> u32 {
        self.0
    }

    /// PDU format, bits 15..8.
    pub const fn format(self) -> u8 {
        self.0.to_le_bytes()[1]
    }

    /// Whether the manufacturer defines the contents: proprietary A, A2, B and B on page 1 (J1939-21 §5.1.3).
    pub const fn is_proprietary(self) -> bool {
        matches!(self.0, 0xEF00 | 0x1_EF00 | 0xFF00..=0xFFFF | 0x1_FF00..=0x1_FFFF)
    }

    /// Whether messages of this group have one destination (PDU1), not all (PDU2).
    pub const fn is_addressed(self) -> bool {
        self.format() < FIRST_PDU2
    }
}

/// Writes `65226 (FECA)`, decimal and hexadecimal.
impl fmt::Display for Pgn {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({:04X})", self.0, self.0)
    }
}

/// Fields of an identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct J1939Id {
    /// Priority 0..=7; 0 is the highest.
    pub priority: u8,
    /// Parameter group number.
    pub pgn: Pgn,
    /// Source address.
    pub source: u8,
    /// Destination address, or [`ALL`].
    pub destination: u8,
}

impl J1939Id {
    /// Reads 29 bits; `None` if the extended data page bit is set: such a message does not belong to J1939
    /// (J1939-21 §5.2.2).
    pub const fn from_identifier(id: u32) -> Option<Self> {
        const EXTENDED_DATA_PAGE: u32 = 1 << 25;
        if id & EXTENDED_DATA_PAGE != 0 {
            return None;
        }
        let [source, specific, format, high] = id.to_le_bytes();
        let page = (high & 1) as u32;
        let group = page << 16 | (format as u32) << 8;
        let (pgn, destination) =
            if format < FIRST_PDU2 { (group, specific) } else { (group | specific as u32, ALL) };
        Some(Self { priority: high >> 2 & 7, pgn: Pgn(pgn), source, destination })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pdu2_belongs_to_the_group() {
        // 18FECA80: priority 6, DM1 (65226) of address 0x80 to all.
        let id = J1939Id::from_identifier(0x18FE_CA80).unwrap();
        assert_eq!(id, J1939Id { priority: 6, pgn: Pgn::DM1, source: 0x80, destination: ALL });
        assert_eq!(id.pgn.to_string(), "65226 (FECA)");
        assert!(!id.pgn.is_addressed());
    }

    #[test]
    fn pdu1_names_its_destination() {
        // 0CEAFF21: priority 3, request of 0x21 to all.
        let id = J1939Id::from_identifier(0x0CEA_FF21).unwrap();
        assert_eq!(id, J1939Id { priority: 3, pgn: Pgn::REQUEST, source: 0x21, destination: ALL });
        assert!(id.pgn.is_addressed());
        // 1CEF8055 on data page 1 is 1DEF8055: PGN 0x1EF00.
        let id = J1939Id::from_identifier(0x1DEF_8055).unwrap();
        assert_eq!((id.priority, id.pgn.number(), id.destination), (7, 0x1_EF00, 0x80));
    }

    #[test]
    fn the_extended_data_page_is_not_j1939() {
        assert_eq!(J1939Id::from_identifier(0x1BC7_8805), None);
        assert_eq!(J1939Id::from_identifier(0x1AFE_CA80), None);
    }
}
