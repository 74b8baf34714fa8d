//! PDO statistics by identifier, updated once per PDO and shared by all rules.

use super::pdo_slot::{PdoFrame, PdoSlot, PdoSurroundings};
use crate::event::DecodedPdo;
use crate::frame::CanId;

/// Maximum number of identifiers per bus.
const SLOT_LIMIT: usize = 4096;

/// Table of a rule by PDO identifier.
#[derive(Debug, Clone)]
pub(crate) struct BySlot<T>(Vec<T>);

impl<T> Default for BySlot<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Default> BySlot<T> {
    /// Entry of an identifier, created if missing; never None.
    #[inline]
    pub fn entry_of(&mut self, slot: &PdoSlot) -> Option<&mut T> {
        if self.0.len() <= slot.place {
            self.grow_to(slot.place);
        }
        self.0.get_mut(slot.place)
    }

    #[cold]
    fn grow_to(&mut self, place: usize) {
        self.0.resize_with(place + 1, T::default);
    }
}

impl<T> BySlot<T> {
    /// Entry by index of the identifier.
    pub fn get(&self, place: usize) -> Option<&T> {
        self.0.get(place)
    }

    /// Mutable entry by index of the identifier.
    pub fn get_mut(&mut self, place: usize) -> Option<&mut T> {
        self.0.get_mut(place)
    }

    /// All entries.
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.0.iter()
    }

    /// Removes all entries.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

/// PDO statistics of one bus.
#[derive(Debug, Clone, Default)]
pub struct PdoTraffic {
    slots: Vec<PdoSlot>,
    /// Index + 1 by index of the identifier on the bus, 0 = none.
    places: Vec<u16>,
    /// Number of SYNC messages.
    syncs: u64,
    /// First frame after the last hole, at least 1.
    resumed: u64,
    /// Index of the current PDO.
    current: Option<usize>,
    /// Longest period of two contents in turn, in ns.
    longest_period: i64,
}

impl PdoTraffic {
    /// Registers a hole in the capture that ended with the frame `resumed`: PDOs on both sides of it do not follow each
    /// other.
    pub(in crate::rules) fn saw_hole(&mut self, resumed: u64) {
        self.resumed = resumed.max(1);
    }

    /// Before the first PDO; `longest_period` limits [`PdoSlot::alternations`], in ns.
    pub(in crate::rules) fn new(longest_period: i64) -> Self {
        Self { longest_period, resumed: 1, ..Self::default() }
    }

    pub(in crate::rules) fn saw_sync(&mut self) {
        self.syncs += 1;
    }

    /// Counts a PDO whose identifier has the index `identifier` on the bus; for a request only the current index is set.
    /// Whether median and period were determined again.
    #[inline]
    pub(in crate::rules) fn saw_pdo(
        &mut self,
        (pdo, identifier): (&DecodedPdo, usize),
        pdo_frame: &PdoFrame,
    ) -> bool {
        self.current = self.place_of(identifier).or_else(|| self.add_entry(identifier, pdo.cob_id));
        let Some((slot, around)) = self.current.and_then(|place| self.slot_mut(place)) else { return false };
        if pdo.is_request {
            slot.is_requested = true;
            return false;
        }
        slot.length = pdo.length;
        slot.take_pdo(pdo_frame, around)
    }

    /// Statistics by index, and what they need of the bus for the next PDO.
    #[inline]
    pub(in crate::rules) fn slot_mut(&mut self, place: usize) -> Option<(&mut PdoSlot, PdoSurroundings)> {
        let (syncs, resumed, longest_period) = (self.syncs, self.resumed, self.longest_period);
        Some((self.slots.get_mut(place)?, PdoSurroundings { syncs, resumed, longest_period }))
    }

    /// Makes a PDO that is counted already the current one.
    #[inline]
    pub(in crate::rules) fn select_current(&mut self, place: usize) {
        self.current = Some(place);
    }

    /// Index of the current PDO.
    pub(in crate::rules) fn current_place(&self) -> Option<usize> {
        self.current
    }

    #[inline]
    fn place_of(&self, identifier: usize) -> Option<usize> {
        usize::from(*self.places.get(identifier)?).checked_sub(1)
    }

    /// Adds the entry of an identifier; `None` if there are too many.
    #[cold]
    pub(in crate::rules) fn add_entry(&mut self, identifier: usize, id: CanId) -> Option<usize> {
        let place = self.slots.len();
        let number = u16::try_from(place + 1).ok().filter(|_| place < SLOT_LIMIT)?;
        if self.places.len() <= identifier {
            self.places.resize(identifier.checked_add(1)?, 0);
        }
        *self.places.get_mut(identifier)? = number;
        self.slots.push(PdoSlot::new(place, id));
        Some(place)
    }

    /// Statistics for the identifier of the current PDO.
    pub fn current_slot(&self) -> Option<&PdoSlot> {
        self.slots.get(self.current?)
    }

    /// Statistics of an identifier, by its index on the bus.
    pub(in crate::rules) fn slot_of(&self, identifier: usize) -> Option<&PdoSlot> {
        self.slots.get(self.place_of(identifier)?)
    }

    /// Statistics of all identifiers.
    pub fn slots(&self) -> &[PdoSlot] {
        &self.slots
    }

    /// Number of SYNC messages.
    pub fn sync_count(&self) -> u64 {
        self.syncs
    }

    /// Number of SYNC messages since the last PDO with an identifier.
    pub fn syncs_since(&self, slot: &PdoSlot) -> u64 {
        self.syncs.saturating_sub(slot.sync)
    }
}
