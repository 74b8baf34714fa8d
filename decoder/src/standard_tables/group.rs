//! Look-up of a group: the definition that fits a payload, with its layout.

use std::sync::{Arc, PoisonError};

use super::definition::{FieldDefinition, GroupDefinition, MOST_LAYOUTS};
use super::layout::layout_of;
use super::placement::PlacementWalk;
use super::table::{FILES, NamedParameter, TableIndex};
use crate::profile::{LayoutOrigin, PayloadLayout, is_nmea2000_group};
use crate::wire::j1939::Pgn;

/// A standard with a table of groups.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Standard {
    J1939,
    Nmea2000,
    RvC,
}

impl Standard {
    fn index(self) -> &'static TableIndex {
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

    const fn origin(self) -> LayoutOrigin {
        match self {
            Self::J1939 => LayoutOrigin::J1939,
            Self::Nmea2000 => LayoutOrigin::Nmea2000,
            Self::RvC => LayoutOrigin::RvC,
        }
    }
}

/// A group as a standard defines it.
pub(crate) struct StandardGroup {
    /// Name; empty for a range of groups.
    pub name: Arc<str>,
    /// Fields of the payload.
    pub layout: Arc<PayloadLayout>,
    /// Bits of the first eight bytes that decide which definition applies, and where its fields are.
    pub deciding: u64,
}

/// Definition of a group in the first of these standards that has one for the payload.
pub(crate) fn standard_group(standards: &[Standard], pgn: Pgn, payload: &[u8]) -> Option<StandardGroup> {
    standards.iter().find_map(|standard| {
        let index = standard.index();
        let variants = index.variants_of(pgn.number());
        let chosen = variants.iter().find(|variant| variant.matches_payload(payload));
        let chosen = chosen.or_else(|| index.range_of(pgn.number()))?;
        if chosen.lines.is_empty() {
            return None;
        }
        Some(StandardGroup {
            name: Arc::clone(&chosen.name),
            layout: chosen.layout_of_payload(index, payload, standard.origin()),
            deciding: variants.iter().fold(0, |bits, variant| bits | variant.deciding_bits()),
        })
    })
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

impl GroupDefinition {
    /// Layout for the lengths in a payload. A single frame has all fields of the definition: those after its end are
    /// missing.
    fn layout_of_payload(
        &self,
        index: &'static TableIndex,
        payload: &[u8],
        origin: LayoutOrigin,
    ) -> Arc<PayloadLayout> {
        const FRAME: usize = 8;
        let fixed = self.fixed_bits.map(|bits| usize::from(bits.div_ceil(8)));
        let places = match fixed {
            Some(length) if payload.len() <= FRAME && length <= FRAME => {
                PlacementWalk::place_fields(self, index, &[0; FRAME])
            }
            _ => PlacementWalk::place_fields(self, index, payload),
        };
        let mut layouts = self.layouts.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = layouts.get(&places) {
            return Arc::clone(known);
        }
        let layout = Arc::new(layout_of(self, index, &places, origin));
        if layouts.len() < MOST_LAYOUTS {
            layouts.insert(places, Arc::clone(&layout));
        }
        layout
    }
}
