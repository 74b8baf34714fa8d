//! Evidence of RV-C: groups that only this standard defines, in frames of eight bytes.

use super::standard::Standard;
use crate::wire::j1939::Pgn;

/// Different groups of RV-C that are enough.
const ENOUGH: usize = 4;

/// Groups of RV-C that a bus sends.
#[derive(Debug, Clone, Default)]
pub(crate) struct RvCEvidence {
    groups: Vec<Pgn>,
}

impl RvCEvidence {
    /// Whether the bus is one of RV-C.
    pub fn is_established(&self) -> bool {
        self.groups.len() >= ENOUGH
    }

    /// Counts the first message of an identifier; returns whether it completes the evidence. NMEA 2000 sends fast packets
    /// on some of these groups, so it must not be known on this bus.
    pub fn note_group(&mut self, pgn: Pgn, length: usize, is_nmea2000: bool) -> bool {
        /// Length of all messages of RV-C.
        const LENGTH: usize = 8;
        /// First group of data page 1: J1939 defines those of page 0.
        const PAGE_1: u32 = 0x1_0000;
        let is_candidate = length == LENGTH && pgn.number() >= PAGE_1 && !is_nmea2000;
        if self.is_established()
            || !is_candidate
            || self.groups.contains(&pgn)
            || !Standard::RvC.has_group(pgn)
        {
            return false;
        }
        self.groups.push(pgn);
        self.is_established()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_groups_of_the_standard_are_evidence() {
        // DC_SOURCE_STATUS_1, DATE_TIME_STATUS, TANK_STATUS, THERMOSTAT_AMBIENT_STATUS (RV-C, DGN in hexadecimal).
        let groups = [0x1_FFFD, 0x1_FFFF, 0x1_FFB7, 0x1_FF9C].map(Pgn::new);
        let mut evidence = RvCEvidence::default();
        assert!(!groups[..3].iter().any(|pgn| evidence.note_group(*pgn, 8, false)));
        // A repeated group, a group of J1939, a short message and a bus of NMEA 2000 prove nothing.
        assert!(!evidence.note_group(groups[0], 8, false));
        assert!(!evidence.note_group(Pgn::new(0xF004), 8, false));
        assert!(!evidence.note_group(groups[3], 7, false) && !evidence.note_group(groups[3], 8, true));
        assert!(evidence.note_group(groups[3], 8, false) && evidence.is_established());
        assert!(!evidence.note_group(Pgn::new(0x1_FFFC), 8, false), "reported once");
    }
}
