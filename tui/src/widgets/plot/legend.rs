//! Legend of a plot: a table of the series below it.
//!
//! ```text
//!               A 12.300 s  B 12.800 s  Δ 0.500 s    min    max
//! ⠤⠤ pressure        124.2       130.1        5.9  124.0  131.0 bar
//! ```

use ratatui::buffer::Buffer;
use ratatui::layout::Rect;
use ratatui::style::Style;
use ratatui::text::{Line, Span};

use super::canvas::{series_mark, shared_symbol};
use super::content::TimePlot;
use super::places::PlotAreas;
use super::scale::{decimals_for, format_number};
use super::trace;
use super::window::TimeWindow;
use crate::bucket::SampleBucket;
use crate::theme::{Glyph, LineCharacters, TextRole};
use crate::widgets::draw::{self, TextAlignment};

/// Minimum width of a name.
const LEAST_NAME: u16 = 9;
/// Width of the sample line with a space.
const SAMPLE: u16 = 3;

/// A column of values.
struct LegendValues {
    head: String,
    cells: Vec<String>,
}

impl LegendValues {
    fn width(&self) -> u16 {
        self.cells.iter().chain([&self.head]).map(|text| draw::text_width(text)).max().unwrap_or(0)
    }
}

/// Draws the head and as many series as fit.
pub fn draw_legend(plot: &TimePlot<'_>, places: &PlotAreas, buf: &mut Buffer) {
    let area = places.legend;
    if area.height < 2 {
        return render_names(plot, area, buf);
    }
    let units: Vec<_> = (0..plot.series.len()).map(|index| unit_text(plot, places, index)).collect();
    let units_width = units.iter().map(|unit| draw::text_width(unit)).max().unwrap_or(0);
    let wanted = plot.series.iter().map(|series| draw::text_width(&series.name)).max().unwrap_or(0);
    let mut columns = legend_columns(plot);
    let room_for_names = |columns: &[LegendValues]| {
        let used: u16 =
            columns.iter().map(|column| column.width().saturating_add(2)).fold(0, u16::saturating_add);
        area.width.saturating_sub(SAMPLE + 1).saturating_sub(units_width).saturating_sub(used)
    };
    // The last column is dropped first.
    while room_for_names(&columns) < LEAST_NAME.min(wanted) && columns.pop().is_some() {}
    let names = wanted.min(room_for_names(&columns));
    let quiet = plot.theme.role_style(TextRole::Quiet);
    for (line, y) in (area.top()..area.bottom()).enumerate().take(plot.series.len() + 1) {
        let index = line.checked_sub(1);
        let mut x = area.x;
        if let Some(series) = index.and_then(|index| plot.series.get(index)) {
            let style = plot.theme.role_style(series.role);
            draw::put_text(buf, x, y, area.width, &line_sample(plot, line - 1), style);
            let place = Rect { x: x + SAMPLE, y, width: names, height: 1 };
            draw::draw_line(
                buf,
                place,
                &Line::styled(series.name.as_ref(), style),
                TextAlignment::Left,
                plot.theme,
            );
        } else {
            let room = SAMPLE.saturating_add(names);
            draw::put_text(buf, x, y, room.min(area.width), &shared_text(plot), quiet);
        }
        x = x.saturating_add(SAMPLE).saturating_add(names);
        for column in &columns {
            let text = index.map_or(Some(&column.head), |index| column.cells.get(index));
            let style = if index.is_none() { quiet } else { Style::new() };
            let place = Rect { x: x.saturating_add(2), y, width: column.width(), height: 1 };
            let text = Line::styled(text.map_or("", String::as_str), style);
            draw::draw_line(buf, place.intersection(area), &text, TextAlignment::Right, plot.theme);
            x = place.right();
        }
        let unit = index.and_then(|index| units.get(index)).map_or("", String::as_str);
        let room = area.right().saturating_sub(x.saturating_add(1));
        draw::put_text(buf, x.saturating_add(1), y, room, unit, quiet);
    }
}

/// Draws marks and names in one line, without values.
fn render_names(plot: &TimePlot<'_>, area: Rect, buf: &mut Buffer) {
    if area.is_empty() {
        return;
    }
    let mut spans = Vec::new();
    for (index, series) in plot.series.iter().enumerate() {
        let style = plot.theme.role_style(series.role);
        spans.push(Span::styled(format!("{} {}  ", line_sample(plot, index), series.name), style));
    }
    spans.push(Span::styled(shared_text(plot), plot.theme.role_style(TextRole::Quiet)));
    draw::draw_line(buf, area, &Line::from(spans), TextAlignment::Left, plot.theme);
}

/// The legend as text without a width limit.
pub fn legend_text(plot: &TimePlot<'_>) -> String {
    let names = plot.series.iter().map(|series| draw::text_width(&series.name)).max().unwrap_or(0);
    let columns = legend_columns(plot);
    let mut text = String::new();
    let line = |name: &str, cells: Vec<&str>, unit: &str| {
        let mut line = format!("{name}{}", blank_text(names.saturating_sub(draw::text_width(name))));
        for (cell, column) in cells.iter().zip(&columns) {
            line.push_str(&blank_text(
                column.width().saturating_sub(draw::text_width(cell)).saturating_add(2),
            ));
            line.push_str(cell);
        }
        format!("{line} {unit}").trim_end().to_owned()
    };
    text.push_str(&line("", columns.iter().map(|column| column.head.as_str()).collect(), ""));
    for (index, series) in plot.series.iter().enumerate() {
        let cells = columns.iter().map(|column| column.cells.get(index).map_or("", String::as_str)).collect();
        text.push('\n');
        text.push_str(&line(&series.name, cells, &series.unit));
    }
    text
}

fn blank_text(width: u16) -> String {
    " ".repeat(usize::from(width))
}

/// Sample of the line of a series.
fn line_sample(plot: &TimePlot<'_>, series: usize) -> String {
    let mark = series_mark(series);
    match plot.theme.borders() {
        LineCharacters::Unicode if plot.series.len() == 1 => "⠤⠤".to_owned(),
        LineCharacters::Unicode => format!("⠤{mark}"),
        LineCharacters::Ascii => format!("{mark}{mark}"),
    }
}

/// Unit of a series, and the remark that it is not drawn.
fn unit_text(plot: &TimePlot<'_>, places: &PlotAreas, series: usize) -> String {
    let unit = plot.series.get(series).map_or("", |series| series.unit.as_ref());
    let is_drawn = plot.unit_of(series).is_some_and(|unit| places.of_unit(unit).is_some());
    match (is_drawn || plot.visible_range(series).is_none(), unit) {
        (true, unit) => unit.to_owned(),
        (false, "") => "(no room)".to_owned(),
        (false, unit) => format!("{unit} (no room)"),
    }
}

/// Meaning of the character of values on several curves.
fn shared_text(plot: &TimePlot<'_>) -> String {
    let sample = shared_symbol(plot.theme.borders());
    match plot.series.len() {
        ..=1 => String::new(),
        2 => format!("{sample}{sample} both"),
        _ => format!("{sample}{sample} several"),
    }
}

/// The columns; those of the cursors only if they are set.
fn legend_columns(plot: &TimePlot<'_>) -> Vec<LegendValues> {
    let (a, b) = plot.cursors;
    let zero = plot.zero;
    let delta = plot.theme.glyph(Glyph::Delta);
    let time = |time: i64| plot.time_text(time.saturating_sub(zero));
    let mut heads = Vec::new();
    heads.extend(a.map(|a| format!("A {} s", time(a))));
    heads.extend(b.map(|b| format!("B {} s", time(b))));
    heads.extend(a.zip(b).map(|(a, b)| format!("{delta} {} s", plot.time_text(b.saturating_sub(a)))));
    heads.extend(["min".to_owned(), "max".to_owned()]);
    let mut columns: Vec<_> =
        heads.into_iter().map(|head| LegendValues { head, cells: Vec::new() }).collect();
    for series in plot.series {
        let at = |time| value_at(series.points, time, &plot.window);
        let extremes = trace::visible_extremes(series.points, &plot.window);
        let mut values = Vec::new();
        values.extend(a.map(at));
        values.extend(b.map(at));
        values.extend(a.zip(b).map(|(a, b)| Some(at(b)? - at(a)?)));
        values.extend([extremes.map(|(low, _)| low), extremes.map(|(_, high)| high)]);
        let known: Vec<_> = values.iter().copied().flatten().collect();
        let decimals = decimals_for(&known);
        let none = if plot.theme.borders() == LineCharacters::Unicode { "–" } else { "-" };
        let text = |value: Option<f64>| {
            value
                .filter(|value| !value.is_nan())
                .map_or(none.to_owned(), |value| format_number(value, decimals))
        };
        for (column, value) in columns.iter_mut().zip(values) {
            column.cells.push(text(value));
        }
    }
    columns
}

/// The value that applies at a time.
fn value_at(points: &[SampleBucket], time: i64, window: &TimeWindow) -> Option<f64> {
    let behind = points.partition_point(|bucket| bucket.t <= time);
    let bucket = points.get(behind.checked_sub(1)?)?;
    (time <= window.until && !window.is_gap(bucket.t, time)).then_some(bucket.last)
}
