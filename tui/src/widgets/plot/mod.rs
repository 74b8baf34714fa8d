//! A plot of signals over time.
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
//! Series with the same unit share a scale with a labelled axis: the first unit the left one, the second unit
//! the right one. With more units, parts with their own axes are stacked. Marks above the plot show events
//! at their times.

mod canvas;
mod content;
mod frame;
mod legend;
mod marks;
mod places;
mod scale;
mod trace;
mod window;

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::text::Line;

use self::canvas::DotCanvas;
pub use self::content::{PlotSeries, TimeMark, TimePlot};
use self::places::PlotAreas;
use crate::theme::{LineCharacters, TextRole};
use crate::widgets::draw::{self, TextAlignment};

impl TimePlot<'_> {
    /// Draws the plot.
    pub fn render(&self, area: Rect, buf: &mut Buffer) {
        let area = area.intersection(buf.area);
        if area.is_empty() {
            return;
        }
        if (0..self.series.len()).all(|index| self.visible_range(index).is_none()) {
            let text = Line::styled(self.empty, self.theme.role_style(TextRole::Quiet));
            draw::draw_line(buf, area, &text, TextAlignment::Left, self.theme);
            return;
        }
        let places = PlotAreas::new(self, area);
        frame::draw_axes(self, &places, buf);
        for place in 0..places.parts.len() {
            self.draw_part(&places, place, buf);
        }
        marks::draw_marks(self, &places, buf);
        legend::draw_legend(self, &places, buf);
    }

    /// Draws the curves of a part.
    fn draw_part(&self, places: &PlotAreas, place: usize, buf: &mut Buffer) {
        let Some(area) = places.parts.get(place).map(|part| part.area) else { return };
        let is_alone = self.series.len() == 1;
        let mut canvas = DotCanvas::new(area.width, area.height, self.theme.borders());
        for (index, series) in self.series.iter().enumerate() {
            let found = self.unit_of(index).and_then(|unit| places.of_unit(unit));
            if let Some((_, scale)) = found.filter(|(part, _)| *part == place) {
                trace::draw_series(&mut canvas, series.points, &self.window, &scale, index);
            }
        }
        let role = |index: usize| self.series.get(index).map_or(TextRole::Text, |series| series.role);
        canvas.render(area, buf, is_alone, |index| self.theme.role_style(role(index)));
    }

    /// The time of a screen column inside the plot.
    pub fn time_at(&self, area: Rect, x: u16) -> Option<i64> {
        let plot = PlotAreas::new(self, area).plot;
        let column = x.checked_sub(plot.x).filter(|column| *column < plot.width)?;
        Some(self.window.time_of(u32::from(column), u32::from(plot.width)))
    }

    /// Last time of the column that is `columns` columns after the column of `time`, inside the plot or not.
    pub fn time_beside(&self, area: Rect, time: i64, columns: i64) -> i64 {
        let width = u32::from(PlotAreas::new(self, area).plot.width.max(1));
        let wanted = self.window.column_of(time, width).saturating_add(columns);
        match u32::try_from(wanted) {
            Ok(column) if column + 1 < width => self.window.time_of(column + 1, width).saturating_sub(1),
            Ok(column) if column < width => self.window.to,
            _ => {
                let one = i64::try_from(self.window.span() / u64::from(width)).unwrap_or(i64::MAX).max(1);
                time.saturating_add(one.saturating_mul(columns))
            }
        }
    }

    /// The legend as text: a line with the heads, then one line per series.
    pub fn legend_text(&self) -> String {
        legend::legend_text(self)
    }

    /// Number of units that have no room in an area.
    pub fn units_without_room(&self, area: Rect) -> usize {
        let places = PlotAreas::new(self, area);
        let is_missing = |unit: &usize| self.unit_range(*unit).is_some() && places.of_unit(*unit).is_none();
        (0..self.units().len()).filter(is_missing).count()
    }

    /// Number of dot columns; finer samples are not visible.
    pub fn dot_columns(&self, area: Rect) -> u32 {
        let per_cell = if self.theme.borders() == LineCharacters::Unicode { 2 } else { 1 };
        u32::from(PlotAreas::new(self, area).plot.width) * per_cell
    }
}

#[cfg(test)]
mod tests;
