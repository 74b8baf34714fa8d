//! The content of a plot: series, window and cursors.

use std::borrow::Cow;

use cobscope_decoder::figures::seconds_to;

use super::scale::time_decimals;
use super::trace;
use super::window::TimeWindow;
use crate::bucket::SampleBucket;
use crate::theme::{TextRole, Theme};

/// Name of the row of marks.
pub(super) const MARKS_LABEL: &str = "find";

/// A mark over a range of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeMark {
    /// Begin in ns.
    pub from: i64,
    /// End in ns, inclusive; equal to the begin for a single moment.
    pub to: i64,
    /// One character.
    pub symbol: &'static str,
    /// Role that decides its colour.
    pub role: TextRole,
}

/// A plotted signal.
#[derive(Clone, Debug)]
pub struct PlotSeries<'a> {
    /// Name in the legend.
    pub name: Cow<'a, str>,
    /// Unit; empty without one.
    pub unit: Cow<'a, str>,
    /// Role that decides its colour.
    pub role: TextRole,
    /// Values in time order.
    pub points: &'a [SampleBucket],
}

/// A plot of series over time.
#[derive(Clone, Copy, Debug)]
pub struct TimePlot<'a> {
    pub(super) theme: &'a Theme,
    pub(super) series: &'a [PlotSeries<'a>],
    pub(super) window: TimeWindow,
    pub(super) zero: i64,
    pub(super) cursors: (Option<i64>, Option<i64>),
    pub(super) marks: Option<&'a [TimeMark]>,
    pub(super) empty: &'a str,
}

impl<'a> TimePlot<'a> {
    /// A plot of the range from `from` to `to` in ns, inclusive.
    pub fn new(theme: &'a Theme, series: &'a [PlotSeries<'a>], from: i64, to: i64) -> Self {
        let window = TimeWindow { from, to: to.max(from), gap: None, until: i64::MAX };
        Self { theme, series, window, zero: 0, cursors: (None, None), marks: None, empty: "" }
    }

    /// Sets the time shown as 0 s.
    #[must_use]
    pub fn with_zero(self, zero: i64) -> Self {
        Self { zero, ..self }
    }

    /// Sets the times of cursors A and B.
    #[must_use]
    pub fn with_cursors(self, a: Option<i64>, b: Option<i64>) -> Self {
        Self { cursors: (a, b), ..self }
    }

    /// Sets the marks in the row above the plot; later ones cover earlier ones.
    #[must_use]
    pub fn with_marks(self, marks: &'a [TimeMark]) -> Self {
        Self { marks: Some(marks), ..self }
    }

    /// Sets the maximum time in ns for which a value applies.
    #[must_use]
    pub fn with_gap(self, gap: Option<i64>) -> Self {
        Self { window: TimeWindow { gap, ..self.window }, ..self }
    }

    /// Sets the end of the capture; the last value applies until then.
    #[must_use]
    pub fn with_end(self, until: i64) -> Self {
        Self { window: TimeWindow { until, ..self.window }, ..self }
    }

    /// Sets the text of an empty plot.
    #[must_use]
    pub fn with_empty_text(self, text: &'a str) -> Self {
        Self { empty: text, ..self }
    }

    /// Units in the order of their first series.
    pub(super) fn units(&self) -> Vec<&str> {
        let mut units: Vec<&str> = Vec::new();
        for series in self.series {
            if !units.contains(&series.unit.as_ref()) {
                units.push(&series.unit);
            }
        }
        units
    }

    /// Index of the unit of a series.
    pub(super) fn unit_of(&self, series: usize) -> Option<usize> {
        let unit = self.series.get(series)?.unit.as_ref();
        self.units().iter().position(|known| *known == unit)
    }

    /// Lowest and highest visible value of a series.
    pub(super) fn visible_range(&self, series: usize) -> Option<(f64, f64)> {
        let points = self.series.get(series)?.points;
        let inside = trace::visible_extremes(points, &self.window);
        let shown = trace::in_window(points, &self.window);
        let start = shown
            .iter()
            .find(|bucket| bucket.t >= self.window.from)
            .map_or(self.window.last_time(), |next| next.t);
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

    /// Range of all series of a unit.
    pub(super) fn unit_range(&self, unit: usize) -> Option<(f64, f64)> {
        let of_unit = (0..self.series.len()).filter(|series| self.unit_of(*series) == Some(unit));
        of_unit
            .filter_map(|series| self.visible_range(series))
            .reduce(|(low, high), (other_low, other_high)| (low.min(other_low), high.max(other_high)))
    }

    /// A time in seconds with the resolution of the window.
    pub(super) fn time_text(&self, time: i64) -> String {
        seconds_to(time, time_decimals(self.window.span() / 200).min(6))
    }
}
