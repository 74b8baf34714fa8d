//! Sender and receiver in a 29-bit identifier, for the two addressing schemes that need no table.
//!
//! ```text
//! bit 28..26    25    24   23..........16  15..........8  7............0
//! priority      0     0    DA or DB        target         source           normal fixed (ISO 15765-2 §10.3.3)
//! priority      1     1    22 22  21..........11          10...........0
//!               EDP   DP   type   source: net, node       target: net, node   with nets (ISO 15765-3)
//! ```

use crate::wire::parser::bit_field;

/// Position of the addresses in an identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum AddressScheme {
    /// Source and target of eight bits each; PF distinguishes one receiver from a group.
    NormalFixed,
    /// Source and target of three bits net and eight bits node each; EDP and DP are set.
    Net,
}

/// Sender and receiver of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct IsoTpAddresses {
    /// Scheme of the identifier.
    pub scheme: AddressScheme,
    /// Bits 28..26 of the identifier; 0 is the highest priority.
    pub priority: u8,
    /// Type of service, two bits; 0 with normal fixed addresses.
    pub service_type: u8,
    /// Whether the target is a group (PF 0xDB).
    pub functional: bool,
    /// Sender: net in bits 10..8, node in 7..0.
    pub source: u16,
    /// Receiver: net in bits 10..8, node in 7..0.
    pub target: u16,
}

/// EDP and DP: bits 25 and 24.
const PAGES: u32 = 0x0300_0000;

impl IsoTpAddresses {
    /// Addresses in a 29-bit identifier; `None` if it follows neither scheme.
    pub fn from_identifier(id: u32) -> Option<Self> {
        let priority = bit_field(id, 26, 3);
        match (id & PAGES, bit_field(id, 16, 8)) {
            (0, format @ (0xDA_u8 | 0xDB)) => Some(Self {
                scheme: AddressScheme::NormalFixed,
                priority,
                service_type: 0,
                functional: format == 0xDB,
                source: bit_field(id, 0, 8),
                target: bit_field(id, 8, 8),
            }),
            (PAGES, _) => Some(Self {
                scheme: AddressScheme::Net,
                priority,
                service_type: bit_field(id, 22, 2),
                functional: false,
                source: bit_field(id, 11, 11),
                target: bit_field(id, 0, 11),
            }),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_fixed() {
        // 18DA20F1: priority 6, PF DA, target 20, source F1.
        let found = IsoTpAddresses::from_identifier(0x18DA_20F1).unwrap();
        assert_eq!((found.scheme, found.priority, found.functional), (AddressScheme::NormalFixed, 6, false));
        assert_eq!((found.source, found.target), (0xF1, 0x20));
        let group = IsoTpAddresses::from_identifier(0x18DB_33F1).unwrap();
        assert_eq!((group.functional, group.source, group.target), (true, 0xF1, 0x33));
        // Another priority is the same pair; with DP or EDP set it is another PGN.
        assert_eq!(IsoTpAddresses::from_identifier(0x0CDA_20F1).map(|found| found.target), Some(0x20));
        for id in [0x19DA_20F1, 0x1ADA_20F1, 0x18EF_20F1, 0x18DC_20F1] {
            assert_eq!(IsoTpAddresses::from_identifier(id), None, "{id:08X}");
        }
    }

    #[test]
    fn with_nets() {
        // 1BC78820 = 110 1 1 11 00011110001 00000100000: priority 6, type 3, source F1, target 20, both on net 0.
        let found = IsoTpAddresses::from_identifier(0x1BC7_8820).unwrap();
        assert_eq!((found.scheme, found.priority, found.service_type), (AddressScheme::Net, 6, 3));
        assert_eq!((found.source, found.target), (0xF1, 0x20));
        // Response: 1BC100F1 = 110 1 1 11 00000100000 00011110001.
        let answer = IsoTpAddresses::from_identifier(0x1BC1_00F1).unwrap();
        assert_eq!((answer.source, answer.target), (0x20, 0xF1));
        // Net 1 of the source is bit 19.
        assert_eq!(IsoTpAddresses::from_identifier(0x1BCF_8820).map(|found| found.source), Some(0x1F1));
    }
}
