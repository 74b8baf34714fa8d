//! Frame of a plot: axes with ticks, and the cursors.
//!
//! ```text
//! bar          %     units
//! 140┤  A   B ├60    ticks left and right, names of the cursors
//! 120┤  ┆   ┆ ├40
//!    └─┬─────┬──     time
//!     1.0   1.5 s
//! ```

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;

use super::content::Plot;
use super::scale::{Scale, seconds, time_decimals, time_step};
use crate::theme::{Borders, Glyph, Role};
use crate::widgets::draw;

/// Minimum width of the plot; below it axes are dropped.
const LEAST_WIDTH: u16 = 12;
const LEAST_HEIGHT: u16 = 5;
/// Minimum height with a legend.
const LEGEND_FROM: u16 = 9;
/// Lines per tick of a value, and columns per tick of the time.
const TICK_LINES: u16 = 3;
const TICK_COLUMNS: u16 = 10;

/// Areas and scales of a plot.
#[derive(Clone, Copy, Debug)]
pub struct Places {
    /// Area of the curves.
    pub plot: Rect,
    /// Scale of the first unit.
    pub left: Option<Scale>,
    /// Scale of the second unit.
    pub right: Option<Scale>,
    /// Width of the labels of the left axis; 0 without room for an axis.
    left_width: u16,
    right_width: u16,
    /// Whether there are lines for the time axis and the units.
    has_frame: bool,
    /// Area of the legend below the plot.
    pub legend: Rect,
}

impl Places {
    /// Divides an area into these parts.
    pub fn new(plot: &Plot<'_>, area: Rect) -> Self {
        let lines = draw::cells(plot.series.len()).saturating_add(1);
        let legend_height = if area.height < LEGEND_FROM { 0 } else { lines.min(area.height / 3) };
        let rest = area.height - legend_height;
        let has_frame = rest >= LEAST_HEIGHT;
        let (above, below) = if has_frame { (1, 2) } else { (0, 0) };
        let height = rest - above - below;
        let scale = |axis| {
            plot.axis_range(axis).map(|(low, high)| Scale::round(low, high, (height / TICK_LINES).max(1)))
        };
        let (left, right) = (scale(0), scale(1));
        let wide = |scale: Option<Scale>| {
            let labels = scale.map(|scale| scale.ticks().map(|tick| draw::width(&scale.label(tick))).max());
            labels.flatten().map_or(0, |width| width + 1)
        };
        let (mut left_width, mut right_width) = (wide(left), wide(right));
        if area.width < LEAST_WIDTH.saturating_add(left_width).saturating_add(right_width) || !has_frame {
            right_width = 0;
        }
        if area.width < LEAST_WIDTH.saturating_add(left_width) || !has_frame {
            left_width = 0;
        }
        let inside = Rect {
            x: area.x + left_width,
            y: area.y + above,
            width: area.width - left_width - right_width,
            height,
        };
        let legend = Rect { y: area.y + rest, height: legend_height, ..area };
        Self { plot: inside, left, right, left_width, right_width, has_frame, legend }
    }
}

/// Draws axes and cursors.
pub fn render(plot: &Plot<'_>, places: &Places, buf: &mut Buffer) {
    if places.left_width > 0 {
        draw_values(plot, places, true, buf);
    }
    if places.right_width > 0 {
        draw_values(plot, places, false, buf);
    }
    if places.has_frame {
        draw_units(plot, places, buf);
        draw_times(plot, places, buf);
    }
    for (name, time) in [("A", plot.cursors.0), ("B", plot.cursors.1)] {
        if let Some(time) = time.filter(|time| plot.window.contains(*time)) {
            draw_cursor(plot, places, name, time, buf);
        }
    }
}

fn draw_values(plot: &Plot<'_>, places: &Places, is_left: bool, buf: &mut Buffer) {
    let area = places.plot;
    let (scale, x) =
        if is_left { (places.left, area.x.saturating_sub(1)) } else { (places.right, area.right()) };
    let Some(scale) = scale else { return };
    let (border, quiet) = (plot.theme.style(Role::Border), plot.theme.style(Role::Quiet));
    for y in area.top()..area.bottom() {
        draw::put(buf, x, y, 1, plot.theme.glyph(Glyph::Vertical), border);
    }
    let (tick_mark, dots) = match (plot.theme.borders(), is_left) {
        (Borders::Unicode, true) => ("┤", 4),
        (Borders::Unicode, false) => ("├", 4),
        (Borders::Ascii, _) => ("+", 1),
    };
    for tick in scale.ticks() {
        // The cell that contains the dot of the tick.
        let row = scale.row(tick, u32::from(area.height) * dots) / dots;
        let y = area
            .bottom()
            .saturating_sub(1)
            .saturating_sub(u16::try_from(row).unwrap_or(u16::MAX))
            .max(area.y);
        let label = scale.label(tick);
        let start = if is_left { x.saturating_sub(draw::width(&label)) } else { x + 1 };
        draw::put(buf, x, y, 1, tick_mark, border);
        draw::put(buf, start, y, draw::width(&label), &label, quiet);
    }
}

/// Writes the units above their axes.
fn draw_units(plot: &Plot<'_>, places: &Places, buf: &mut Buffer) {
    let style = plot.theme.style(Role::Quiet);
    let unit = |axis| {
        let series = (0..plot.series.len()).find(|series| plot.axis(*series) == axis);
        series.and_then(|series| plot.series.get(series)).map_or("", |series| series.unit.as_ref())
    };
    let Some(y) = places.plot.y.checked_sub(1) else { return };
    if places.left_width > 0 {
        let x = places.plot.x - places.left_width;
        draw::put(buf, x, y, places.plot.right() - x, unit(0), style);
    }
    if places.right_width > 0 {
        let right = places.plot.right() + places.right_width;
        let x = right.saturating_sub(draw::width(unit(1))).max(places.plot.x);
        draw::put(buf, x, y, right - x, unit(1), style);
    }
}

fn draw_times(plot: &Plot<'_>, places: &Places, buf: &mut Buffer) {
    let area = places.plot;
    let (y, border, quiet) = (area.bottom(), plot.theme.style(Role::Border), plot.theme.style(Role::Quiet));
    let (corner, tick_mark) =
        if plot.theme.borders() == Borders::Unicode { ("└", "┬") } else { ("+", "+") };
    for x in area.left()..area.right() {
        draw::put(buf, x, y, 1, plot.theme.glyph(Glyph::Horizontal), border);
    }
    if places.left_width > 0 {
        draw::put(buf, area.x - 1, y, 1, corner, border);
    }
    let step = time_step(plot.window.span() / u64::from((area.width / TICK_COLUMNS).max(1)));
    let decimals = time_decimals(step);
    let unit = area.right().saturating_sub(1);
    let mut free = area.x - places.left_width;
    for time in ticks(plot, step) {
        let at = plot.window.column(time.saturating_add(plot.zero), u32::from(area.width));
        // Near the limits of i64 the saturated time may be outside the plot.
        let Some(at) = u16::try_from(at).ok().filter(|at| *at < area.width) else { continue };
        let x = area.x + at;
        draw::put(buf, x, y, 1, tick_mark, border);
        let label = seconds(time, decimals);
        let width = draw::width(&label);
        let start = x.saturating_sub(width / 2).max(area.x - places.left_width);
        if start >= free && start + width < unit {
            free = draw::put(buf, start, y + 1, width, &label, quiet) + 1;
        }
    }
    draw::put(buf, unit, y + 1, 1, "s", quiet);
}

/// Visible multiples of a step, counted from the zero of the plot.
fn ticks(plot: &Plot<'_>, step: u64) -> impl Iterator<Item = i64> + use<> {
    let step = i64::try_from(step).unwrap_or(i64::MAX);
    let (from, to) = (plot.window.from.saturating_sub(plot.zero), plot.window.to.saturating_sub(plot.zero));
    let below = from.div_euclid(step).saturating_mul(step);
    let first = if below < from { below.checked_add(step) } else { Some(below) };
    // There are at most as many ticks as columns.
    let times = std::iter::successors(first, move |time| time.checked_add(step));
    times.take_while(move |time| *time <= to).take(usize::from(u16::MAX / TICK_COLUMNS))
}

/// Draws a cursor as a line under the series, with its name above.
fn draw_cursor(plot: &Plot<'_>, places: &Places, name: &str, time: i64, buf: &mut Buffer) {
    let area = places.plot;
    let column = plot.window.column(time, u32::from(area.width));
    let x = area.x.saturating_add(u16::try_from(column).unwrap_or(u16::MAX));
    if area.is_empty() || x >= area.right() {
        return;
    }
    let line = if plot.theme.borders() == Borders::Unicode { "┆" } else { ":" };
    for y in area.top()..area.bottom() {
        draw::put(buf, x, y, 1, line, plot.theme.style(Role::Key));
    }
    let y = area.y - u16::from(places.has_frame);
    draw::put(buf, x, y, 1, name, plot.theme.style(Role::Cursor));
}
