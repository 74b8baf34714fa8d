//! What rules know of PDOs by identifier: updated once a PDO, looked at by every rule that judges it.

use std::collections::HashMap;

use foldhash::fast::FixedState;

use crate::event::{FrameRange, Pdo};
use crate::frame::CanId;

/// Intervals the median is taken of.
const INTERVALS: usize = 15;

/// Identifiers of 11 bits.
const STANDARD_IDS: usize = 2048;

/// PDOs between two medians: the usual interval hardly ever changes.
const PAUSE: u8 = 45;

/// Identifiers kept apart on a bus.
const SLOT_LIMIT: usize = 4096;

/// PDOs of one identifier.
#[derive(Debug, Clone, Default)]
pub struct PdoSlot {
    /// Its place: small, and the same for the identifier throughout.
    pub place: usize,
    /// PDOs seen, requests apart.
    pub count: u64,
    /// Nanoseconds since the one before; `None` for the first.
    pub interval: Option<i64>,
    /// Time of this one in nanoseconds.
    pub last: i64,
    /// Frame of this one, and of the one before.
    pub frames: (u64, u64),
    /// How many came since the last SYNC, this one among them.
    pub since_sync: u32,
    /// Median interval, once fifteen were seen.
    pub median: Option<i64>,
    sync: u64,
    intervals: [i64; INTERVALS],
    filled: usize,
    pause: u8,
}

impl PdoSlot {
    fn take(&mut self, now: i64, frame: u64, sync: u64) {
        self.interval = (self.count > 0).then(|| now.saturating_sub(self.last));
        self.count += 1;
        self.last = now;
        self.frames = (frame, self.frames.0);
        self.since_sync = if self.sync == sync { self.since_sync.saturating_add(1) } else { 1 };
        self.sync = sync;
        if self.pause > 0 {
            self.pause -= 1;
            return;
        }
        let Some(interval) = self.interval else { return };
        if let Some(place) = self.intervals.get_mut(self.filled) {
            *place = interval;
            self.filled += 1;
        }
        if self.filled == INTERVALS {
            self.learn();
        }
    }
}

impl PdoSlot {
    #[cold]
    fn learn(&mut self) {
        self.intervals.sort_unstable();
        self.median = self.intervals.get(INTERVALS / 2).copied();
        self.filled = 0;
        self.pause = PAUSE;
    }
}

impl PdoSlot {
    /// From the one before to this one.
    pub fn between(&self) -> FrameRange {
        FrameRange { first: self.frames.1, last: self.frames.0 }
    }
}

/// What a rule keeps of each identifier's PDOs.
#[derive(Debug, Clone)]
pub(crate) struct BySlot<T>(Vec<T>);

impl<T> Default for BySlot<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Default> BySlot<T> {
    /// What is kept of these PDOs; never `None`.
    #[inline]
    pub fn of(&mut self, slot: &PdoSlot) -> Option<&mut T> {
        if self.0.len() <= slot.place {
            self.grow(slot.place);
        }
        self.0.get_mut(slot.place)
    }

    #[cold]
    fn grow(&mut self, place: usize) {
        self.0.resize_with(place + 1, T::default);
    }
}

impl<T> BySlot<T> {
    /// What was kept so far, by place.
    pub fn get(&self, place: usize) -> Option<&T> {
        self.0.get(place)
    }

    /// The same, to be changed.
    pub fn get_mut(&mut self, place: usize) -> Option<&mut T> {
        self.0.get_mut(place)
    }

    /// All that is kept.
    pub fn iter(&self) -> impl Iterator<Item = &T> {
        self.0.iter()
    }

    /// Nothing is kept any more.
    pub fn clear(&mut self) {
        self.0.clear();
    }
}

/// All of them on one bus.
#[derive(Debug, Clone, Default)]
pub struct Traffic {
    slots: Vec<PdoSlot>,
    /// Places of 11-bit identifiers + 1, 0 = none; those of 29 bits.
    standard: Vec<u16>,
    extended: HashMap<u32, u16, FixedState>,
    /// SYNC messages seen.
    syncs: u64,
    /// Place of the PDO that is being judged.
    current: Option<usize>,
}

impl Traffic {
    pub(in crate::rules) fn saw_sync(&mut self) {
        self.syncs += 1;
    }

    /// Takes a PDO; requests are looked up only.
    #[inline]
    pub(in crate::rules) fn saw_pdo(&mut self, pdo: &Pdo, now: i64, frame: u64) {
        self.current = self.place(pdo.cob_id).or_else(|| self.add(pdo.cob_id));
        let Some(place) = self.current.filter(|_| !pdo.is_request) else { return };
        if let Some(slot) = self.slots.get_mut(place) {
            slot.take(now, frame, self.syncs);
        }
    }

    #[inline]
    fn place(&self, id: CanId) -> Option<usize> {
        let place = match id {
            CanId::Standard(id) => self.standard.get(usize::from(id)),
            CanId::Extended(id) => self.extended.get(&id),
        };
        usize::from(*place?).checked_sub(1)
    }

    #[cold]
    fn add(&mut self, id: CanId) -> Option<usize> {
        let place = self.slots.len();
        let number = u16::try_from(place + 1).ok().filter(|_| place < SLOT_LIMIT)?;
        match id {
            CanId::Standard(id) => {
                self.standard.resize(STANDARD_IDS, 0);
                *self.standard.get_mut(usize::from(id))? = number;
            }
            CanId::Extended(id) => {
                self.extended.insert(id, number);
            }
        }
        self.slots.push(PdoSlot { place, ..PdoSlot::default() });
        Some(place)
    }

    /// The identifier of the PDO that is being judged.
    pub fn current(&self) -> Option<&PdoSlot> {
        self.slots.get(self.current?)
    }

    /// What is known of an identifier.
    pub fn of(&self, id: CanId) -> Option<&PdoSlot> {
        self.slots.get(self.place(id)?)
    }

    /// SYNC messages seen.
    pub fn syncs(&self) -> u64 {
        self.syncs
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_counts_and_the_median() {
        let mut slot = PdoSlot::default();
        for number in 0..16_u64 {
            slot.take(i64::try_from(number).unwrap() * 10 + i64::from(number == 7), number, number / 4);
        }
        assert_eq!((slot.count, slot.median, slot.since_sync), (16, Some(10), 4));
        assert_eq!((slot.interval, slot.frames), (Some(10), (15, 14)));
    }
}
