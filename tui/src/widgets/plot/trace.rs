//! Curve of one series: a value applies until the next one.
//!
//! ```text
//!        ┌──┐         buckets in one column of dots   ▸ one span from their lowest to their highest value
//!   ─────┘  └───      next value in another column    ▸ a vertical join at its column
//!                ─    no value for longer than the gap ▸ the line ends
//! ```

use super::canvas::{DotCanvas, DotReason};
use super::scale::ValueScale;
use super::window::TimeWindow;
use crate::bucket::SampleBucket;

/// Known dots of one column.
#[derive(Clone, Copy, Debug)]
struct TraceColumn {
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
pub fn in_window<'a>(points: &'a [SampleBucket], window: &TimeWindow) -> &'a [SampleBucket] {
    let start = points.partition_point(|bucket| bucket.t < window.from).saturating_sub(1);
    let end = points.partition_point(|bucket| bucket.t <= window.to).saturating_add(1);
    points.get(start..end.min(points.len())).unwrap_or_default()
}

/// Lowest and highest number of the buckets in a window.
pub fn visible_extremes(points: &[SampleBucket], window: &TimeWindow) -> Option<(f64, f64)> {
    let inside = in_window(points, window).iter().filter(|bucket| window.contains(bucket.t));
    let bounds = inside.filter_map(SampleBucket::bounds).flat_map(|(low, high)| [low, high]);
    bounds.filter(|value| value.is_finite()).fold(None, |found, value| match found {
        None => Some((value, value)),
        Some((low, high)) => Some((low.min(value), high.max(value))),
    })
}

/// Draws a series on a canvas.
pub fn draw_series(
    canvas: &mut DotCanvas,
    points: &[SampleBucket],
    window: &TimeWindow,
    scale: &ValueScale,
    series: usize,
) {
    let mut pen: Option<TraceColumn> = None;
    for bucket in in_window(points, window) {
        let Some((low, high)) = bucket.bounds() else {
            draw_column(canvas, pen.take(), series);
            continue;
        };
        if pen.is_some_and(|pen| window.is_gap(pen.time, bucket.t)) {
            draw_column(canvas, pen.take(), series);
        }
        let row = |value| scale.value_row(value, canvas.rows());
        let at = window.column_of(bucket.t, canvas.columns());
        let last = if bucket.last.is_nan() { high } else { bucket.last };
        let column = TraceColumn { at, low: row(low), high: row(high), last: row(last), time: bucket.t };
        pen = Some(match pen {
            Some(pen) if pen.at == at => {
                TraceColumn { low: pen.low.min(column.low), high: pen.high.max(column.high), ..column }
            }
            Some(pen) => {
                draw_column(canvas, Some(pen), series);
                draw_join(canvas, pen, column, series);
                column
            }
            None => column,
        });
    }
    draw_column(canvas, pen, series);
    if let Some(pen) = pen.filter(|pen| !window.is_gap(pen.time, window.last_time())) {
        let end = window.column_of(window.last_time(), canvas.columns());
        extend_value(canvas, pen, end.saturating_add(1), series);
    }
}

/// Draws the values of a visible column.
fn draw_column(canvas: &mut DotCanvas, column: Option<TraceColumn>, series: usize) {
    if let Some(column) = column
        && let Ok(at) = u32::try_from(column.at)
    {
        canvas.set_span(at, column.low, column.high, series, DotReason::Value);
    }
}

/// Draws the line between two columns: the earlier value, then the join to the later one.
fn draw_join(canvas: &mut DotCanvas, from: TraceColumn, to: TraceColumn, series: usize) {
    extend_value(canvas, from, to.at, series);
    if let Ok(at) = u32::try_from(to.at) {
        if from.last < to.low {
            canvas.set_span(at, from.last, to.low, series, DotReason::Join);
        } else if from.last > to.high {
            canvas.set_span(at, to.high, from.last, series, DotReason::Join);
        }
    }
}

/// Extends the last value of a column up to column `end`.
fn extend_value(canvas: &mut DotCanvas, from: TraceColumn, end: i64, series: usize) {
    for at in from.at.saturating_add(1).max(0)..end.min(i64::from(canvas.columns())) {
        if let Ok(at) = u32::try_from(at) {
            canvas.set_span(at, from.last, from.last, series, DotReason::Hold);
        }
    }
}

#[cfg(test)]
mod tests {
    use ratatui::buffer::Buffer;
    use ratatui::layout::Rect;
    use ratatui::style::Style;

    use super::*;
    use crate::theme::LineCharacters;
    use crate::widgets::draw::tests::buffer_lines;

    fn value(t: i64, value: f64) -> SampleBucket {
        SampleBucket { t, min: value, max: value, last: value }
    }

    fn drawn(points: &[SampleBucket], gap: Option<i64>, borders: LineCharacters) -> Vec<String> {
        let until = points.last().map_or(0, |bucket| bucket.t);
        let window = TimeWindow { from: 0, to: 9, gap, until };
        let mut canvas = DotCanvas::new(if borders == LineCharacters::Ascii { 10 } else { 5 }, 3, borders);
        draw_series(&mut canvas, points, &window, &ValueScale::round_range(0.0, 2.0, 1), 0);
        let mut buf = Buffer::empty(Rect::new(0, 0, 10, 3));
        canvas.render(
            Rect { width: if borders == LineCharacters::Ascii { 10 } else { 5 }, ..buf.area },
            &mut buf,
            true,
            |_| Style::new(),
        );
        buffer_lines(&buf)
    }

    #[test]
    fn a_value_holds_until_the_next_one() {
        let points = [value(1, 0.0), value(4, 2.0), value(6, 1.0), value(7, 1.0)];
        assert_eq!(drawn(&points, None, LineCharacters::Ascii), ["    *.|", "    | **", " *..|"]);
        assert_eq!(drawn(&points, None, LineCharacters::Unicode), ["  ⡏⡇", "  ⡇⠓", "⢀⣀⡇"]);
    }

    #[test]
    fn nothing_of_a_spike_is_lost() {
        let points = [value(2, 1.0), SampleBucket { t: 5, min: 0.0, max: 2.0, last: 1.0 }, value(8, 1.0)];
        assert_eq!(drawn(&points, None, LineCharacters::Ascii), ["     *", "  *..*..*", "     *"]);
        // The buckets of one column form one span.
        let points = [value(5, 1.0), value(5, 2.0), value(5, 0.0), value(5, 1.0)];
        assert_eq!(drawn(&points, None, LineCharacters::Ascii), ["     *", "     *", "     *"]);
    }

    #[test]
    fn nothing_for_long_is_no_line() {
        let points = [value(1, 1.0), value(2, 1.0), value(7, 1.0)];
        assert_eq!(drawn(&points, Some(3), LineCharacters::Ascii), ["", " **    *", ""]);
        assert_eq!(drawn(&points, Some(5), LineCharacters::Ascii), ["", " **....*", ""]);
        let broken = [value(1, 1.0), value(3, f64::NAN), value(5, 1.0)];
        assert_eq!(drawn(&broken, None, LineCharacters::Ascii), ["", " *   *", ""]);
    }

    #[test]
    fn lines_come_in_and_go_out() {
        let points = [value(-100, 2.0), value(-50, 1.0), value(3, 0.0), value(40, 2.0), value(50, 0.0)];
        assert_eq!(drawn(&points, None, LineCharacters::Ascii), ["", "...|", "   *......"]);
        assert_eq!(drawn(&points, Some(10), LineCharacters::Ascii), ["", "", "   *"]);
        assert_eq!(drawn(&points[..2], None, LineCharacters::Ascii), ["", "", ""]);
        assert_eq!(
            drawn(&[value(i64::MIN, 1.0), value(i64::MAX, 0.0)], None, LineCharacters::Ascii)[1],
            ".........."
        );
    }

    #[test]
    fn the_last_value_holds_until_the_end() {
        let held = |until, gap| {
            let window = TimeWindow { from: 0, to: 9, gap, until };
            let mut canvas = DotCanvas::new(10, 1, LineCharacters::Ascii);
            draw_series(&mut canvas, &[value(2, 1.0)], &window, &ValueScale::round_range(0.0, 2.0, 1), 0);
            let mut buf = Buffer::empty(Rect::new(0, 0, 10, 1));
            canvas.render(buf.area, &mut buf, true, |_| Style::new());
            buffer_lines(&buf).remove(0)
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
            SampleBucket { t: 1, min: f64::NEG_INFINITY, max: 1.0, last: 1.0 },
            SampleBucket { t: 3, min: f64::NAN, max: f64::NAN, last: 1.0 },
            SampleBucket { t: 5, min: 1.0, max: f64::INFINITY, last: f64::INFINITY },
        ];
        assert_eq!(drawn(&points, None, LineCharacters::Ascii), ["     *", " *.*.*", " *"]);
    }
}
