//! Signals over time.
//!
//! ```text
//! bar               A
//! 130┤          ⡏⠉⠉⠉⠉⠉⠉⠉⠉⠉⡇
//!    │          ⡇   ┆     ⡇
//!    │          ⡇   ┆     ⡇
//! 125┤          ⡇   ┆     ⡇
//!    │⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠁   ┆     ⡇
//!    │              ┆     ⡇         ⡀
//! 120┤              ┆     ⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉
//!    └┬─────────┬─────────┬─────────┬─────────
//!    0.0       0.5       1.0       1.5       s
//!              A 0.70 s  min  max
//! ⠤⠤ pressure       130  121  130 bar
//! ```
//!
//! Series with the same unit share an axis; the first unit has the left one, the second the right one, and
//! series of further units have their own scale.

mod canvas;
mod frame;
mod legend;
mod scale;
mod trace;

use std::borrow::Cow;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;

use self::canvas::Canvas;
use self::frame::Places;
use self::scale::Scale;
use crate::bucket::Bucket;
use crate::theme::{Borders, Role, Theme};
use crate::widgets::draw::{self, Align};

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

/// What is in view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Window {
    from: i64,
    /// Still in view.
    to: i64,
    gap: Option<i64>,
    /// Beyond it nothing is known, so no value holds.
    until: i64,
}

impl Window {
    fn contains(&self, time: i64) -> bool {
        (self.from..=self.to).contains(&time)
    }

    /// Whether nothing came for so long that no line joins two times.
    fn is_gap(&self, earlier: i64, later: i64) -> bool {
        self.gap.is_some_and(|gap| later.saturating_sub(earlier) > gap)
    }

    /// The last time in view at which a value may hold.
    fn end(&self) -> i64 {
        self.to.min(self.until)
    }

    /// Nanoseconds in view.
    fn span(&self) -> u64 {
        self.to.abs_diff(self.from).saturating_add(1)
    }

    /// In which of so many columns a time is; before it -1, behind it their number.
    fn column(&self, time: i64, columns: u32) -> i64 {
        if time < self.from {
            -1
        } else if time > self.to {
            i64::from(columns)
        } else {
            let at = u128::from(time.abs_diff(self.from)) * u128::from(columns) / u128::from(self.span());
            i64::try_from(at).unwrap_or(i64::MAX)
        }
    }

    /// The first time of a column.
    fn time(&self, column: u32, columns: u32) -> i64 {
        let after = (u128::from(column) * u128::from(self.span())).div_ceil(u128::from(columns.max(1)));
        u64::try_from(after)
            .ok()
            .and_then(|after| self.from.checked_add_unsigned(after))
            .unwrap_or(self.to)
            .min(self.to)
    }
}

/// Series to be drawn over time.
#[derive(Clone, Copy, Debug)]
pub struct Plot<'a> {
    theme: &'a Theme,
    series: &'a [Series<'a>],
    window: Window,
    zero: i64,
    cursors: (Option<i64>, Option<i64>),
    empty: &'a str,
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

    /// Draws the plot.
    pub fn render(&self, area: Rect, buf: &mut Buffer) {
        let area = area.intersection(buf.area);
        if area.is_empty() {
            return;
        }
        let ranges: Vec<_> = (0..self.series.len()).map(|index| self.range(index)).collect();
        if ranges.iter().all(Option::is_none) {
            let text = Line::styled(self.empty, self.theme.style(Role::Quiet));
            draw::line(buf, area, &text, Align::Left, self.theme);
            return;
        }
        let places = Places::new(self, area);
        frame::render(self, &places, buf);
        let mut canvas = Canvas::new(places.plot.width, places.plot.height, self.theme.borders());
        for (index, (series, range)) in self.series.iter().zip(ranges).enumerate() {
            let scale = match (self.axis(index), range) {
                (0, _) => places.left,
                (1, _) => places.right,
                (_, range) => range.map(|(low, high)| Scale::exact(low, high)),
            };
            if let Some(scale) = scale {
                trace::draw(&mut canvas, series.points, &self.window, &scale, index);
            }
        }
        let role = |index: usize| self.series.get(index).map_or(Role::Text, |series| series.role);
        canvas.render(places.plot, buf, |index| self.theme.style(role(index)));
        legend::render(self, places.legend, buf);
    }

    /// The time at a column of the screen, if that is in the plot.
    pub fn time_at(&self, area: Rect, x: u16) -> Option<i64> {
        let plot = Places::new(self, area).plot;
        let column = x.checked_sub(plot.x).filter(|column| *column < plot.width)?;
        Some(self.window.time(u32::from(column), u32::from(plot.width)))
    }

    /// The last time of the column that is so many columns behind that of a time, inside the plot or not.
    pub fn beside(&self, area: Rect, time: i64, columns: i64) -> i64 {
        let width = u32::from(Places::new(self, area).plot.width.max(1));
        let wanted = self.window.column(time, width).saturating_add(columns);
        match u32::try_from(wanted) {
            Ok(column) if column + 1 < width => self.window.time(column + 1, width).saturating_sub(1),
            Ok(column) if column < width => self.window.to,
            _ => {
                let one = i64::try_from(self.window.span() / u64::from(width)).unwrap_or(i64::MAX).max(1);
                time.saturating_add(one.saturating_mul(columns))
            }
        }
    }

    /// The legend as text, a line a series below one with the titles.
    pub fn legend(&self) -> String {
        legend::text(self)
    }

    /// How many columns of dots the plot has: finer pieces of time than these are not seen.
    pub fn resolution(&self, area: Rect) -> u32 {
        let per_cell = if self.theme.borders() == Borders::Unicode { 2 } else { 1 };
        u32::from(Places::new(self, area).plot.width) * per_cell
    }

    /// The number of a series' unit among the units.
    fn axis(&self, series: usize) -> usize {
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
    fn range(&self, series: usize) -> Option<(f64, f64)> {
        let points = self.series.get(series)?.points;
        let inside = self.extremes(points);
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
    fn axis_range(&self, axis: usize) -> Option<(f64, f64)> {
        let of_axis = (0..self.series.len()).filter(|series| self.axis(*series) == axis);
        of_axis
            .filter_map(|series| self.range(series))
            .reduce(|(low, high), (other_low, other_high)| (low.min(other_low), high.max(other_high)))
    }

    fn extremes(&self, points: &[Bucket]) -> Option<(f64, f64)> {
        legend::extremes(points, &self.window)
    }

    /// A time in seconds, as exactly as the window shows it.
    fn time_text(&self, time: i64) -> String {
        scale::seconds(time, scale::time_decimals(self.window.span() / 200).min(6))
    }
}

#[cfg(test)]
mod tests;
