//! Curve of one series: a value applies until the next one.
//!
//! ```text
//!        ┌──┐         buckets in one column of dots   ▸ one span from their lowest to their highest value
//!   ─────┘  └───      next value in another column    ▸ a vertical join at its column
//!                ─    no value for longer than the gap ▸ the line ends
//! ```

use super::canvas::{Canvas, Ink};
use super::scale::Scale;
use super::window::Window;
use crate::bucket::Bucket;

/// Known dots of one column.
#[derive(Clone, Copy, Debug)]
struct Column {
    /// Index of the column; negative for a value left of the window.
    at: i64,
    low: u32,
    high: u32,
    /// Row of the last value.
    last: u32,
    /// Time of the last value.
    time: i64,
}

/// Buckets in a window, and one on either side.
pub fn in_window<'a>(points: &'a [Bucket], window: &Window) -> &'a [Bucket] {
    let start = points.partition_point(|bucket| bucket.t < window.from).saturating_sub(1);
    let end = points.partition_point(|bucket| bucket.t <= window.to).saturating_add(1);
    points.get(start..end.min(points.len())).unwrap_or_default()
}

/// Lowest and highest number of the buckets in a window.
pub fn extremes(points: &[Bucket], window: &Window) -> Option<(f64, f64)> {
    let inside = in_window(points, window).iter().filter(|bucket| window.contains(bucket.t));
    let bounds = inside.filter_map(Bucket::bounds).flat_map(|(low, high)| [low, high]);
    bounds.filter(|value| value.is_finite()).fold(None, |found, value| match found {
        None => Some((value, value)),
        Some((low, high)) => Some((low.min(value), high.max(value))),
    })
}

/// Draws a series on a canvas.
pub fn draw(canvas: &mut Canvas, points: &[Bucket], window: &Window, scale: &Scale, series: usize) {
    let mut pen: Option<Column> = None;
    for bucket in in_window(points, window) {
        let Some((low, high)) = bucket.bounds() else {
            finish(canvas, pen.take(), series);
            continue;
        };
        if pen.is_some_and(|pen| window.is_gap(pen.time, bucket.t)) {
            finish(canvas, pen.take(), series);
        }
        let row = |value| scale.row(value, canvas.rows());
        let at = window.column(bucket.t, canvas.columns());
        let last = if bucket.last.is_nan() { high } else { bucket.last };
        let column = Column { at, low: row(low), high: row(high), last: row(last), time: bucket.t };
        pen = Some(match pen {
            Some(pen) if pen.at == at => {
                Column { low: pen.low.min(column.low), high: pen.high.max(column.high), ..column }
            }
            Some(pen) => {
                finish(canvas, Some(pen), series);
                join(canvas, pen, column, series);
                column
            }
            None => column,
        });
    }
    finish(canvas, pen, series);
    if let Some(pen) = pen.filter(|pen| !window.is_gap(pen.time, window.end())) {
        let end = window.column(window.end(), canvas.columns());
        hold(canvas, pen, end.saturating_add(1), series);
    }
}

/// Draws the values of a visible column.
fn finish(canvas: &mut Canvas, column: Option<Column>, series: usize) {
    if let Some(column) = column
        && let Ok(at) = u32::try_from(column.at)
    {
        canvas.span(at, column.low, column.high, series, Ink::Value);
    }
}

/// Draws the line between two columns: the earlier value, then the join to the later one.
fn join(canvas: &mut Canvas, from: Column, to: Column, series: usize) {
    hold(canvas, from, to.at, series);
    if let Ok(at) = u32::try_from(to.at) {
        if from.last < to.low {
            canvas.span(at, from.last, to.low, series, Ink::Join);
        } else if from.last > to.high {
            canvas.span(at, to.high, from.last, series, Ink::Join);
        }
    }
}

/// Extends the last value of a column up to column `end`.
fn hold(canvas: &mut Canvas, from: Column, end: i64, series: usize) {
    for at in from.at.saturating_add(1).max(0)..end.min(i64::from(canvas.columns())) {
        if let Ok(at) = u32::try_from(at) {
            canvas.span(at, from.last, from.last, series, Ink::Hold);
        }
    }
}

#[cfg(test)]
mod tests {
    use ratatui::buffer::Buffer;
    use ratatui::layout::Rect;
    use ratatui::style::Style;

    use super::*;
    use crate::theme::Borders;
    use crate::widgets::draw::tests::shown;

    fn value(t: i64, value: f64) -> Bucket {
        Bucket { t, min: value, max: value, last: value }
    }

    fn drawn(points: &[Bucket], gap: Option<i64>, borders: Borders) -> Vec<String> {
        let until = points.last().map_or(0, |bucket| bucket.t);
        let window = Window { from: 0, to: 9, gap, until };
        let mut canvas = Canvas::new(if borders == Borders::Ascii { 10 } else { 5 }, 3, borders);
        draw(&mut canvas, points, &window, &Scale::round(0.0, 2.0, 1), 0);
        let mut buf = Buffer::empty(Rect::new(0, 0, 10, 3));
        canvas.render(
            Rect { width: if borders == Borders::Ascii { 10 } else { 5 }, ..buf.area },
            &mut buf,
            true,
            |_| Style::new(),
        );
        shown(&buf)
    }

    #[test]
    fn a_value_holds_until_the_next_one() {
        let points = [value(1, 0.0), value(4, 2.0), value(6, 1.0), value(7, 1.0)];
        assert_eq!(drawn(&points, None, Borders::Ascii), ["    *.|", "    | **", " *..|"]);
        assert_eq!(drawn(&points, None, Borders::Unicode), ["  ⡏⡇", "  ⡇⠓", "⢀⣀⡇"]);
    }

    #[test]
    fn nothing_of_a_spike_is_lost() {
        let points = [value(2, 1.0), Bucket { t: 5, min: 0.0, max: 2.0, last: 1.0 }, value(8, 1.0)];
        assert_eq!(drawn(&points, None, Borders::Ascii), ["     *", "  *..*..*", "     *"]);
        // The buckets of one column form one span.
        let points = [value(5, 1.0), value(5, 2.0), value(5, 0.0), value(5, 1.0)];
        assert_eq!(drawn(&points, None, Borders::Ascii), ["     *", "     *", "     *"]);
    }

    #[test]
    fn nothing_for_long_is_no_line() {
        let points = [value(1, 1.0), value(2, 1.0), value(7, 1.0)];
        assert_eq!(drawn(&points, Some(3), Borders::Ascii), ["", " **    *", ""]);
        assert_eq!(drawn(&points, Some(5), Borders::Ascii), ["", " **....*", ""]);
        let broken = [value(1, 1.0), value(3, f64::NAN), value(5, 1.0)];
        assert_eq!(drawn(&broken, None, Borders::Ascii), ["", " *   *", ""]);
    }

    #[test]
    fn lines_come_in_and_go_out() {
        let points = [value(-100, 2.0), value(-50, 1.0), value(3, 0.0), value(40, 2.0), value(50, 0.0)];
        assert_eq!(drawn(&points, None, Borders::Ascii), ["", "...|", "   *......"]);
        assert_eq!(drawn(&points, Some(10), Borders::Ascii), ["", "", "   *"]);
        assert_eq!(drawn(&points[..2], None, Borders::Ascii), ["", "", ""]);
        assert_eq!(
            drawn(&[value(i64::MIN, 1.0), value(i64::MAX, 0.0)], None, Borders::Ascii)[1],
            ".........."
        );
    }

    #[test]
    fn the_last_value_holds_until_the_end() {
        let held = |until, gap| {
            let window = Window { from: 0, to: 9, gap, until };
            let mut canvas = Canvas::new(10, 1, Borders::Ascii);
            draw(&mut canvas, &[value(2, 1.0)], &window, &Scale::round(0.0, 2.0, 1), 0);
            let mut buf = Buffer::empty(Rect::new(0, 0, 10, 1));
            canvas.render(buf.area, &mut buf, true, |_| Style::new());
            shown(&buf).remove(0)
        };
        assert_eq!(held(i64::MAX, None), "  *.......");
        assert_eq!(held(6, None), "  *....");
        assert_eq!(held(6, Some(4)), "  *....");
        assert_eq!(held(6, Some(3)), "  *");
        assert_eq!(held(1, None), "  *");
        assert_eq!(held(i64::MIN, None), "  *");
    }

    #[test]
    fn values_that_are_no_numbers() {
        let points = [
            Bucket { t: 1, min: f64::NEG_INFINITY, max: 1.0, last: 1.0 },
            Bucket { t: 3, min: f64::NAN, max: f64::NAN, last: 1.0 },
            Bucket { t: 5, min: 1.0, max: f64::INFINITY, last: f64::INFINITY },
        ];
        assert_eq!(drawn(&points, None, Borders::Ascii), ["     *", " *.*.*", " *"]);
    }
}
