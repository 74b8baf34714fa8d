//! Figures of J1939 addresses, made of those of identifiers when they are asked for.

use std::collections::{BTreeMap, BTreeSet};

use super::bus::BusStatistics;
use crate::frame::CanId;
use crate::wire::j1939::{J1939Id, NO_ADDRESS, Pgn};

/// What an address sent, transport frames among it.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AddressStatistics {
    /// Frames.
    pub frames: u64,
    /// Their groups.
    pub groups: BTreeSet<Pgn>,
}

impl BusStatistics {
    /// Addresses that sent anything, by the identifiers that are counted.
    pub fn addresses(&self) -> BTreeMap<u8, AddressStatistics> {
        let mut addresses: BTreeMap<u8, AddressStatistics> = BTreeMap::new();
        for ((id, is_remote), figures) in &self.ids {
            let CanId::Extended(number) = id else { continue };
            let Some(id) = J1939Id::of(*number).filter(|id| !is_remote && id.source < NO_ADDRESS) else {
                continue;
            };
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
        // DM1 of 0x80 twice, its request to two addresses, and a claim of who has none.
        for id in [0x18FE_CA80, 0x18FE_CA80, 0x18EA_2180, 0x18EA_2280, 0x18EE_FFFE] {
            bus.frame(&Frame::data_frame(CanId::extended(id), &[0; 8]));
        }
        bus.frame(&Frame::data_frame(CanId::standard(0x80), &[]));
        let groups = BTreeSet::from([Pgn::REQUEST, Pgn::DM1]);
        assert_eq!(bus.addresses(), BTreeMap::from([(0x80, AddressStatistics { frames: 4, groups })]));
    }
}
