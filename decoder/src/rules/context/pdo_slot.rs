//! Statistics of the PDOs with one identifier.

use crate::event::{DecodedPdo, FrameRange};
use crate::frame::{CanId, low_bits};
use crate::session::MessagePreview;

/// Number of intervals for one median.
const INTERVALS: usize = 15;

/// PDOs skipped between two medians, since the usual interval rarely changes.
const PAUSE: u8 = 45;

/// Value for an interval before the second PDO and after a hole.
const NO_INTERVAL: i64 = i64::MIN;

/// Statistics of the PDOs with one identifier.
#[derive(Debug, Clone)]
pub struct PdoSlot {
    /// Small index that stays the same for the identifier.
    pub place: usize,
    /// Number of PDOs, without requests.
    pub count: u64,
    /// Time since the previous PDO, and the interval before it, in ns; [`NO_INTERVAL`] for none.
    intervals: (i64, i64),
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
    /// Contents of the last PDO and of the previous one; from the second PDO on.
    contents: [PdoContent; 2],
    /// Data length of the last PDO in bytes.
    pub(super) length: u8,
    /// Usual interval while the content was constant, before the second content.
    alone: Option<i64>,
    /// Usual interval of PDOs with unchanged content; None if they are irregular or rare.
    period: Option<ResendInterval>,
    /// Number of SYNC messages before the last PDO.
    pub(super) sync: u64,
    /// Intervals for the next median.
    measured: [i64; INTERVALS],
    /// Bit n is set if the content was unchanged after interval n.
    unchanged: u16,
    began: i64,
    filled: usize,
    pause: u8,
}

/// Interval at which a PDO is also sent with unchanged content.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ResendInterval {
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
            intervals: (NO_INTERVAL, NO_INTERVAL),
            last: 0,
            frames: (0, 0),
            earlier: 0,
            since_sync: 0,
            median: None,
            id,
            sync_step: 0,
            is_requested: false,
            alternations: 0,
            contents: [PdoContent { payload: 0, length: 0 }; 2],
            length: 0,
            alone: None,
            period: None,
            sync: 0,
            measured: [0; INTERVALS],
            unchanged: 0,
            began: 0,
            filled: 0,
            pause: 0,
        }
    }

    /// Time since the previous PDO, in ns; `None` for the first one and after a hole.
    pub fn interval(&self) -> Option<i64> {
        Some(self.intervals.0).filter(|interval| *interval != NO_INTERVAL)
    }

    /// Interval before [`Self::interval`], in ns.
    pub fn interval_before(&self) -> Option<i64> {
        Some(self.intervals.1).filter(|interval| *interval != NO_INTERVAL)
    }

    /// Counts a PDO of unchanged length; whether median and period were determined again.
    #[inline]
    pub(in crate::rules) fn skip_pdo(
        &mut self,
        preview: &MessagePreview,
        (now, interval): (i64, i64),
        around: PdoSurroundings,
    ) -> bool {
        let content = PdoContent { payload: preview.payload, length: self.length };
        let is_unchanged = preview.change == 0;
        self.add_pdo(PdoFrame { now, frame: preview.frame, content, is_unchanged }, interval, around)
    }

    /// Counts a PDO; whether median and period were determined again.
    pub(super) fn take_pdo(&mut self, pdo: &PdoFrame, around: PdoSurroundings) -> bool {
        self.add_pdo(*pdo, self.interval_at(pdo.now), around)
    }

    /// Time from the last PDO to the time `now`, in ns.
    #[inline]
    pub(in crate::rules) fn interval_at(&self, now: i64) -> i64 {
        now.saturating_sub(self.last)
    }

    #[expect(clippy::inline_always, reason = "passing the arguments costs a tenth of a skipped frame")]
    #[inline(always)]
    fn add_pdo(&mut self, pdo: PdoFrame, interval: i64, around: PdoSurroundings) -> bool {
        let PdoSurroundings { syncs: sync, resumed, longest_period: longest } = around;
        let interval = if self.frames.0 < resumed { NO_INTERVAL } else { interval };
        let (last, before) = self.intervals;
        self.intervals = (interval, last);
        self.last = pdo.now;
        self.earlier = self.frames.1;
        self.frames = (pdo.frame, self.frames.0);
        self.count += 1;
        if self.sync == sync {
            self.since_sync = self.since_sync.saturating_add(1);
            self.sync_step = 0;
        } else {
            self.since_sync = 1;
            self.sync_step = sync.wrapping_sub(self.sync);
            self.sync = sync;
        }
        let is_learnt = if self.pause > 0 {
            self.pause -= 1;
            false
        } else {
            interval != NO_INTERVAL && self.add_interval(interval, pdo.now, pdo.is_unchanged)
        };
        let [content, previous] = &mut self.contents;
        if *content != pdo.content {
            self.compare_content((pdo.content, longest), before);
        } else if *previous != pdo.content {
            *previous = pdo.content;
            self.alternations = 0;
        }
        is_learnt
    }

    /// Adds an interval; whether median and period were determined again.
    fn add_interval(&mut self, interval: i64, now: i64, is_unchanged: bool) -> bool {
        if let Some(place) = self.measured.get_mut(self.filled) {
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
        self.learn_period();
        true
    }

    /// Compares a new content with the last two; `before` is the third last interval.
    fn compare_content(&mut self, (content, longest): (PdoContent, i64), before: i64) {
        if self.count <= 1 {
            return;
        }
        let [last, previous] = self.contents;
        self.contents = [content, last];
        if content != previous {
            self.alone = self.median.filter(|_| last == previous);
            self.alternations = 0;
            return;
        }
        let (interval, interval_before) = self.intervals;
        let intervals = [interval, interval_before, before]
            .map(|interval| if interval == NO_INTERVAL { 0 } else { interval });
        let goes_on = self.is_alternation(intervals, (content.payload ^ last.payload).count_ones(), longest);
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
    pub(in crate::rules) content: PdoContent,
    pub(in crate::rules) is_unchanged: bool,
}

/// State of the bus at a PDO.
#[derive(Debug, Clone, Copy)]
pub(in crate::rules) struct PdoSurroundings {
    /// Number of SYNC messages.
    pub(super) syncs: u64,
    /// First frame after the last hole, at least 1.
    pub(super) resumed: u64,
    /// Longest period of two contents in turn, in ns.
    pub(super) longest_period: i64,
}

/// Payload and length of a PDO.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::rules) struct PdoContent {
    /// Little-endian; unused bytes are 0.
    payload: u64,
    /// In bytes.
    length: u8,
}

impl PdoFrame {
    pub(in crate::rules) fn new(pdo: &DecodedPdo, now: i64, frame: u64, is_unchanged: bool) -> Self {
        let used = low_bits(8 * u32::from(pdo.length));
        let content = PdoContent { payload: pdo.first_word() & used, length: pdo.length };
        Self { now, frame, content, is_unchanged }
    }
}

impl PdoSlot {
    #[cold]
    fn learn_period(&mut self) {
        let mut unchanged = [0; INTERVALS];
        let mut count = 0;
        for (place, interval) in self.measured.iter().enumerate() {
            if self.unchanged >> place & 1 == 1
                && let Some(next) = unchanged.get_mut(count)
            {
                *next = *interval;
                count += 1;
            }
        }
        if count > 0 {
            let measured = unchanged.get_mut(..count).filter(|measured| measured.len() >= UNCHANGED);
            let period = measured.and_then(unchanged_period);
            self.period = period.map(|time| ResendInterval { time, from: self.began });
        }
        // Often all of them precede unchanged content, and are sorted already.
        if count == INTERVALS {
            self.measured = unchanged;
        } else {
            self.measured.sort_unstable();
        }
        self.median = self.measured.get(INTERVALS / 2).copied();
        self.filled = 0;
        self.pause = PAUSE;
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
    pub fn frames_between(&self) -> FrameRange {
        FrameRange { first: self.frames.1, last: self.frames.0 }
    }
}

/// Sorts intervals before unchanged PDOs; longest usual one. A change can precede the timer of the device, so intervals
/// before changed content are not counted. `None` if fewer than three of five are near it; one of five may be a pause.
fn unchanged_period(measured: &mut [i64]) -> Option<i64> {
    measured.sort_unstable();
    let is_usual = |longest: &i64| {
        let near =
            measured.iter().filter(|interval| (longest / 4 * 3..=*longest).contains(*interval)).count();
        near >= UNCHANGED && near * 5 >= measured.len() * 3
    };
    measured.iter().rev().take(measured.len() / 5 + 1).find(|longest| is_usual(longest)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn pdo_at(now: i64, frame: u64, is_unchanged: bool) -> PdoFrame {
        PdoFrame { now, frame, content: PdoContent { payload: 0, length: 0 }, is_unchanged }
    }

    const fn around(syncs: u64, longest_period: i64) -> PdoSurroundings {
        PdoSurroundings { syncs, resumed: 1, longest_period }
    }

    #[test]
    fn two_contents_at_two_intervals_alternate() {
        let mut slot = PdoSlot::new(0, CanId::from_standard(0x181));
        // Contents 1 and 6 at intervals of 30 and 70; the first PDO is not compared.
        for number in 0..20_i64 {
            let now = number / 2 * 100 + number % 2 * 30;
            let payload = if number % 2 == 0 { 1 } else { 6 };
            let content = PdoContent { payload, length: 1 };
            slot.take_pdo(&PdoFrame { content, ..pdo_at(now, 1, false) }, around(0, 100));
        }
        // The contents of the second and the third PDO are new; the other 17 alternate.
        assert_eq!(slot.alternations, 17);
        let content = PdoContent { payload: 6, length: 1 };
        slot.take_pdo(&PdoFrame { content, ..pdo_at(1_000, 1, true) }, around(0, 100));
        assert_eq!(slot.alternations, 0);
    }

    #[test]
    fn intervals_counts_and_the_median() {
        let mut slot = PdoSlot::new(0, CanId::from_standard(0x181));
        for number in 0..16_u64 {
            let now = i64::try_from(number).unwrap() * 10 + i64::from(number == 7);
            slot.take_pdo(&pdo_at(now, number + 1, false), around(number / 4, 0));
        }
        assert_eq!((slot.count, slot.median, slot.since_sync), (16, Some(10), 4));
        assert_eq!((slot.interval(), slot.frames, slot.period_since(0)), (Some(10), (16, 15), None));
    }

    /// Period after 16 PDOs, each with its time and whether its content is unchanged.
    fn period_of(pdo: impl Fn(i64) -> (i64, bool)) -> Option<i64> {
        let mut slot = PdoSlot::new(0, CanId::from_standard(0x181));
        for number in 0..16 {
            let (time, is_unchanged) = pdo(number);
            slot.take_pdo(&pdo_at(time, number.unsigned_abs() + 1, is_unchanged), around(0, 0));
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
