//! Times between events of one kind: shortest, longest, mean, and the distribution.

/// Classes of the histogram for each doubling of the interval: 9 % wide each.
const CLASSES: usize = 8;

/// Doublings covered: up to 2^40 ns, 18 minutes.
const DOUBLINGS: usize = 41;

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

    /// Mean in nanoseconds.
    pub fn mean(&self) -> Option<i64> {
        let count = i64::try_from(self.count).ok()?;
        self.sum.checked_div(count)
    }
}

/// Durations by size, in classes of 9 %, without keeping them.
#[derive(Debug, Clone)]
pub struct Distribution {
    classes: Box<[u32]>,
    count: u64,
    longest: i64,
}

impl Default for Distribution {
    fn default() -> Self {
        Self { classes: vec![0; CLASSES * DOUBLINGS].into(), count: 0, longest: 0 }
    }
}

impl Distribution {
    /// Adds a duration in nanoseconds; negative ones count as 0.
    pub fn add(&mut self, duration: i64) {
        let duration = duration.max(0);
        if let Some(class) = self.classes.get_mut(class_of(duration)) {
            *class = class.saturating_add(1);
        }
        self.count += 1;
        self.longest = self.longest.max(duration);
    }

    /// The duration that `part` of 100 do not exceed, to 9 %; the longest itself for 100.
    pub fn percentile(&self, part: u64) -> Option<i64> {
        if self.count == 0 {
            return None;
        }
        let rank = (self.count * part.min(100)).div_ceil(100).max(1);
        let mut seen = 0;
        let class = self.classes.iter().position(|count| {
            seen += u64::from(*count);
            seen >= rank
        })?;
        Some(upper_end(class).min(self.longest))
    }

    /// Number of durations.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// The longest in nanoseconds.
    pub fn longest(&self) -> i64 {
        self.longest
    }
}

fn class_of(duration: i64) -> usize {
    let value = duration.max(1).unsigned_abs();
    let doubling = value.ilog2() as usize;
    // The three bits behind the highest one.
    let fine = if doubling >= 3 {
        (value >> (doubling - 3) & 7) as usize
    } else {
        (value << (3 - doubling) & 7) as usize
    };
    (doubling * CLASSES + fine).min(CLASSES * DOUBLINGS - 1)
}

fn upper_end(class: usize) -> i64 {
    let (doubling, fine) = (class / CLASSES, class % CLASSES);
    let start = 1_i64.checked_shl(u32::try_from(doubling).unwrap_or(0)).unwrap_or(i64::MAX);
    let steps = i64::try_from(fine + 1).unwrap_or(8);
    start.saturating_add(start.saturating_mul(steps) / 8)
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
    fn percentiles_are_right_to_a_class() {
        let mut distribution = Distribution::default();
        for milliseconds in 1..=100 {
            distribution.add(milliseconds * 1_000_000);
        }
        for part in [50_u32, 90, 99] {
            let exact = i64::from(part) * 1_000_000;
            let found = distribution.percentile(part.into()).unwrap();
            assert!(found >= exact && found <= exact + exact / 8, "{part}: {found}");
        }
        assert_eq!(distribution.percentile(100), Some(100_000_000));
        assert_eq!(Distribution::default().percentile(50), None);
    }

    #[test]
    fn extremes_do_not_leave_the_table() {
        let mut distribution = Distribution::default();
        for duration in [i64::MIN, -1, 0, 1, 2, 7, 8, i64::MAX] {
            distribution.add(duration);
        }
        assert_eq!(distribution.count(), 8);
        assert_eq!(
            distribution.percentile(100),
            Some(i64::MAX).map(|longest| upper_end(CLASSES * DOUBLINGS - 1).min(longest))
        );
    }
}
