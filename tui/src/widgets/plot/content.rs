//! The content of a plot: series, window and cursors.

use std::borrow::Cow;

use super::scale::{seconds, time_decimals};
use super::trace;
use super::window::Window;
use crate::bucket::Bucket;
use crate::theme::{Role, Theme};

/// A signal to be drawn.
#[derive(Clone, Debug)]
pub struct Series<'a> {
    /// Its name.
    pub name: Cow<'a, str>,
    /// Its unit; empty where it has none.
    pub unit: Cow<'a, str>,
    /// How it looks.
    pub role: Role,
    /// Its values in the order of time.
    pub points: &'a [Bucket],
}

/// Series to be drawn over time.
#[derive(Clone, Copy, Debug)]
pub struct Plot<'a> {
    pub(super) theme: &'a Theme,
    pub(super) series: &'a [Series<'a>],
    pub(super) window: Window,
    pub(super) zero: i64,
    pub(super) cursors: (Option<i64>, Option<i64>),
    pub(super) empty: &'a str,
}

impl<'a> Plot<'a> {
    /// A plot from one time to another in nanoseconds, both in view.
    pub fn new(theme: &'a Theme, series: &'a [Series<'a>], from: i64, to: i64) -> Self {
        let window = Window { from, to: to.max(from), gap: None, until: i64::MAX };
        Self { theme, series, window, zero: 0, cursors: (None, None), empty: "" }
    }

    /// The time that is 0 s.
    #[must_use]
    pub fn zero(self, zero: i64) -> Self {
        Self { zero, ..self }
    }

    /// The times of the cursors A and B.
    #[must_use]
    pub fn cursors(self, a: Option<i64>, b: Option<i64>) -> Self {
        Self { cursors: (a, b), ..self }
    }

    /// For how many nanoseconds a value holds at most.
    #[must_use]
    pub fn gap(self, gap: Option<i64>) -> Self {
        Self { window: Window { gap, ..self.window }, ..self }
    }

    /// The end of what was recorded; until then the last value holds.
    #[must_use]
    pub fn until(self, until: i64) -> Self {
        Self { window: Window { until, ..self.window }, ..self }
    }

    /// What to say where there is nothing to draw.
    #[must_use]
    pub fn empty(self, text: &'a str) -> Self {
        Self { empty: text, ..self }
    }

    /// The number of a series' unit among the units.
    pub(super) fn axis(&self, series: usize) -> usize {
        let mut units: Vec<&str> = Vec::new();
        for unit in self.series.iter().take(series + 1).map(|series| series.unit.as_ref()) {
            if !units.contains(&unit) {
                units.push(unit);
            }
        }
        let unit = self.series.get(series).map(|series| series.unit.as_ref());
        units.iter().position(|known| Some(*known) == unit).unwrap_or(0)
    }

    /// The lowest and highest value of a series that the window shows.
    pub(super) fn range(&self, series: usize) -> Option<(f64, f64)> {
        let points = self.series.get(series)?.points;
        let inside = trace::extremes(points, &self.window);
        let shown = trace::in_window(points, &self.window);
        let start =
            shown.iter().find(|bucket| bucket.t >= self.window.from).map_or(self.window.end(), |next| next.t);
        // A value that came before and still holds is seen too.
        let held = shown
            .first()
            .filter(|bucket| {
                bucket.t < self.window.from
                    && start >= self.window.from
                    && !self.window.is_gap(bucket.t, start)
            })
            .map(|bucket| bucket.last)
            .filter(|value| value.is_finite());
        match (inside, held) {
            (Some((low, high)), Some(held)) => Some((low.min(held), high.max(held))),
            (inside, held) => inside.or(held.map(|held| (held, held))),
        }
    }

    /// The range of all series of an axis.
    pub(super) fn axis_range(&self, axis: usize) -> Option<(f64, f64)> {
        let of_axis = (0..self.series.len()).filter(|series| self.axis(*series) == axis);
        of_axis
            .filter_map(|series| self.range(series))
            .reduce(|(low, high), (other_low, other_high)| (low.min(other_low), high.max(other_high)))
    }

    /// A time in seconds, as exactly as the window shows it.
    pub(super) fn time_text(&self, time: i64) -> String {
        seconds(time, time_decimals(self.window.span() / 200).min(6))
    }
}
