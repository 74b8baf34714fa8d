//! PDO statistics by identifier, updated once per PDO and shared by all rules.

use std::cmp::Reverse;

use crate::event::{FrameRange, Pdo};
use crate::frame::{CanId, low_bits};
use crate::session::Preview;

/// Number of intervals for one median.
const INTERVALS: usize = 15;

/// PDOs skipped between two medians, since the usual interval rarely changes.
const PAUSE: u8 = 45;

/// Maximum number of identifiers per bus.
const SLOT_LIMIT: usize = 4096;

/// Statistics of the PDOs with one identifier.
#[derive(Debug, Clone)]
pub struct PdoSlot {
    /// Small index that stays the same for the identifier.
    pub place: usize,
    /// Number of PDOs, without requests.
    pub count: u64,
    /// Time since the previous PDO, in ns; None for the first one.
    pub interval: Option<i64>,
    /// Interval before [`Self::interval`], in ns.
    pub interval_before: Option<i64>,
    /// Time of the last PDO, in ns.
    pub last: i64,
    /// Frame of the last PDO and of the previous one.
    pub frames: (u64, u64),
    /// Frame of the PDO before these two.
    pub earlier: u64,
    /// Number of PDOs since the last SYNC, including the last one.
    pub since_sync: u32,
    /// Median interval in ns; None before 15 intervals.
    pub median: Option<i64>,
    /// Identifier.
    pub id: CanId,
    /// Number of SYNCs between the last PDO and the previous one.
    pub sync_step: u64,
    /// A remote frame requested the PDO.
    pub is_requested: bool,
    /// Consecutive PDOs that fit two producers in turn: two contents at two intervals.
    pub alternations: u32,
    /// Payload, without unused bytes, and length of the last PDO and of the previous one; from the second PDO on.
    contents: [(u64, u8); 2],
    /// Data length of the last PDO.
    length: u8,
    /// Usual interval while the content was constant, before the second content.
    alone: Option<i64>,
    /// Usual interval of PDOs with unchanged content; None if they are irregular or rare.
    period: Option<Period>,
    sync: u64,
    intervals: [i64; INTERVALS],
    /// Bit n is set if the content was unchanged after interval n.
    unchanged: u16,
    began: i64,
    filled: usize,
    pause: u8,
}

/// Interval at which a PDO is also sent with unchanged content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Period {
    /// Interval in ns.
    pub time: i64,
    /// Start of the measurement, in ns.
    pub from: i64,
}

/// Minimum silence of a stream that ended, in ns. Shorter gaps may come from the capturing interface.
const ENDED: i64 = 50_000_000;

/// Minimum number of unchanged PDOs for a period.
const UNCHANGED: usize = 5;

impl PdoSlot {
    pub(in crate::rules) const fn new(place: usize, id: CanId) -> Self {
        Self {
            place,
            count: 0,
            interval: None,
            interval_before: None,
            last: 0,
            frames: (0, 0),
            earlier: 0,
            since_sync: 0,
            median: None,
            id,
            sync_step: 0,
            is_requested: false,
            alternations: 0,
            contents: [(0, 0); 2],
            length: 0,
            alone: None,
            period: None,
            sync: 0,
            intervals: [0; INTERVALS],
            unchanged: 0,
            began: 0,
            filled: 0,
            pause: 0,
        }
    }

    /// Counts a PDO; whether median and period were determined again.
    #[inline]
    fn take(&mut self, pdo: &PdoFrame, (sync, resumed): (u64, u64), longest: i64) -> bool {
        let (now, frame) = (pdo.now, pdo.frame);
        let before = self.interval_before;
        self.length = pdo.length;
        let is_successor = self.count > 0 && self.frames.0 >= resumed;
        self.interval_before = self.interval;
        self.interval = is_successor.then(|| now.saturating_sub(self.last));
        self.count += 1;
        self.last = now;
        self.earlier = self.frames.1;
        self.frames = (frame, self.frames.0);
        self.since_sync = if self.sync == sync { self.since_sync.saturating_add(1) } else { 1 };
        self.sync_step = sync.wrapping_sub(self.sync);
        self.sync = sync;
        let is_learnt = self.measure(now, pdo.is_unchanged);
        if self.count > 1 {
            self.compare((pdo.payload, pdo.length), before, longest);
        }
        is_learnt
    }

    /// Adds the last interval; whether median and period were determined again.
    #[inline]
    fn measure(&mut self, now: i64, is_unchanged: bool) -> bool {
        if self.pause > 0 {
            self.pause -= 1;
            return false;
        }
        let Some(interval) = self.interval else { return false };
        if let Some(place) = self.intervals.get_mut(self.filled) {
            *place = interval;
            if self.filled == 0 {
                (self.unchanged, self.began) = (0, now.saturating_sub(interval));
            }
            self.unchanged |= u16::from(is_unchanged) << self.filled;
            self.filled += 1;
        }
        if self.filled < INTERVALS {
            return false;
        }
        self.learn();
        true
    }

    /// Compares the content with the last two; `before` is the third last interval.
    #[inline]
    fn compare(&mut self, content: (u64, u8), before: Option<i64>, longest: i64) {
        let [last, previous] = self.contents;
        self.contents = [content, last];
        if content == last {
            self.alternations = 0;
            return;
        }
        if content != previous {
            self.alone = self.median.filter(|_| last == previous);
            self.alternations = 0;
            return;
        }
        let intervals = [self.interval, self.interval_before, before].map(|interval| interval.unwrap_or(0));
        let goes_on = self.is_alternation(intervals, (content.0 ^ last.0).count_ones(), longest);
        self.alternations = if goes_on { self.alternations.saturating_add(1) } else { 0 };
    }

    /// Whether intervals, latest first, fit two producers with contents that differ in so many bits.
    fn is_alternation(&self, [interval, last, before]: [i64; 3], bits: u32, longest: i64) -> bool {
        let period = interval.saturating_add(last);
        let shorter = interval.min(last);
        let jitter = period.unsigned_abs() / 20;
        // One producer that alternates a single bit in a rounded period may reach 40 %; other contents do not depend on
        // the phase.
        let unequal = if bits > 1 { period / 20 * 9 } else { period / 5 * 2 };
        // Two phases outside bursts, or a second producer in addition to a known one, at any phase; each with the same
        // interval as one period ago.
        period <= longest
            && interval.abs_diff(before) < jitter
            && ((shorter >= period / 10 && shorter < unequal)
                || self.alone.is_some_and(|alone| alone.abs_diff(period) < jitter))
    }
}

/// A PDO with its time in ns.
#[derive(Debug, Clone, Copy)]
pub(in crate::rules) struct PdoFrame {
    pub(in crate::rules) now: i64,
    pub(in crate::rules) frame: u64,
    /// Little-endian; unused bytes are 0.
    pub(in crate::rules) payload: u64,
    /// Data length in bytes.
    pub(in crate::rules) length: u8,
    pub(in crate::rules) is_unchanged: bool,
}

impl PdoFrame {
    pub(in crate::rules) fn new(pdo: &Pdo, now: i64, frame: u64, is_unchanged: bool) -> Self {
        let used = low_bits(8 * u32::from(pdo.length));
        Self { now, frame, payload: pdo.word() & used, length: pdo.length, is_unchanged }
    }
}

impl PdoSlot {
    #[cold]
    fn learn(&mut self) {
        if self.unchanged != 0 {
            self.period = self.unchanged_period().map(|time| Period { time, from: self.began });
        }
        self.intervals.sort_unstable();
        self.median = self.intervals.get(INTERVALS / 2).copied();
        self.filled = 0;
        self.pause = PAUSE;
    }

    /// Longest usual interval before an unchanged PDO. A change can precede the timer of the device, so
    /// intervals before changed content are not counted. `None` if fewer than three of five are near it; one
    /// of five may be a pause.
    fn unchanged_period(&self) -> Option<i64> {
        let numbered = self.intervals.iter().enumerate();
        let mut all: Vec<i64> = numbered
            .filter(|(place, _)| self.unchanged >> place & 1 == 1)
            .map(|(_, interval)| *interval)
            .collect();
        all.sort_unstable_by_key(|interval| Reverse(*interval));
        let is_usual = |longest: &i64| {
            let near = all.iter().filter(|interval| (longest / 4 * 3..=*longest).contains(*interval)).count();
            near >= UNCHANGED && near * 5 >= all.len() * 3
        };
        all.iter().take(all.len() / 5 + 1).find(|longest| is_usual(longest)).copied()
    }

    /// Interval at which the PDO is also sent with unchanged content, measured after a time; `None` for PDOs
    /// sent on change or on request.
    pub fn period_since(&self, time: i64) -> Option<i64> {
        self.period.filter(|period| period.from >= time && !self.is_requested).map(|period| period.time)
    }

    /// Whether a stream with this interval ended: no PDO for three intervals.
    pub fn has_ended(&self, interval: i64, now: i64) -> bool {
        now.saturating_sub(self.last) > interval.saturating_mul(3).max(ENDED)
    }

    /// Frames from the previous PDO to the last one.
    pub fn between(&self) -> FrameRange {
        FrameRange { first: self.frames.1, last: self.frames.0 }
    }
}

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
pub struct Traffic {
    slots: Vec<PdoSlot>,
    /// Index + 1 by index of the identifier on the bus, 0 = none.
    places: Vec<u16>,
    /// Number of SYNC messages.
    syncs: u64,
    /// First frame after the last hole.
    resumed: u64,
    /// Index of the current PDO.
    current: Option<usize>,
    /// Longest period of two contents in turn, in ns.
    longest_period: i64,
}

impl Traffic {
    /// Registers a hole in the capture that ended with the frame `resumed`: PDOs on both sides of it do not follow each
    /// other.
    pub(in crate::rules) fn saw_hole(&mut self, resumed: u64) {
        self.resumed = resumed;
    }

    /// Before the first PDO; `longest_period` limits [`PdoSlot::alternations`], in ns.
    pub(in crate::rules) fn new(longest_period: i64) -> Self {
        Self { longest_period, ..Self::default() }
    }

    pub(in crate::rules) fn saw_sync(&mut self) {
        self.syncs += 1;
    }

    /// Counts a PDO whose identifier has the index `identifier` on the bus; for a request only the current index is set.
    /// Whether median and period were determined again.
    #[inline]
    pub(in crate::rules) fn saw_pdo(
        &mut self,
        (pdo, identifier): (&Pdo, usize),
        pdo_frame: &PdoFrame,
    ) -> bool {
        self.current = self.place(identifier).or_else(|| self.add(identifier, pdo.cob_id));
        let Some(slot) = self.current.and_then(|place| self.slots.get_mut(place)) else { return false };
        if pdo.is_request {
            slot.is_requested = true;
            return false;
        }
        slot.take(pdo_frame, (self.syncs, self.resumed), self.longest_period)
    }

    /// Counts a PDO of unchanged length by the index of its entry; whether median and period were determined again.
    #[inline]
    pub(in crate::rules) fn saw_skipped(&mut self, place: usize, preview: &Preview, now: i64) -> bool {
        let Some(slot) = self.slots.get_mut(place) else { return false };
        let (frame, payload, length) = (preview.frame, preview.payload, slot.length);
        let is_unchanged = preview.change == 0;
        let pdo = PdoFrame { now, frame, payload, length, is_unchanged };
        slot.take(&pdo, (self.syncs, self.resumed), self.longest_period)
    }

    /// Index of the current PDO.
    pub(in crate::rules) fn current_place(&self) -> Option<usize> {
        self.current
    }

    #[inline]
    fn place(&self, identifier: usize) -> Option<usize> {
        usize::from(*self.places.get(identifier)?).checked_sub(1)
    }

    #[cold]
    fn add(&mut self, identifier: usize, id: CanId) -> Option<usize> {
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
    pub fn current(&self) -> Option<&PdoSlot> {
        self.slots.get(self.current?)
    }

    /// Statistics of an identifier, by its index on the bus.
    pub(in crate::rules) fn of(&self, identifier: usize) -> Option<&PdoSlot> {
        self.slots.get(self.place(identifier)?)
    }

    /// Statistics of all identifiers.
    pub fn slots(&self) -> &[PdoSlot] {
        &self.slots
    }

    /// Number of SYNC messages.
    pub fn syncs(&self) -> u64 {
        self.syncs
    }

    /// Number of SYNC messages since the last PDO with an identifier.
    pub fn syncs_since(&self, slot: &PdoSlot) -> u64 {
        self.syncs.saturating_sub(slot.sync)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn pdo_at(now: i64, frame: u64, is_unchanged: bool) -> PdoFrame {
        PdoFrame { now, frame, payload: 0, length: 0, is_unchanged }
    }

    #[test]
    fn two_contents_at_two_intervals_alternate() {
        let mut slot = PdoSlot::new(0, CanId::standard(0x181));
        // Contents 1 and 6 at intervals of 30 and 70; the first PDO is not compared.
        for number in 0..20_i64 {
            let now = number / 2 * 100 + number % 2 * 30;
            let pdo = PdoFrame { payload: if number % 2 == 0 { 1 } else { 6 }, ..pdo_at(now, 1, false) };
            slot.take(&pdo, (0, 0), 100);
        }
        // The contents of the second and the third PDO are new; the other 17 alternate.
        assert_eq!(slot.alternations, 17);
        let repeated = PdoFrame { payload: 6, ..pdo_at(1_000, 1, true) };
        slot.take(&repeated, (0, 0), 100);
        assert_eq!(slot.alternations, 0);
    }

    #[test]
    fn intervals_counts_and_the_median() {
        let mut slot = PdoSlot::new(0, CanId::standard(0x181));
        for number in 0..16_u64 {
            let now = i64::try_from(number).unwrap() * 10 + i64::from(number == 7);
            slot.take(&pdo_at(now, number, false), (number / 4, 0), 0);
        }
        assert_eq!((slot.count, slot.median, slot.since_sync), (16, Some(10), 4));
        assert_eq!((slot.interval, slot.frames, slot.period_since(0)), (Some(10), (15, 14), None));
    }

    /// Period after 16 PDOs, each with its time and whether its content is unchanged.
    fn period_of(pdo: impl Fn(i64) -> (i64, bool)) -> Option<i64> {
        let mut slot = PdoSlot::new(0, CanId::standard(0x181));
        for number in 0..16 {
            let (time, is_unchanged) = pdo(number);
            slot.take(&pdo_at(time, number.unsigned_abs(), is_unchanged), (0, 0), 0);
        }
        slot.period_since(i64::MIN)
    }

    #[test]
    fn only_unchanged_content_proves_a_period() {
        assert_eq!(period_of(|n| (n * 50, true)), Some(50));
        assert_eq!(period_of(|n| (n * 50, false)), None);
        // Event timer 100, and a change 30 after each expiry: the next expiry follows 100 after the change.
        assert_eq!(period_of(|n| (n / 2 * 130 + n % 2 * 30, n % 2 == 0)), Some(100));
        // A pause, then a period.
        assert_eq!(period_of(|n| (if n == 0 { -300 } else { n * 50 }, true)), Some(50));
        // Repetitions at irregular times.
        assert_eq!(period_of(|n| (n * n * 10, true)), None);
        // Too few of them.
        assert_eq!(period_of(|n| (n * 50, n < 5)), None);
    }
}
