//! Names of J1939 and NMEA 2000 parameter groups, and which of them are fast packets.

use std::sync::OnceLock;

use serde::Deserialize;

use crate::profile::embedded::parse_embedded;
use crate::wire::j1939::Pgn;

/// A group, or a range of groups, of either file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ParameterGroup {
    number: u32,
    to: Option<u32>,
    #[serde(default)]
    fast: bool,
    name: String,
}

impl ParameterGroup {
    fn last_pgn(&self) -> u32 {
        self.to.unwrap_or(self.number)
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct J1939File {
    pgn: Vec<ParameterGroup>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Nmea2000File {
    group: Vec<ParameterGroup>,
    proprietary_fast: Vec<[u32; 2]>,
}

/// Groups in ascending order, for a binary search.
struct ParameterGroups(Vec<ParameterGroup>);

impl ParameterGroups {
    fn new(mut list: Vec<ParameterGroup>) -> Self {
        list.sort_by_key(|group| group.number);
        Self(list)
    }

    fn find_group(&self, pgn: Pgn) -> Option<&ParameterGroup> {
        let number = pgn.number();
        let after = self.0.partition_point(|group| group.number <= number);
        self.0.get(after.checked_sub(1)?).filter(|group| number <= group.last_pgn())
    }
}

/// Groups of the J1939 protocol, of ISO 11783 and of J1939-71.
fn of_j1939() -> &'static ParameterGroups {
    static TABLE: OnceLock<ParameterGroups> = OnceLock::new();
    TABLE.get_or_init(|| ParameterGroups::new(parse_embedded::<J1939File>("lookups/pgns.toml").pgn))
}

/// Groups of NMEA 2000, and the ranges of proprietary fast packets.
fn of_nmea2000() -> &'static (ParameterGroups, Vec<[u32; 2]>) {
    static TABLE: OnceLock<(ParameterGroups, Vec<[u32; 2]>)> = OnceLock::new();
    TABLE.get_or_init(|| {
        let file: Nmea2000File = parse_embedded("lookups/nmea2000.toml");
        (ParameterGroups::new(file.group), file.proprietary_fast)
    })
}

/// Name of a parameter group, with its acronym if it has one: `EEC1 electronic engine controller 1`.
pub fn pgn_name(pgn: Pgn) -> Option<String> {
    let group = of_j1939().find_group(pgn).or_else(|| of_nmea2000().0.find_group(pgn))?;
    Some(group.name.replace("{n}", &pgn.number().saturating_sub(group.number).to_string()))
}

/// Whether a group has a public definition: a bus that sends several of them is likely a J1939 bus.
pub(crate) fn is_public_group(pgn: Pgn) -> bool {
    !pgn.is_proprietary()
        && (of_j1939().find_group(pgn).is_some() || of_nmea2000().0.find_group(pgn).is_some())
}

/// Whether only NMEA 2000 defines a group.
pub(crate) fn is_nmea2000_group(pgn: Pgn) -> bool {
    of_nmea2000().0.find_group(pgn).is_some()
}

/// Whether NMEA 2000 sends a group as fast packets. Proprietary ones are fast packets only if the bus is known
/// to be NMEA 2000: J1939 uses their numbers for single frames.
pub(crate) fn is_fast_packet(pgn: Pgn, is_nmea2000: bool) -> bool {
    let (groups, proprietary) = of_nmea2000();
    let in_range = |[first, last]: &[u32; 2]| (*first..=*last).contains(&pgn.number());
    groups.find_group(pgn).is_some_and(|group| group.fast) || is_nmea2000 && proprietary.iter().any(in_range)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_number_belongs_to_two_groups() {
        for groups in [of_j1939(), &of_nmea2000().0] {
            for pair in groups.0.windows(2) {
                assert!(pair[0].last_pgn() < pair[1].number, "{:X}", pair[1].number);
                assert!(pair[1].last_pgn() < 1 << 18 && !pair[1].name.is_empty());
            }
        }
        let both =
            of_nmea2000().0.0.iter().filter(|group| of_j1939().find_group(Pgn::new(group.number)).is_some());
        assert_eq!(both.count(), 0);
        // PDU1 groups have 0 in the place of the destination (J1939-21 §5.2.4).
        let all = of_j1939().0.iter().chain(&of_nmea2000().0.0);
        for group in all.filter(|group| Pgn::new(group.number).is_addressed()) {
            assert_eq!(group.number & 0xFF, 0, "{}", group.name);
        }
    }

    #[test]
    fn names_with_acronyms_and_numbers() {
        let name = |number: u32| pgn_name(Pgn::new(number));
        // SAE J1939-71: 61444 is EEC1, 65262 is ET1, 65265 is CCVS1; NMEA 2000: 127250 is vessel heading.
        assert_eq!(name(61444).unwrap(), "EEC1 electronic engine controller 1");
        assert!(name(65262).unwrap().starts_with("ET1 ") && name(65265).unwrap().starts_with("CCVS1 "));
        assert_eq!(name(127_250).unwrap(), "vessel heading");
        assert_eq!(name(0xFE3F).unwrap(), "auxiliary valve 15 command");
        assert_eq!(name(0x3_FFFF), None);
        let public = |number: u32| is_public_group(Pgn::new(number));
        assert!(public(0xF004) && public(0x1_F112) && public(0xFECA));
        assert!(!public(0xEF00) && !public(0xFF10) && !public(0x1_FF10) && !public(0x0100_0000 - 1));
    }

    #[test]
    fn fast_packets_by_group_and_by_bus() {
        let fast = |number: u32, is_nmea2000| is_fast_packet(Pgn::new(number), is_nmea2000);
        // 129029 (GNSS position data) has 43 bytes; 129025 (position, rapid update) has 8.
        assert!(fast(129_029, false) && !fast(129_025, true));
        assert!(fast(126_720, true) && fast(131_071, true) && fast(130_816, true));
        assert!(!fast(126_720, false) && !fast(131_071, false) && !fast(0xEF00, true) && !fast(0xFF00, true));
    }
}
