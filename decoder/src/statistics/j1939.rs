//! Statistics of J1939 addresses, derived from those of identifiers.

use std::collections::{BTreeMap, BTreeSet};

use super::bus::BusStatistics;
use crate::frame::CanId;
use crate::wire::isotp::IsoTpAddresses;
use crate::wire::j1939::{J1939Id, NO_ADDRESS, Pgn};

/// Frames sent from an address, including transport frames.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AddressStatistics {
    /// Number of frames.
    pub frames: u64,
    /// Parameter groups of the frames.
    pub groups: BTreeSet<Pgn>,
}

impl BusStatistics {
    /// Statistics of all source addresses, from the identifiers that are counted separately.
    pub fn addresses(&self) -> BTreeMap<u8, AddressStatistics> {
        let mut addresses: BTreeMap<u8, AddressStatistics> = BTreeMap::new();
        for (id, is_remote, figures) in self.ids() {
            let CanId::Extended(number) = id else { continue };
            // ISO 15765 uses groups DA00 and DB00 for ISO-TP; its addresses are not those of J1939 devices.
            let is_isotp = IsoTpAddresses::from_identifier(number).is_some();
            let id = J1939Id::from_identifier(number)
                .filter(|id| !is_remote && !is_isotp && id.source < NO_ADDRESS);
            let Some(id) = id else { continue };
            let address = addresses.entry(id.source).or_default();
            address.frames = address.frames.saturating_add(figures.frames);
            address.groups.insert(id.pgn);
        }
        addresses
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Frame;

    #[test]
    fn frames_and_groups_of_an_address() {
        let mut bus = BusStatistics::default();
        // DM1 of 0x80 twice, its request to two addresses, and a claim without an address.
        // 18DAF120 is an ISO-TP response of 20 to F1.
        for id in [0x18FE_CA80, 0x18FE_CA80, 0x18EA_2180, 0x18EA_2280, 0x18EE_FFFE, 0x18DA_F120] {
            bus.count_frame(&Frame::data_frame(CanId::from_extended(id), &[0; 8]));
        }
        bus.count_frame(&Frame::data_frame(CanId::from_standard(0x80), &[]));
        let groups = BTreeSet::from([Pgn::REQUEST, Pgn::DM1]);
        assert_eq!(bus.addresses(), BTreeMap::from([(0x80, AddressStatistics { frames: 4, groups })]));
    }
}
