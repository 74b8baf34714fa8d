//! Times between events of one kind: shortest, longest, mean.

/// Intervals after which a longer silence than ever says that something stopped.
const ENOUGH: u64 = 3;

/// Shortest, longest and mean of intervals, and where the longest began.
#[derive(Debug, Clone, Default)]
pub struct Intervals {
    last: Option<i64>,
    count: u64,
    sum: i64,
    shortest: i64,
    longest: i64,
    longest_began: i64,
}

impl Intervals {
    /// Something happened at `time` (nanoseconds). Time that does not go on makes no interval.
    pub fn add(&mut self, time: i64) {
        if let Some(last) = self.last.replace(time)
            && time >= last
        {
            self.add_interval(time.saturating_sub(last), last);
        }
    }

    /// An interval of `length` nanoseconds that began at `began`.
    fn add_interval(&mut self, length: i64, began: i64) {
        self.shortest = if self.count == 0 { length } else { self.shortest.min(length) };
        if self.count == 0 || length > self.longest {
            self.longest = length;
            self.longest_began = began;
        }
        self.count += 1;
        self.sum = self.sum.saturating_add(length);
    }

    /// The next event begins a new series: the time until it is no interval.
    pub fn interrupt(&mut self) {
        self.last = None;
    }

    /// When the first event was, as far as time went on since.
    pub fn began(&self) -> Option<i64> {
        Some(self.last?.saturating_sub(self.sum))
    }

    /// Number of intervals.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Nanoseconds of the shortest.
    pub fn shortest(&self) -> Option<i64> {
        (self.count > 0).then_some(self.shortest)
    }

    /// Nanoseconds of the longest, and when it began.
    pub fn longest(&self) -> Option<(i64, i64)> {
        (self.count > 0).then_some((self.longest, self.longest_began))
    }

    /// Largest distance of an interval from the mean, in nanoseconds.
    pub fn jitter(&self) -> Option<i64> {
        let mean = self.mean()?;
        Some(self.longest.saturating_sub(mean).max(mean.saturating_sub(self.shortest)))
    }

    /// Since when something regular is missing: not seen until `end` for more than twice its longest
    /// interval, which is not above three times the mean.
    pub fn silent_since(&self, end: Option<i64>) -> Option<i64> {
        let (last, mean) = (self.last?, self.mean()?);
        let is_regular = self.count >= ENOUGH && self.longest <= mean.saturating_mul(3);
        let silence = end?.saturating_sub(last);
        (is_regular && silence > self.longest.saturating_mul(2)).then_some(last)
    }

    /// Mean in nanoseconds.
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
        let mut intervals = Intervals::default();
        for time in [0, 10, 30, 35, 20, 25] {
            intervals.add(time);
        }
        // 10, 20, 5; the step back makes none; 5.
        assert_eq!(
            (intervals.count(), intervals.shortest(), intervals.longest()),
            (4, Some(5), Some((20, 10)))
        );
        assert_eq!(intervals.mean(), Some(10));
    }

    #[test]
    fn what_stopped_is_silent_only_if_it_was_regular() {
        let of = |times: &[i64]| {
            let mut intervals = Intervals::default();
            for time in times {
                intervals.add(*time);
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
