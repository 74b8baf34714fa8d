//! Axis numbers: steps of 1, 2 and 5 with the necessary decimals.

use crate::widgets::draw;

/// Nanoseconds per second.
const SECOND: u64 = 1_000_000_000;
/// Significant digits of a value.
const DIGITS: i32 = 5;
/// Maximum number of ticks.
const MOST_TICKS: u32 = 64;

/// A value range with ticks at round numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueScale {
    /// Value at the bottom.
    pub low: f64,
    /// Value at the top.
    pub high: f64,
    step: f64,
}

impl ValueScale {
    /// A scale for `low` to `high` with ticks at its ends and about `ticks` steps between them.
    pub fn round_range(low: f64, high: f64, ticks: u16) -> Self {
        let (low, high) = widen_range(low, high);
        let step = round_step((high / 2.0 - low / 2.0) * 2.0 / f64::from(ticks.max(1)));
        Self { low: (low / step).floor() * step, high: (high / step).ceil() * step, step }
    }

    /// Row of a value; row 0 is the lowest. Values beyond the ends are at the end.
    pub fn value_row(&self, value: f64, rows: u32) -> u32 {
        // Halves, because the difference of two finite numbers may overflow.
        let share = (value / 2.0 - self.low / 2.0) / (self.high / 2.0 - self.low / 2.0);
        draw::nearest_step(share, rows.saturating_sub(1))
    }

    /// Values of the ticks.
    pub fn tick_values(&self) -> impl Iterator<Item = f64> + use<> {
        let Self { low, high, step } = *self;
        (0..MOST_TICKS)
            .map(move |tick| low + f64::from(tick) * step)
            .take_while(move |tick| *tick < high + step / 2.0)
    }

    /// Label of a tick.
    pub fn tick_label(&self, tick: f64) -> String {
        // A rounding error of a tick at 0.
        let tick = if tick.abs() < self.step / 1e6 { 0.0 } else { tick };
        format_number(tick, decimals_for(&[self.step, self.low]))
    }
}

/// The range, widened if it is empty.
fn widen_range(low: f64, high: f64) -> (f64, f64) {
    let (low, high) = (low.clamp(-1e300, 1e300), high.clamp(-1e300, 1e300));
    if high - low > low.abs().max(high.abs()) * 1e-12 {
        return (low, high);
    }
    let by = if low == 0.0 { 1.0 } else { low.abs() / 10.0 };
    (low - by, high + by)
}

/// The smallest of 1, 2 and 5 times a power of ten that is at least `least`.
fn round_step(least: f64) -> f64 {
    let ten = 10_f64.powf(least.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0].map(|step| step * ten);
    steps.into_iter().find(|step| *step >= least * (1.0 - 1e-9)).unwrap_or(ten * 10.0)
}

/// Number of decimals that shows the values with five digits, without trailing zeros.
pub fn decimals_for(values: &[f64]) -> usize {
    let largest =
        values.iter().copied().filter(|value| value.is_finite()).fold(0.0, |a: f64, b| a.max(b.abs()));
    let mut power = 1.0;
    let mut most = 0;
    // While another decimal adds a significant digit.
    while most < 9 && largest * power < 10_f64.powi(DIGITS - 1) && largest > 0.0 {
        power *= 10.0;
        most += 1;
    }
    let resolution = 0.5 / power;
    let is_enough = |decimals: &usize| {
        let power = 10_f64.powi(i32::try_from(*decimals).unwrap_or(0));
        let is_exact =
            |value: &f64| !value.is_finite() || ((value * power).round() / power - value).abs() < resolution;
        values.iter().all(is_exact)
    };
    (0..most).find(is_enough).unwrap_or(most)
}

/// Text of a value; very large and very small ones have an exponent.
pub fn format_number(value: f64, decimals: usize) -> String {
    let size = value.abs();
    if value.is_nan() {
        "–".to_owned()
    } else if value.is_infinite() {
        if value > 0.0 { "+inf" } else { "-inf" }.to_owned()
    } else if size >= 1e12 || (size > 0.0 && size < 1e-6) {
        format!("{value:.3e}")
    } else {
        let text = format!("{value:.decimals$}");
        // No "-0.0".
        let is_zero = text.starts_with('-') && text.bytes().all(|byte| matches!(byte, b'-' | b'0' | b'.'));
        if is_zero { text.trim_start_matches('-').to_owned() } else { text }
    }
}

/// The smallest of 1, 2 and 5 times a power of ten nanoseconds that is at least `least`.
pub fn time_step(least: u64) -> u64 {
    let mut ten = 1_u64;
    loop {
        for step in [1, 2, 5].map(|step| ten.saturating_mul(step)) {
            if step >= least {
                return step;
            }
        }
        let Some(next) = ten.checked_mul(10) else { return u64::MAX };
        ten = next;
    }
}

/// Number of decimals that distinguishes times `step` ns apart.
pub fn time_decimals(step: u64) -> u32 {
    let mut decimals = 0;
    let mut unit = SECOND;
    while unit > step.max(1) {
        unit /= 10;
        decimals += 1;
    }
    decimals
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64, ticks: u16) -> Vec<String> {
        let scale = ValueScale::round_range(low, high, ticks);
        scale.tick_values().map(|tick| scale.tick_label(tick)).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(labels(0.0, 100.0, 5), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(labels(-0.13, 0.29, 4), ["-0.2", "0.0", "0.2", "0.4"]);
        assert_eq!(labels(124.2, 131.0, 3), ["120", "125", "130", "135"]);
        assert_eq!(labels(0.0, 0.000_3, 3), ["0.0000", "0.0001", "0.0002", "0.0003"]);
        assert_eq!(labels(0.0, 2.5e15, 2), ["0", "2.000e15", "4.000e15"]);
    }

    #[test]
    fn a_range_of_one_value_has_room_around_it() {
        assert_eq!(labels(0.0, 0.0, 2), ["-1", "0", "1"]);
        assert_eq!(labels(50.0, 50.0, 2), ["45", "50", "55"]);
        assert_eq!(labels(-5.0, -5.0, 2), ["-5.5", "-5.0", "-4.5"]);
    }

    #[test]
    fn no_number_is_too_much() {
        for (low, high) in [
            (f64::MIN, f64::MAX),
            (f64::NEG_INFINITY, f64::INFINITY),
            (f64::MIN_POSITIVE, f64::MIN_POSITIVE * 3.0),
            (1e16, 1e16 + 2.0),
            (f64::NAN, f64::NAN),
            (5e-324, 5e-324),
        ] {
            let scale = ValueScale::round_range(low, high, 4);
            let _ = (
                scale.tick_values().map(|tick| scale.tick_label(tick)).collect::<Vec<_>>(),
                scale.value_row(0.0, 10),
            );
            let _ = ValueScale::round_range(low, high, 1).value_row(low, 10);
        }
    }

    #[test]
    fn values_beyond_the_ends_are_at_the_ends() {
        let scale = ValueScale::round_range(0.0, 10.0, 1);
        let rows = [-1.0, 0.0, 5.0, 10.0, 99.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN];
        assert_eq!(rows.map(|value| scale.value_row(value, 11)), [0, 0, 5, 10, 10, 10, 0, 0]);
        assert_eq!(scale.value_row(5.0, 0), 0);
    }

    #[test]
    fn decimals_are_those_that_say_something() {
        assert_eq!(decimals_for(&[124.0, 130.5]), 1);
        assert_eq!(decimals_for(&[124.0, 130.0]), 0);
        assert_eq!(decimals_for(&[1.0 / 3.0]), 5);
        assert_eq!(decimals_for(&[37.449_999_9, 100.0]), 2);
        assert_eq!(decimals_for(&[184_022.125]), 0);
        assert_eq!(decimals_for(&[0.001_25]), 5);
        assert_eq!(decimals_for(&[0.0]), 0);
        assert_eq!(decimals_for(&[]), 0);
        assert_eq!(decimals_for(&[f64::NAN, f64::INFINITY, 0.5]), 1);
        let written = [(-0.01, 1), (f64::NEG_INFINITY, 2), (1e20, 0), (-2.5, 1)];
        assert_eq!(
            written.map(|(value, decimals)| format_number(value, decimals)),
            ["0.0", "-inf", "1.000e20", "-2.5"]
        );
    }

    #[test]
    fn times() {
        assert_eq!([1, 3, 20, 21, 700_000_000].map(time_step), [1, 5, 20, 50, 1_000_000_000]);
        assert_eq!(time_step(u64::MAX), u64::MAX);
        assert_eq!(
            [1, 10, 1_000_000, 500_000_000, SECOND, 5 * SECOND].map(time_decimals),
            [9, 8, 3, 1, 0, 0]
        );
    }
}
