//! Regularity of a periodic message: single elements that are missing while its phase is unchanged.

/// Usual intervals in a row before a gap; fewer do not show a period.
const STEADY: u8 = 6;

/// Usual intervals after which a longer one is a silence.
const KNOWN: u32 = 2;

/// Most intervals in a gap with single missing elements; a longer gap is a silence of the producer.
const LONGEST_GAP: u32 = 3;

/// What an unusual interval shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Irregularity {
    /// Single missing elements, or nothing that is known yet.
    Single,
    /// The interval is usual from now on; the one before, in ns.
    Period { from: i64 },
    /// Together with the interval before it is a usual one: an element of another sender is between.
    Split,
}

/// Regularity of the intervals of one identifier. Small, as there is one per identifier: intervals are in units of 1,024 ns,
/// at most 73 minutes.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct StreamRegularity {
    /// Shortest usual interval, and number of usual ones from there on: one comparison per frame. 0 before the first frame.
    least: u32,
    width: u32,
    /// The last interval that differed from the usual one.
    other: u32,
    /// Number of usual intervals.
    regular: u32,
    /// Time of the last gap, also of a pending one, in units of 1.05 ms.
    gap_time: u32,
    gaps: u16,
    missing: u16,
    silences: u16,
    /// Elements missing in the last interval, until the next interval shows that the phase is unchanged.
    pending: u8,
    /// Usual intervals since the last other one, at most 255.
    streak: u8,
}

impl StreamRegularity {
    /// Before the first interval.
    pub(in crate::session) const NEW: Self = Self {
        least: 0,
        width: 0,
        other: 0,
        regular: 0,
        gap_time: 0,
        gaps: 0,
        missing: 0,
        silences: 0,
        pending: 0,
        streak: 0,
    };

    /// Registers usual intervals in a row.
    pub(super) fn note_usual(&mut self, count: u32) {
        self.regular = self.regular.saturating_add(count);
        self.streak = self.streak.saturating_add(u8::try_from(count).unwrap_or(u8::MAX));
    }

    /// Starts with the first frame.
    pub(super) fn begin(&mut self) {
        self.width = self.width.max(1);
    }

    /// Whether an interval in ns is usual; `false` for some that are longer than the longest unit.
    #[inline]
    pub(super) fn is_usual(&self, interval: i64) -> bool {
        (interval >> 10).cast_unsigned().wrapping_sub(u64::from(self.least)) < u64::from(self.width)
    }

    /// As [`Self::is_usual`], for all intervals.
    pub(super) fn is_usual_in_units(&self, interval: i64) -> bool {
        let usual = self.usual();
        to_units(interval).abs_diff(usual) <= usual >> 3
    }

    /// Usual interval; 0 before it is known.
    fn usual(&self) -> u32 {
        self.least + (self.width.saturating_sub(1) >> 1)
    }

    fn set_usual(&mut self, usual: u32) {
        let margin = usual >> 3;
        (self.least, self.width) = (usual - margin, 2 * margin + 1);
    }

    /// Registers an unusual interval in ns that ends at the monotonic time `now`.
    pub(super) fn note_other(&mut self, interval: i64, now: i64) -> Irregularity {
        let (interval, usual, before) = (to_units(interval), self.usual(), (self.other, self.streak));
        self.count_other(interval, now);
        let is_second_part = before.1 == 0
            && self.regular > KNOWN
            && interval.max(before.0) < usual - usual / 8
            && interval.saturating_add(before.0).abs_diff(usual) <= usual >> 3;
        match () {
            () if self.usual() != usual && usual > 0 => Irregularity::Period { from: i64::from(usual) << 10 },
            () if is_second_part => Irregularity::Split,
            () => Irregularity::Single,
        }
    }

    /// Whether two elements or more of a message with a known period are missing in an interval in ns.
    pub(super) fn is_silence(&self, interval: i64) -> bool {
        let usual = self.usual_interval();
        self.regular >= KNOWN && interval > usual.saturating_mul(2).saturating_add(usual / 2)
    }

    fn count_other(&mut self, interval: u32, now: i64) {
        if self.pending > 0 {
            let settled = self.settled();
            (self.gaps, self.missing, self.pending) = (settled.gaps, settled.missing, 0);
        }
        let is_steady = std::mem::take(&mut self.streak) >= STEADY;
        let is_gap = is_steady && self.count_gap(interval, now);
        if !is_gap && self.other > 0 && interval.abs_diff(self.other) <= self.other >> 3 {
            self.set_usual(interval);
        }
        self.other = interval;
    }

    /// Counts an interval after usual ones as a gap or a silence; `false` if it is neither.
    fn count_gap(&mut self, interval: u32, now: i64) -> bool {
        let usual = self.usual();
        let half = usual / 2;
        let intervals = interval.saturating_add(half).checked_div(usual).unwrap_or(0);
        let is_in_phase = interval.abs_diff(intervals.saturating_mul(usual)) <= half / 2;
        let is_gap = (2..=LONGEST_GAP).contains(&intervals) && is_in_phase;
        if is_gap {
            self.pending = u8::try_from(intervals - 1).unwrap_or(0);
            self.gap_time = u32::try_from(now >> 20 & i64::from(u32::MAX)).unwrap_or(0);
        } else if intervals > LONGEST_GAP {
            self.silences = self.silences.saturating_add(1);
        }
        is_gap || intervals > LONGEST_GAP
    }

    /// The present counts; a gap counts once a usual interval follows.
    fn settled(&self) -> Self {
        if self.pending == 0 || self.streak == 0 {
            return *self;
        }
        let missing = self.missing.saturating_add(u16::from(self.pending));
        Self { gaps: self.gaps.saturating_add(1), missing, pending: 0, ..*self }
    }

    /// Number of gaps of one or two elements with an unchanged phase.
    pub(crate) fn gap_count(&self) -> u16 {
        self.settled().gaps
    }

    /// Number of elements that are missing in these gaps.
    pub(crate) fn missing_count(&self) -> u16 {
        self.settled().missing
    }

    /// Time of the last gap in units of 1.05 ms; 0 before the first one.
    pub(crate) fn last_gap_time(&self) -> u32 {
        self.gap_time
    }

    /// Usual interval in ns; 0 before it is known.
    pub(crate) fn usual_interval(&self) -> i64 {
        i64::from(self.usual()) << 10
    }

    /// Number of usual intervals.
    pub(crate) fn regular_count(&self) -> u32 {
        self.regular
    }

    /// Number of longer gaps.
    pub(crate) fn silence_count(&self) -> u16 {
        self.silences
    }
}

fn to_units(interval: i64) -> u32 {
    u32::try_from(interval >> 10).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_intervals(intervals: &[i64]) -> StreamRegularity {
        let mut stream = StreamRegularity::NEW;
        let mut now = 0;
        for interval in intervals {
            now += *interval << 20;
            if stream.is_usual_in_units(*interval << 20) {
                stream.note_usual(1);
            } else {
                stream.note_other(*interval << 20, now);
            }
        }
        stream
    }

    fn counts(stream: &StreamRegularity) -> (u16, u16, u16) {
        (stream.gap_count(), stream.missing_count(), stream.silence_count())
    }

    #[test]
    fn an_interval_within_an_eighth_is_usual() {
        let of = |usual| {
            let mut stream = StreamRegularity::NEW;
            stream.set_usual(usual);
            assert_eq!(stream.usual(), usual);
            stream
        };
        let found = [699, 700, 800, 900, 901].map(|units: i64| of(800).is_usual(units << 10));
        assert_eq!(found, [false, true, true, true, false]);
        assert!(of(800).is_usual((901 << 10) - 1), "a part of a unit does not count");
        let longest = of(u32::MAX);
        for (interval, is_usual) in [(0, false), (i64::MAX, true), (i64::from(u32::MAX) << 10, true)] {
            assert_eq!(longest.is_usual_in_units(interval), is_usual);
        }
        let mut begun = StreamRegularity::NEW;
        assert!(!begun.is_usual(0), "the first frame has no interval");
        begun.begin();
        assert_eq!([-1, 0, 1_023, 1_024].map(|it| begun.is_usual(it)), [false, true, true, false]);
    }

    #[test]
    fn a_gap_counts_once_the_phase_is_unchanged() {
        let steady = [100, 101, 99, 100, 100, 102, 98, 100, 100];
        let lost = of_intervals(&[&steady[..], &[200]].concat());
        assert_eq!(counts(&lost), (0, 0, 0));
        let lost = of_intervals(&[&steady[..], &[200, 100], &steady, &[301, 99]].concat());
        assert_eq!(counts(&lost), (2, 3, 0));
    }

    #[test]
    fn other_phases_periods_and_silences_are_no_missing_elements() {
        let steady = [100; 9];
        assert_eq!(counts(&of_intervals(&[&steady[..], &[250, 100]].concat())), (0, 0, 0));
        assert_eq!(counts(&of_intervals(&[&steady[..], &[300; 9]].concat())), (0, 0, 0));
        assert_eq!(counts(&of_intervals(&[&steady[..], &[1_500, 100]].concat())), (0, 0, 1));
        assert_eq!(counts(&of_intervals(&[100, 100, 100, 200, 100])), (0, 0, 0));
    }
}
