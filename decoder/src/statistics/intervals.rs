//! Intervals between events of one kind: shortest, longest, mean.

/// Minimum number of intervals for a statement on silence.
const ENOUGH: u64 = 3;

/// Shortest, longest and mean interval, and the start of the longest one.
#[derive(Debug, Clone, Default)]
pub struct IntervalStatistics {
    last: Option<i64>,
    count: u64,
    sum: i64,
    shortest: i64,
    longest: i64,
    longest_began: i64,
}

impl IntervalStatistics {
    /// Adds an event at `time`, in ns. A time before the last one adds no interval.
    pub fn add_time(&mut self, time: i64) {
        if let Some(last) = self.last.replace(time)
            && time >= last
        {
            self.add_interval(time.saturating_sub(last), last);
        }
    }

    /// Adds an interval of `length` ns that started at `began`.
    fn add_interval(&mut self, length: i64, began: i64) {
        self.shortest = if self.count == 0 { length } else { self.shortest.min(length) };
        if self.count == 0 || length > self.longest {
            self.longest = length;
            self.longest_began = began;
        }
        self.count += 1;
        self.sum = self.sum.saturating_add(length);
    }

    /// Starts a new series: the time until the next event is not counted.
    pub fn interrupt_series(&mut self) {
        self.last = None;
    }

    /// Time of the first event, calculated from the last one and the sum of intervals.
    pub fn first_time(&self) -> Option<i64> {
        Some(self.last?.saturating_sub(self.sum))
    }

    /// Number of intervals.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Length of the shortest interval, in ns.
    pub fn shortest(&self) -> Option<i64> {
        (self.count > 0).then_some(self.shortest)
    }

    /// Length and start of the longest interval, in ns.
    pub fn longest(&self) -> Option<(i64, i64)> {
        (self.count > 0).then_some((self.longest, self.longest_began))
    }

    /// Largest deviation of an interval from the mean, in ns.
    pub fn jitter(&self) -> Option<i64> {
        let mean = self.mean()?;
        Some(self.longest.saturating_sub(mean).max(mean.saturating_sub(self.shortest)))
    }

    /// Start of a silence: the time of the last event, if the events were regular (longest interval at most
    /// three times the mean) and the time until `end` is more than twice the longest interval.
    pub fn silent_since(&self, end: Option<i64>) -> Option<i64> {
        let last = self.last?;
        let silence = end?.saturating_sub(last);
        (self.count >= ENOUGH && self.is_regular() && silence > self.longest.saturating_mul(2))
            .then_some(last)
    }

    /// Whether the longest interval is at most three times the mean.
    pub fn is_regular(&self) -> bool {
        self.mean().is_some_and(|mean| self.longest <= mean.saturating_mul(3))
    }

    /// Mean interval in ns.
    pub fn mean(&self) -> Option<i64> {
        let count = i64::try_from(self.count).ok()?;
        self.sum.checked_div(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shortest_longest_and_where_it_began() {
        let mut intervals = IntervalStatistics::default();
        for time in [0, 10, 30, 35, 20, 25] {
            intervals.add_time(time);
        }
        // Intervals 10, 20, 5; none for the step back; 5.
        assert_eq!(
            (intervals.count(), intervals.shortest(), intervals.longest()),
            (4, Some(5), Some((20, 10)))
        );
        assert_eq!(intervals.mean(), Some(10));
    }

    #[test]
    fn silence_requires_regular_events() {
        let of = |times: &[i64]| {
            let mut intervals = IntervalStatistics::default();
            for time in times {
                intervals.add_time(*time);
            }
            intervals
        };
        let regular = of(&[0, 100, 190, 300, 400]);
        assert_eq!((regular.silent_since(Some(620)), regular.silent_since(Some(621))), (None, Some(400)));
        assert_eq!(regular.jitter(), Some(10));
        assert_eq!(of(&[0, 1, 2, 3, 4, 5, 100]).silent_since(Some(10_000)), None);
        assert_eq!(of(&[0, 100, 200]).silent_since(Some(10_000)), None);
    }
}
