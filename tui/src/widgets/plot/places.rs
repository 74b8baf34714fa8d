//! Areas and scales of a plot.
//!
//! ```text
//! find   N      E wwww         marks
//! bar          %               one part: up to two units
//! 140┤        ├60
//!    └─┬─────┬──
//!
//! bar                          more units: parts one above the other
//! 140┤
//! %
//!  60┤
//!    └─┬─────┬──
//! ```

use ratatui::layout::Rect;

use super::content::{MARKS_LABEL, TimePlot};
use super::scale::ValueScale;
use crate::widgets::draw;

/// Minimum width of the plot; below it axes are dropped.
const LEAST_WIDTH: u16 = 12;
const LEAST_HEIGHT: u16 = 5;
/// Minimum height with a row of marks.
const MARKS_FROM: u16 = 6;
/// Minimum heights with the names of the series in one line, and with a legend.
const NAMES_FROM: u16 = 8;
const LEGEND_FROM: u16 = 12;
/// Minimum height of a part with one unit, and of one with two.
const ALONE: u16 = 4;
const SHARED: u16 = 2;
/// Lines per tick of a value.
const TICK_LINES: u16 = 3;

/// Areas of a plot.
#[derive(Clone, Debug)]
pub struct PlotAreas {
    /// Area of all parts; its columns are the time.
    pub plot: Rect,
    /// Parts from above to below; at least one.
    pub parts: Vec<PlotSection>,
    /// Row of the marks; empty without marks.
    pub marks: Rect,
    /// Area of the legend below the plot.
    pub legend: Rect,
    /// Width of the labels of the left axis; 0 without room for an axis.
    pub left_width: u16,
    pub right_width: u16,
    /// Whether there are lines for the time axis and the units.
    pub has_frame: bool,
}

/// Curves of one or two units.
#[derive(Clone, Copy, Debug)]
pub struct PlotSection {
    pub area: Rect,
    pub left: Option<UnitAxis>,
    pub right: Option<UnitAxis>,
}

/// Scale of one unit.
#[derive(Clone, Copy, Debug)]
pub struct UnitAxis {
    /// Index of the unit.
    pub unit: usize,
    pub scale: ValueScale,
}

impl PlotAreas {
    /// Divides an area into these parts.
    pub fn new(plot: &TimePlot<'_>, area: Rect) -> Self {
        let lines = draw::to_cells(plot.series.len()).saturating_add(1);
        // The second cursor is there to compare values.
        let compares = plot.cursors.1.is_some();
        let legend_height = match area.height {
            ..NAMES_FROM => 0,
            NAMES_FROM..LEGEND_FROM if !compares => 1,
            _ => lines.min(area.height / 3),
        };
        let rest = area.height - legend_height;
        let has_frame = rest >= LEAST_HEIGHT;
        let marks_height = u16::from(plot.marks.is_some() && rest >= MARKS_FROM);
        let (above, below) = if has_frame { (1 + marks_height, 2) } else { (0, 0) };
        let inside = Rect { y: area.y + above, height: rest - above - below, ..area };
        let mut parts = stack_parts(plot, inside);
        let wide = |axes: &dyn Fn(&PlotSection) -> Option<UnitAxis>| {
            let labels = parts.iter().filter_map(axes).flat_map(|axis| {
                axis.scale.tick_values().map(move |tick| draw::text_width(&axis.scale.tick_label(tick)) + 1)
            });
            labels.max().unwrap_or(0)
        };
        let (mut left_width, mut right_width) = (wide(&|part| part.left), wide(&|part| part.right));
        if marks_height > 0 {
            left_width = left_width.max(draw::text_width(MARKS_LABEL) + 1);
        }
        if area.width < LEAST_WIDTH.saturating_add(left_width).saturating_add(right_width) || !has_frame {
            right_width = 0;
        }
        if area.width < LEAST_WIDTH.saturating_add(left_width) || !has_frame {
            left_width = 0;
        }
        let (x, width) = (area.x + left_width, area.width - left_width - right_width);
        for part in &mut parts {
            (part.area.x, part.area.width) = (x, width);
        }
        let inside = Rect { x, width, ..inside };
        let marks = Rect { y: area.y, height: marks_height, ..inside };
        let legend = Rect { y: area.y + rest, height: legend_height, ..area };
        Self { plot: inside, parts, marks, legend, left_width, right_width, has_frame }
    }

    /// The part with the curves of a unit, and their scale; None without room for the unit.
    pub fn of_unit(&self, unit: usize) -> Option<(usize, ValueScale)> {
        self.parts.iter().enumerate().find_map(|(place, part)| {
            let mut axes = part.left.into_iter().chain(part.right);
            axes.find(|axis| axis.unit == unit).map(|axis| (place, axis.scale))
        })
    }
}

/// Stacks the parts: one for up to two units, else one per unit, or one per two units on low screens.
fn stack_parts(plot: &TimePlot<'_>, inside: Rect) -> Vec<PlotSection> {
    let units = plot.units().len();
    // A line with the units precedes each part.
    let fitting = |least: u16| usize::from((inside.height + 1) / (least + 1));
    let (count, per_part) = match units {
        ..=2 => (1, 2),
        _ if units <= fitting(ALONE) => (units, 1),
        _ => (units.div_ceil(2).min(fitting(SHARED)).max(1), 2),
    };
    let count_of_lines = draw::to_cells(count);
    let lines = inside.height.saturating_sub(count_of_lines.saturating_sub(1));
    let (each, mut more) = (lines / count_of_lines.max(1), lines % count_of_lines.max(1));
    let mut y = inside.y;
    let part = |place: usize| {
        let height = each + u16::from(more > 0);
        more = more.saturating_sub(1);
        let area = Rect { y, height, ..inside };
        y = area.bottom() + 1;
        // One tick would make a scale of up to ten times the range.
        let ticks = if height < TICK_LINES { 1 } else { 2 };
        let axis = |unit: usize| {
            let (low, high) = plot.unit_range(unit)?;
            Some(UnitAxis {
                unit,
                scale: ValueScale::round_range(low, high, (height / TICK_LINES).max(ticks)),
            })
        };
        let first = place * per_part;
        let right = if per_part > 1 { axis(first + 1) } else { None };
        PlotSection { area, left: axis(first), right }
    };
    (0..count).map(part).collect()
}
