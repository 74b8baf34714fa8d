//! Percentiles of durations in bounded memory.

/// Maximum number of exact values; beyond it, values are counted in classes.
const EXACT: usize = 1_024;

/// Classes per octave; the error of a percentile is at most 1/64.
const STEPS: u32 = 32;

/// Number of classes for 0..=`i64::MAX`.
const CLASSES: usize = 59 * STEPS as usize;

/// Distribution of durations in ns.
#[derive(Debug, Clone, Default)]
pub struct DurationDistribution {
    count: u64,
    min: i64,
    max: i64,
    exact: Vec<i64>,
    classes: Vec<u64>,
}

impl DurationDistribution {
    /// Adds a duration; a negative one counts as 0.
    #[inline]
    pub fn add_duration(&mut self, value: i64) {
        let value = value.max(0);
        self.min = if self.count == 0 { value } else { self.min.min(value) };
        self.max = self.max.max(value);
        self.count += 1;
        if self.classes.is_empty() {
            self.add_exact(value);
        } else {
            duration_count(&mut self.classes, value);
        }
    }

    /// Keeps a value, or counts all values in classes from the next one on.
    #[inline(never)]
    fn add_exact(&mut self, value: i64) {
        if self.exact.len() < EXACT {
            return self.exact.push(value);
        }
        self.classes = vec![0; CLASSES];
        for value in std::mem::take(&mut self.exact) {
            duration_count(&mut self.classes, value);
        }
        duration_count(&mut self.classes, value);
    }

    /// Number of durations.
    pub fn duration_count(&self) -> u64 {
        self.count
    }

    /// Longest duration in ns; 0 if empty.
    pub fn longest(&self) -> i64 {
        self.max
    }

    /// Smallest value that `percent` of all values do not exceed; `None` if empty.
    pub fn percentile(&self, percent: u64) -> Option<i64> {
        if self.count == 0 {
            return None;
        }
        let rank = (u128::from(self.count) * u128::from(percent.min(100))).div_ceil(100).max(1);
        if rank >= u128::from(self.count) {
            return Some(self.max);
        }
        if self.classes.is_empty() {
            let place =
                usize::try_from(rank).ok()?.checked_sub(1).filter(|place| *place < self.exact.len())?;
            let mut values = self.exact.clone();
            return Some(*values.select_nth_unstable(place).1);
        }
        let mut seen = 0_u128;
        let class = self.classes.iter().position(|count| {
            seen += u128::from(*count);
            seen >= rank
        })?;
        Some(class_middle(class).clamp(self.min, self.max))
    }
}

fn duration_count(classes: &mut [u64], value: i64) {
    if let Some(class) = classes.get_mut(class_of(value.unsigned_abs())) {
        *class += 1;
    }
}

/// Class of a value: one class per value below 32, then 32 classes per octave.
fn class_of(value: u64) -> usize {
    let octave = value.max(1).ilog2();
    if octave < 5 {
        return usize::try_from(value).unwrap_or(0);
    }
    let step = (value >> (octave - 5)) & 31;
    usize::try_from(u64::from((octave - 4) * STEPS) + step).unwrap_or(CLASSES - 1)
}

fn class_middle(class: usize) -> i64 {
    let class = i64::try_from(class).unwrap_or(0);
    let (octave, step) = (class / 32, class % 32);
    if octave == 0 {
        return step;
    }
    let width = 1_i64 << (octave - 1);
    (32 + step).saturating_mul(width).saturating_add(width / 2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_values_are_exact() {
        let mut distribution = DurationDistribution::default();
        assert_eq!(distribution.percentile(50), None);
        for value in (1..=10).rev() {
            distribution.add_duration(value);
        }
        let percentiles = [0, 50, 90, 99, 100].map(|percent| distribution.percentile(percent).unwrap());
        assert_eq!(percentiles, [1, 5, 9, 10, 10]);
    }

    #[test]
    fn many_values_are_close_and_bounded() {
        let mut distribution = DurationDistribution::default();
        for value in 1..=100_000 {
            distribution.add_duration(value * 1_000);
        }
        let median = distribution.percentile(50).unwrap();
        assert!((median - 50_000_000).abs() < 50_000_000 / 64, "{median}");
        assert_eq!(
            (distribution.percentile(100), distribution.duration_count()),
            (Some(100_000_000), 100_000)
        );
        assert!(distribution.exact.is_empty());
    }

    #[test]
    fn every_duration_has_a_class() {
        for value in [0, 1, 31, 32, 33, 63, 64, 1_000_000, i64::MAX] {
            let middle = class_middle(class_of(value.unsigned_abs()));
            assert!(class_of(value.unsigned_abs()) < CLASSES);
            assert!((middle - value).abs() <= value / 64 + 1, "{value} {middle}");
        }
    }
}
