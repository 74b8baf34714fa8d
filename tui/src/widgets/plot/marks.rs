//! Marks above a plot: events at their times.
//!
//! ```text
//! find     N           E wwwwwwww
//! ```

use ratatui::buffer::Buffer;

use super::content::{MARKS_LABEL, TimePlot};
use super::places::PlotAreas;
use crate::theme::TextRole;
use crate::widgets::draw;

/// Draws the marks; later ones cover earlier ones.
pub fn draw_marks(plot: &TimePlot<'_>, places: &PlotAreas, buf: &mut Buffer) {
    let area = places.marks;
    let Some(marks) = plot.marks.filter(|_| !area.is_empty()) else { return };
    if places.left_width > 0 {
        let x = area.x - places.left_width;
        draw::put_text(
            buf,
            x,
            area.y,
            places.left_width,
            MARKS_LABEL,
            plot.theme.role_style(TextRole::Quiet),
        );
    }
    let columns = u32::from(area.width);
    for mark in marks {
        let first = plot.window.column_of(mark.from, columns).max(0);
        let last = plot.window.column_of(mark.to, columns).min(i64::from(columns) - 1);
        for column in first..=last {
            let x = area.x.saturating_add(u16::try_from(column).unwrap_or(u16::MAX));
            draw::put_text(buf, x, area.y, 1, mark.symbol, plot.theme.role_style(mark.role));
        }
    }
}
