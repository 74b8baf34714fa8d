//! Frame of a plot: axes with ticks, and the cursors.
//!
//! ```text
//! bar          %     units
//! 140┤  A   B ├60    ticks left and right, names of the cursors
//! 120┤  ┆   ┆ ├40
//!    └─┬─────┬──     time
//!     1.0   1.5 s
//! ```

use cobscope_decoder::figures::seconds_to;
use ratatui::buffer::Buffer;

use super::content::TimePlot;
use super::places::{PlotAreas, PlotSection, UnitAxis};
use super::scale::{time_decimals, time_step};
use crate::theme::{Glyph, LineCharacters, TextRole};
use crate::widgets::draw;

/// Columns per tick of the time.
const TICK_COLUMNS: u16 = 10;

/// Draws axes and cursors.
pub fn draw_axes(plot: &TimePlot<'_>, places: &PlotAreas, buf: &mut Buffer) {
    for part in &places.parts {
        if let Some(axis) = part.left.filter(|_| places.left_width > 0) {
            draw_values(plot, part, &axis, true, buf);
        }
        if let Some(axis) = part.right.filter(|_| places.right_width > 0) {
            draw_values(plot, part, &axis, false, buf);
        }
        if places.has_frame {
            draw_units(plot, places, part, buf);
        }
    }
    if places.has_frame {
        draw_times(plot, places, buf);
    }
    for (name, time) in [("A", plot.cursors.0), ("B", plot.cursors.1)] {
        if let Some(time) = time.filter(|time| plot.window.contains(*time)) {
            draw_cursor(plot, places, name, time, buf);
        }
    }
}

fn draw_values(plot: &TimePlot<'_>, part: &PlotSection, axis: &UnitAxis, is_left: bool, buf: &mut Buffer) {
    let (area, scale) = (part.area, axis.scale);
    let x = if is_left { area.x.saturating_sub(1) } else { area.right() };
    let (border, quiet) = (plot.theme.role_style(TextRole::Border), plot.theme.role_style(TextRole::Quiet));
    for y in area.top()..area.bottom() {
        draw::put_text(buf, x, y, 1, plot.theme.glyph(Glyph::Vertical), border);
    }
    let (tick_mark, dots) = match (plot.theme.borders(), is_left) {
        (LineCharacters::Unicode, true) => ("┤", 4),
        (LineCharacters::Unicode, false) => ("├", 4),
        (LineCharacters::Ascii, _) => ("+", 1),
    };
    for tick in scale.tick_values() {
        // The cell that contains the dot of the tick.
        let row = scale.value_row(tick, u32::from(area.height) * dots) / dots;
        let y = area
            .bottom()
            .saturating_sub(1)
            .saturating_sub(u16::try_from(row).unwrap_or(u16::MAX))
            .max(area.y);
        let label = scale.tick_label(tick);
        let start = if is_left { x.saturating_sub(draw::text_width(&label)) } else { x + 1 };
        draw::put_text(buf, x, y, 1, tick_mark, border);
        draw::put_text(buf, start, y, draw::text_width(&label), &label, quiet);
    }
}

/// Writes the units of a part above their axes.
fn draw_units(plot: &TimePlot<'_>, places: &PlotAreas, part: &PlotSection, buf: &mut Buffer) {
    let (style, units) = (plot.theme.role_style(TextRole::Quiet), plot.units());
    let unit = |axis: UnitAxis| units.get(axis.unit).copied().unwrap_or_default();
    let (Some(y), area) = (part.area.y.checked_sub(1), part.area) else { return };
    if let Some(axis) = part.left.filter(|_| places.left_width > 0) {
        let x = area.x - places.left_width;
        draw::put_text(buf, x, y, area.right() - x, unit(axis), style);
    }
    if let Some(axis) = part.right.filter(|_| places.right_width > 0) {
        let right = area.right() + places.right_width;
        let x = right.saturating_sub(draw::text_width(unit(axis))).max(area.x);
        draw::put_text(buf, x, y, right - x, unit(axis), style);
    }
}

fn draw_times(plot: &TimePlot<'_>, places: &PlotAreas, buf: &mut Buffer) {
    let area = places.plot;
    let (y, border, quiet) =
        (area.bottom(), plot.theme.role_style(TextRole::Border), plot.theme.role_style(TextRole::Quiet));
    let (corner, tick_mark) =
        if plot.theme.borders() == LineCharacters::Unicode { ("└", "┬") } else { ("+", "+") };
    for x in area.left()..area.right() {
        draw::put_text(buf, x, y, 1, plot.theme.glyph(Glyph::Horizontal), border);
    }
    if places.left_width > 0 {
        draw::put_text(buf, area.x - 1, y, 1, corner, border);
    }
    let step = time_step(plot.window.span() / u64::from((area.width / TICK_COLUMNS).max(1)));
    let decimals = time_decimals(step);
    let unit = area.right().saturating_sub(1);
    let mut free = area.x - places.left_width;
    for time in visible_ticks(plot, step) {
        let at = plot.window.column_of(time.saturating_add(plot.zero), u32::from(area.width));
        // Near the limits of i64 the saturated time may be outside the plot.
        let Some(at) = u16::try_from(at).ok().filter(|at| *at < area.width) else { continue };
        let x = area.x + at;
        draw::put_text(buf, x, y, 1, tick_mark, border);
        let label = seconds_to(time, decimals);
        let width = draw::text_width(&label);
        let start = x.saturating_sub(width / 2).max(area.x - places.left_width);
        if start >= free && start + width < unit {
            free = draw::put_text(buf, start, y + 1, width, &label, quiet) + 1;
        }
    }
    draw::put_text(buf, unit, y + 1, 1, "s", quiet);
}

/// Visible multiples of a step, counted from the zero of the plot.
fn visible_ticks(plot: &TimePlot<'_>, step: u64) -> impl Iterator<Item = i64> + use<> {
    let step = i64::try_from(step).unwrap_or(i64::MAX);
    let (from, to) = (plot.window.from.saturating_sub(plot.zero), plot.window.to.saturating_sub(plot.zero));
    let below = from.div_euclid(step).saturating_mul(step);
    let first = if below < from { below.checked_add(step) } else { Some(below) };
    // There are at most as many ticks as columns.
    let times = std::iter::successors(first, move |time| time.checked_add(step));
    times.take_while(move |time| *time <= to).take(usize::from(u16::MAX / TICK_COLUMNS))
}

/// Draws a cursor as a line under the series, with its name above.
fn draw_cursor(plot: &TimePlot<'_>, places: &PlotAreas, name: &str, time: i64, buf: &mut Buffer) {
    let area = places.plot;
    let column = plot.window.column_of(time, u32::from(area.width));
    let x = area.x.saturating_add(u16::try_from(column).unwrap_or(u16::MAX));
    if area.is_empty() || x >= area.right() {
        return;
    }
    let line = if plot.theme.borders() == LineCharacters::Unicode { "┆" } else { ":" };
    for y in area.top()..area.bottom() {
        draw::put_text(buf, x, y, 1, line, plot.theme.role_style(TextRole::Key));
    }
    let y = area.y - u16::from(places.has_frame);
    draw::put_text(buf, x, y, 1, name, plot.theme.role_style(TextRole::Cursor));
}
