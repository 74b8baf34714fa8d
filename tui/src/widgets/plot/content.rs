//! The content of a plot: series, window and cursors.

use std::borrow::Cow;

use super::scale::{seconds, time_decimals};
use super::trace;
use super::window::Window;
use crate::bucket::Bucket;
use crate::theme::{Role, Theme};

/// A plotted signal.
#[derive(Clone, Debug)]
pub struct Series<'a> {
    /// Name in the legend.
    pub name: Cow<'a, str>,
    /// Unit; empty without one.
    pub unit: Cow<'a, str>,
    /// Role that decides its colour.
    pub role: Role,
    /// Values in time order.
    pub points: &'a [Bucket],
}

/// A plot of series over time.
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
    /// A plot of the range from `from` to `to` in ns, inclusive.
    pub fn new(theme: &'a Theme, series: &'a [Series<'a>], from: i64, to: i64) -> Self {
        let window = Window { from, to: to.max(from), gap: None, until: i64::MAX };
        Self { theme, series, window, zero: 0, cursors: (None, None), empty: "" }
    }

    /// Sets the time shown as 0 s.
    #[must_use]
    pub fn zero(self, zero: i64) -> Self {
        Self { zero, ..self }
    }

    /// Sets the times of cursors A and B.
    #[must_use]
    pub fn cursors(self, a: Option<i64>, b: Option<i64>) -> Self {
        Self { cursors: (a, b), ..self }
    }

    /// Sets the maximum time in ns for which a value applies.
    #[must_use]
    pub fn gap(self, gap: Option<i64>) -> Self {
        Self { window: Window { gap, ..self.window }, ..self }
    }

    /// Sets the end of the capture; the last value applies until then.
    #[must_use]
    pub fn until(self, until: i64) -> Self {
        Self { window: Window { until, ..self.window }, ..self }
    }

    /// Sets the text of an empty plot.
    #[must_use]
    pub fn empty(self, text: &'a str) -> Self {
        Self { empty: text, ..self }
    }

    /// Index of the unit of a series.
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

    /// Lowest and highest visible value of a series.
    pub(super) fn range(&self, series: usize) -> Option<(f64, f64)> {
        let points = self.series.get(series)?.points;
        let inside = trace::extremes(points, &self.window);
        let shown = trace::in_window(points, &self.window);
        let start =
            shown.iter().find(|bucket| bucket.t >= self.window.from).map_or(self.window.end(), |next| next.t);
        // An earlier value that still applies is visible too.
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

    /// Range of all series of an axis.
    pub(super) fn axis_range(&self, axis: usize) -> Option<(f64, f64)> {
        let of_axis = (0..self.series.len()).filter(|series| self.axis(*series) == axis);
        of_axis
            .filter_map(|series| self.range(series))
            .reduce(|(low, high), (other_low, other_high)| (low.min(other_low), high.max(other_high)))
    }

    /// A time in seconds with the resolution of the window.
    pub(super) fn time_text(&self, time: i64) -> String {
        seconds(time, time_decimals(self.window.span() / 200).min(6))
    }
}
