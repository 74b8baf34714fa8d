//! Steady messages of groups with a public definition: evidence for J1939 without network management.
//!
//! A car bus also has 29-bit identifiers, but their bits form groups from the whole range, few of which are
//! defined. So most identifiers must have a defined group.

use crate::profile::is_public_group;
use crate::wire::j1939::{J1939Id, NO_ADDRESS, Pgn};

/// Frames of an identifier after which it is steady.
const STEADY: u8 = 3;

/// Steady identifiers with a public group that are enough.
const ENOUGH: usize = 4;

/// Max identifiers stored of each kind.
const LIMIT: usize = 32;

/// Frames of a round. All of the first round are evaluated, and the first `SAMPLED` of each later one.
const ROUND: u32 = 4096;
const SAMPLED: u32 = 256;

/// Identifiers seen so far.
#[derive(Debug, Clone, Default)]
pub(super) struct PublicGroups {
    frames: u32,
    /// Group and sender of each identifier with a public group, with its number of frames.
    public: Vec<(Pgn, u8, u8)>,
    /// Group and sender of each other identifier, except proprietary ones.
    others: Vec<(Pgn, u8)>,
}

impl PublicGroups {
    /// Counts a frame.
    pub(super) fn count_frame(&mut self, id: J1939Id) {
        let is_skipped = self.frames >= ROUND && self.frames % ROUND >= SAMPLED;
        self.frames = self.frames.checked_add(1).unwrap_or(ROUND);
        if is_skipped || id.pgn.is_proprietary() || id.source >= NO_ADDRESS {
            return;
        }
        let (pgn, source) = (id.pgn, id.source);
        if let Some((_, _, count)) = self.public.iter_mut().find(|(it, by, _)| (*it, *by) == (pgn, source)) {
            *count = count.saturating_add(1);
        } else if self.others.contains(&(pgn, source)) {
        } else if is_public_group(pgn) {
            if self.public.len() < LIMIT {
                self.public.push((pgn, source, 1));
            }
        } else if self.others.len() < LIMIT {
            self.others.push((pgn, source));
        }
    }

    /// Whether the traffic is that of J1939: several steady public groups, and more public than undefined groups; of
    /// one address alone, no undefined ones.
    pub(super) fn are_evidence(&self) -> bool {
        let steady = || self.public.iter().filter(|(_, _, count)| *count >= STEADY);
        let mut sources = steady().map(|(_, source, _)| source);
        let first = sources.next();
        steady().count() >= ENOUGH
            && self.public.len() > self.others.len()
            && (self.others.is_empty() || sources.any(|source| Some(source) != first))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(ids: &[u32], rounds: usize) -> bool {
        let mut groups = PublicGroups::default();
        for id in ids.iter().cycle().take(ids.len() * rounds) {
            groups.count_frame(J1939Id::from_identifier(*id).unwrap());
        }
        groups.are_evidence()
    }

    // EEC1, ET1 and CCVS1 (61444, 65262, 65265) of 00; VDC1 (65103) of 0B.
    const TRUCK: [u32; 4] = [0x0CF0_0400, 0x18FE_EE00, 0x18FE_F100, 0x18FE_4F0B];

    #[test]
    fn steady_groups_of_two_addresses() {
        assert!(taken(&TRUCK, 3));
        assert!(!taken(&TRUCK, 2), "not steady yet");
        let of_one: Vec<u32> = TRUCK.iter().map(|id| id & !0xFF).collect();
        assert!(taken(&of_one, 9), "one address");
        assert!(!taken(&of_one[..3], 9), "three groups of one address");
        assert!(!taken(&[&of_one[..], &[0x1021_0000]].concat(), 9), "one address, and an undefined group");
        // Proprietary B groups neither help nor hinder.
        let own: Vec<u32> = (0..40).map(|number| 0x18FF_0000 | number << 8).collect();
        assert!(!taken(&own, 9));
        assert!(taken(&[&TRUCK[..], &own[..]].concat(), 3));
    }

    #[test]
    fn undefined_groups_outweigh_some_that_are_defined() {
        // Identifiers of a car: PF 21, 2C, 30, AC ... of many addresses, and by chance four that are defined.
        let car: Vec<u32> = (0..4).map(|number| 0x1021_0040 + number * 0x000B_0020).collect();
        assert!(!taken(&[&TRUCK[..], &car[..]].concat(), 9));
        assert!(taken(&[&TRUCK[..], &car[..3]].concat(), 9));
    }

    #[test]
    fn memory_is_bounded_and_a_late_network_is_still_found() {
        let mut groups = PublicGroups::default();
        for id in (0..200_000_u32).map(|number| number.wrapping_mul(0x9E37_79B1) & 0x1DFF_FFFF) {
            groups.count_frame(J1939Id::from_identifier(id).unwrap());
        }
        assert!(groups.public.len() <= LIMIT && groups.others.len() <= LIMIT && !groups.are_evidence());
        let mut late = PublicGroups { frames: ROUND + SAMPLED, ..PublicGroups::default() };
        for id in TRUCK.iter().cycle().take(8192) {
            late.count_frame(J1939Id::from_identifier(*id).unwrap());
        }
        assert!(late.are_evidence());
    }
}
