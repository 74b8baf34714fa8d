//! Times of day without a date.

/// One day in nanoseconds.
const DAY: i64 = 86_400 * 1_000_000_000;

/// Number of times after a large step within which a return to the time before it takes the step back.
const MEMORY: u8 = 64;

/// Continues times of day after midnight.
#[derive(Debug, Clone, Default)]
pub(in crate::capture) struct TimesOfDay {
    last: Option<i64>,
    /// Time of the midnights passed so far, in nanoseconds.
    passed: i64,
    before: Option<BeforeStep>,
}

/// State before a step of more than half a day.
#[derive(Debug, Clone, Copy)]
struct BeforeStep {
    time: i64,
    passed: i64,
    /// Number of times since the step.
    age: u8,
}

impl TimesOfDay {
    /// Time since the midnight before the first frame. A step back of more than half a day is a midnight; a
    /// smaller one is a disorder of the recorder. A single wrong time, or a frame recorded late after
    /// midnight, has no effect on later times.
    pub(in crate::capture) fn elapsed_since_midnight(&mut self, time: i64) -> i64 {
        let last = self.last.replace(time).unwrap_or(time);
        let step = time.saturating_sub(last);
        self.before = self.before.filter(|before| before.age < MEMORY);
        if step.saturating_abs() > DAY / 2 && (0..DAY).contains(&last) {
            let next = match self.before {
                Some(before) if (0..DAY / 2).contains(&time.saturating_sub(before.time)) => before.passed,
                _ if step < 0 => self.passed.saturating_add(DAY),
                _ => self.passed,
            };
            self.before = Some(BeforeStep { time: last, passed: self.passed, age: 0 });
            self.passed = next;
        } else if let Some(before) = &mut self.before {
            before.age += 1;
        }
        self.passed.saturating_add(time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUR: i64 = DAY / 24;

    fn elapsed_since_midnight<const N: usize>(times: [i64; N]) -> [i64; N] {
        let mut clock = TimesOfDay::default();
        times.map(|time| clock.elapsed_since_midnight(time))
    }

    #[test]
    fn a_step_back_of_more_than_half_a_day_is_a_midnight() {
        let found = elapsed_since_midnight([23, 22, 0, 1, 8, 16, 20, 1].map(|hour| hour * HOUR))
            .map(|time| time / HOUR);
        assert_eq!(found, [23, 22, 24, 25, 32, 40, 44, 49]);
    }

    #[test]
    fn a_late_frame_and_a_wrong_time_do_not_move_later_times() {
        assert_eq!(
            elapsed_since_midnight([DAY - 3, 1, 2, DAY - 2, 3]),
            [DAY - 3, DAY + 1, DAY + 2, DAY - 2, DAY + 3]
        );
        assert_eq!(elapsed_since_midnight([HOUR, 23 * HOUR, HOUR + 1]), [HOUR, 23 * HOUR, HOUR + 1]);
        let [.., last] = elapsed_since_midnight([23 * HOUR, 0, 23 * HOUR + 1]);
        assert_eq!(last, 23 * HOUR + 1);
    }

    #[test]
    fn times_that_are_not_of_a_day_have_no_midnights() {
        assert_eq!(elapsed_since_midnight([90 * HOUR, 2 * HOUR]), [90 * HOUR, 2 * HOUR]);
        assert_eq!(elapsed_since_midnight([0, i64::MIN]), [0, i64::MIN + DAY]);
    }
}
