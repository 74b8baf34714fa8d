//! Look-up of a group: the definition that fits a payload, with its layout.

use std::sync::{Arc, PoisonError};

use super::definition::{GroupDefinition, MOST_LAYOUTS};
use super::layout::layout_of;
use super::placement::PlacementWalk;
use super::standard::Standard;
use crate::profile::{LayoutOrigin, PayloadLayout};
use crate::wire::j1939::Pgn;

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
            layout: chosen.layout_of_payload(payload, standard.origin()),
            deciding: variants.iter().fold(0, |bits, variant| bits | variant.deciding_bits()),
        })
    })
}

impl GroupDefinition {
    /// Layout for the lengths in a payload. A single frame has all fields of the definition: those after its end are
    /// missing.
    fn layout_of_payload(&self, payload: &[u8], origin: LayoutOrigin) -> Arc<PayloadLayout> {
        const FRAME: usize = 8;
        let fixed = self.fixed_bits.map(|bits| usize::from(bits.div_ceil(8)));
        let places = match fixed {
            Some(length) if payload.len() <= FRAME && length <= FRAME => {
                PlacementWalk::place_fields(self, &[0; FRAME])
            }
            _ => PlacementWalk::place_fields(self, payload),
        };
        let mut layouts = self.layouts.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = layouts.get(&places) {
            return Arc::clone(known);
        }
        let layout = Arc::new(layout_of(self, &places, origin));
        if layouts.len() < MOST_LAYOUTS {
            layouts.insert(places, Arc::clone(&layout));
        }
        layout
    }
}
