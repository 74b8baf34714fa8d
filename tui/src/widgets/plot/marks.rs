//! Marks above a plot: events at their times.
//!
//! ```text
//! find     N           E wwwwwwww
//! ```

use ratatui::buffer::Buffer;

use super::content::{MARKS_LABEL, Plot};
use super::places::Places;
use crate::theme::Role;
use crate::widgets::draw;

/// Draws the marks; later ones cover earlier ones.
pub fn render(plot: &Plot<'_>, places: &Places, buf: &mut Buffer) {
    let area = places.marks;
    let Some(marks) = plot.marks.filter(|_| !area.is_empty()) else { return };
    if places.left_width > 0 {
        let x = area.x - places.left_width;
        draw::put(buf, x, area.y, places.left_width, MARKS_LABEL, plot.theme.style(Role::Quiet));
    }
    let columns = u32::from(area.width);
    for mark in marks {
        let first = plot.window.column(mark.from, columns).max(0);
        let last = plot.window.column(mark.to, columns).min(i64::from(columns) - 1);
        for column in first..=last {
            let x = area.x.saturating_add(u16::try_from(column).unwrap_or(u16::MAX));
            draw::put(buf, x, area.y, 1, mark.symbol, plot.theme.style(mark.role));
        }
    }
}
