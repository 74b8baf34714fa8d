//! The standards, each with its table file.

use super::field::FieldDefinition;
use super::table::{FILES, NamedParameter, TableIndex};
use crate::profile::{LayoutOrigin, is_nmea2000_group};
use crate::wire::j1939::Pgn;

/// A standard with a table of groups.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Standard {
    J1939,
    Nmea2000,
    RvC,
}

impl Standard {
    pub(super) fn index(self) -> &'static TableIndex {
        let [j1939, nmea2000, rv_c, _] = &FILES;
        match self {
            Self::J1939 => j1939,
            Self::Nmea2000 => nmea2000,
            Self::RvC => rv_c,
        }
        .index()
    }

    /// Whether the standard defines a group.
    pub fn has_group(self, pgn: Pgn) -> bool {
        !self.index().variants_of(pgn.number()).is_empty()
    }

    pub(super) const fn origin(self) -> LayoutOrigin {
        match self {
            Self::J1939 => LayoutOrigin::J1939,
            Self::Nmea2000 => LayoutOrigin::Nmea2000,
            Self::RvC => LayoutOrigin::RvC,
        }
    }
}

/// Whether NMEA 2000 sends a group that has no name of ours as fast packets.
pub(crate) fn is_fast_group(pgn: Pgn) -> bool {
    !is_nmea2000_group(pgn)
        && Standard::Nmea2000.index().variants_of(pgn.number()).iter().any(|variant| variant.is_fast)
}

/// Name and unit of a suspect parameter of J1939.
pub(crate) fn standard_parameter(spn: u32) -> Option<NamedParameter<'static>> {
    Standard::J1939.index().parameter(spn)
}

/// Field of another group by its number, from 1; `None` if several definitions of the group differ in it.
pub(super) fn referenced_field(group: u32, number: u8) -> Option<&'static FieldDefinition> {
    let index = Standard::Nmea2000.index();
    let variants = index.variants_of(group);
    match variants {
        [only] => only.numbered_field(u64::from(number)),
        // All start with manufacturer and industry.
        [_, ..] => index.range_of(group)?.numbered_field(u64::from(number)).filter(|_| number <= 3),
        [] => None,
    }
}
