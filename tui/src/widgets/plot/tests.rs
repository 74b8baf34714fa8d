//! Tests of complete plots as text.

use super::*;
use crate::bucket::SampleBucket;
use crate::widgets::draw::tests::{buffer_lines, in_every_small_size, plain_theme};

const MILLISECOND: i64 = 1_000_000;

fn values(values: &[(i64, f64)]) -> Vec<SampleBucket> {
    values
        .iter()
        .map(|(t, value)| SampleBucket { t: t * MILLISECOND, min: *value, max: *value, last: *value })
        .collect()
}

fn series<'a>(name: &'a str, unit: &'a str, look: u8, points: &'a [SampleBucket]) -> PlotSeries<'a> {
    PlotSeries { name: name.into(), unit: unit.into(), role: TextRole::Highlight(look), points }
}

fn drawn(plot: TimePlot<'_>, width: u16, height: u16) -> Vec<String> {
    let mut buf = Buffer::empty(Rect::new(0, 0, width, height));
    plot.render(buf.area, &mut buf);
    buffer_lines(&buf)
}

fn ends(from: i64, to: i64) -> (i64, i64) {
    (from * MILLISECOND, to * MILLISECOND - 1)
}

#[test]
fn a_line_with_axes_cursor_and_legend() {
    let pressure = values(&[(0, 124.0), (500, 130.0), (1000, 121.0), (1500, 121.5)]);
    let series = [series("pressure", "bar", 0, &pressure)];
    let (from, to) = ends(0, 2000);
    let theme = plain_theme(LineCharacters::Unicode);
    let plot = TimePlot::new(&theme, &series, from, to).with_cursors(Some(700 * MILLISECOND), None);
    assert_eq!(
        drawn(plot, 44, 12),
        [
            "bar               A",
            "130┤          ⡏⠉⠉⠉⠉⠉⠉⠉⠉⠉⡇",
            "   │          ⡇   ┆     ⡇",
            "   │          ⡇   ┆     ⡇",
            "125┤          ⡇   ┆     ⡇",
            "   │⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠁   ┆     ⡇",
            "   │              ┆     ⡇         ⣀⣀⣀⣀⣀⣀⣀⣀⣀⣀",
            "120┤              ┆     ⠉⠉⠉⠉⠉⠉⠉⠉⠉⠉⠁",
            "   └┬─────────┬─────────┬─────────┬─────────",
            "   0.0       0.5       1.0       1.5       s",
            "             A 0.70 s  min  max",
            "⠤⠤ pressure       130  121  130 bar",
        ]
    );
}

#[test]
fn two_units_have_two_axes_and_a_third_its_own_part() {
    let pressure = values(&[(0, 124.0), (500, 130.0), (1000, 121.0), (1500, 121.5)]);
    let set = values(&[(200, 0.0), (1200, 50.0)]);
    let series = [
        series("pressure", "bar", 0, &pressure),
        series("set point", "%", 1, &set),
        series("speed", "", 2, &set),
    ];
    let (from, to) = ends(0, 2000);
    let theme = plain_theme(LineCharacters::Ascii);
    let plot = TimePlot::new(&theme, &series, from, to);
    assert_eq!(
        drawn(plot.with_cursors(Some(700 * MILLISECOND), Some(1600 * MILLISECOND)), 70, 14),
        [
            "bar                       A                           B              %",
            "130+               ****************|     oooooooooooooooooooooooooo+50",
            "125+***************|      :        |     |            :            |",
            "120+      ooooooooooooooooooooooooo======|*************************+0",
            "                          :                           :",
            " 50+                      :              xxxxxxxxxxxxxxxxxxxxxxxxxx",
            "   |                      :              |            :",
            "  0+      xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx|            :",
            "   ++--------------+---------------+---------------+---------------",
            "   0.0            0.5             1.0             1.5             s",
            "== several    A 0.70 s  B 1.60 s  d 0.90 s    min    max",
            "** pressure      130.0     121.5      -8.5  121.0  130.0 bar",
            "oo set point         0        50        50      0     50 %",
            "xx speed             0        50        50      0     50",
        ]
    );
    // A high plot has a part for each unit, a low one has no room for the third.
    let high = drawn(plot, 70, 30);
    let axes = ["bar", "%", "", "   ++---"];
    let rows: Vec<_> = [0, 8, 16, 24].into_iter().map(|row: usize| high[row].as_str()).collect();
    assert!(rows.iter().zip(axes).all(|(row, axis)| row.starts_with(axis)), "{}", high.join("\n"));
    assert_eq!(plot.units_without_room(Rect::new(0, 0, 70, 30)), 0);
    assert_eq!(plot.units_without_room(Rect::new(0, 0, 70, 8)), 1);
    let low = drawn(plot, 70, 9);
    assert_eq!(low[8], "** pressure  oo set point  xx speed  == several");
}

#[test]
fn series_of_one_unit_share_its_scale() {
    let (set, position) = (values(&[(0, 37.5)]), values(&[(0, 37.5), (1_000, 12.0)]));
    let series = [series("set point", "%", 0, &set), series("position", "%", 1, &position)];
    let (from, to) = ends(0, 2000);
    let theme = plain_theme(LineCharacters::Ascii);
    let plot = TimePlot::new(&theme, &series, from, to);
    assert_eq!(
        drawn(plot, 44, 13),
        [
            "%",
            "40+====================|********************",
            "  |                    |",
            "  |                    |",
            "20+                    |",
            "  |                    ooooooooooooooooooooo",
            "  |",
            " 0+",
            "  ++---------+---------+---------+----------",
            "  0.0       0.5       1.0       1.5        s",
            "== both        min   max",
            "** set point  37.5  37.5 %",
            "oo position   12.0  37.5 %",
        ]
    );
}

#[test]
fn marks_are_above_the_plot_and_later_ones_cover_earlier_ones() {
    let set = values(&[(0, 10.0), (500, 20.0)]);
    let series = [series("set point", "%", 0, &set)];
    let (from, to) = ends(0, 1000);
    let mark = |from, to, symbol| TimeMark {
        from: from * MILLISECOND,
        to: to * MILLISECOND,
        symbol,
        role: TextRole::Bad,
    };
    // Outside the window, across its end, and within it.
    let marks = [
        mark(-50, -10, "x"),
        mark(800, 5_000, "w"),
        mark(900, 900, "E"),
        mark(0, 0, "N"),
        mark(9_000, 9_000, "x"),
    ];
    let theme = plain_theme(LineCharacters::Ascii);
    let plot = TimePlot::new(&theme, &series, from, to).with_marks(&marks);
    let rows = drawn(plot, 45, 8);
    assert_eq!(rows[..2], ["find N                               wwwwEwww", "%"]);
    // Below this height the row is dropped.
    assert_eq!(drawn(plot, 45, 5)[0], "%");
    let none = TimePlot::new(&theme, &series, from, to).with_marks(&[]);
    assert_eq!(drawn(none, 45, 8)[0], "find");
}

#[test]
fn times_count_from_the_zero_that_was_given() {
    let set = values(&[(9_000, 10.0), (10_050, 20.0)]);
    let series = [series("set point", "", 0, &set)];
    let (from, to) = ends(10_000, 10_100);
    let theme = plain_theme(LineCharacters::Ascii);
    let plot = TimePlot::new(&theme, &series, from, to).with_zero(8_000 * MILLISECOND);
    assert_eq!(
        drawn(plot, 44, 6),
        [
            "",
            "20+                    *....................",
            "15+                    |",
            "10+....................|",
            "  ++-------------------+--------------------",
            " 2.00                2.05                  s",
        ]
    );
    // The capture ends within the window.
    assert_eq!(drawn(plot.with_end(10_060 * MILLISECOND), 44, 6)[1], "20+                    *....");
    // A value applies no longer than this: the left side is empty.
    assert_eq!(
        drawn(plot.with_gap(Some(200 * MILLISECOND)), 44, 6)[1..4],
        ["22+", "20+                    *....................", "18+"]
    );
}

#[test]
fn where_there_is_little_room_axes_and_legend_give_way() {
    let set = values(&[(0, 10.0), (1, 20.0)]);
    let series = [series("set point", "%", 0, &set)];
    let (from, to) = ends(0, 2);
    let theme = plain_theme(LineCharacters::Ascii);
    let plot = TimePlot::new(&theme, &series, from, to);
    assert_eq!(drawn(plot, 8, 4), ["    *...", "    |", "    |", "*...|"]);
    assert_eq!(drawn(plot, 10, 5), ["", "     *....", "*....|", "+---------", "0.000    s"]);
}

#[test]
fn nothing_to_draw() {
    let (theme, none) = (plain_theme(LineCharacters::Unicode), values(&[(5, f64::NAN), (6, f64::INFINITY)]));
    let plot = TimePlot::new(&theme, &[], 0, 100).with_empty_text("no signal chosen");
    assert_eq!(drawn(plot, 12, 2), ["no signal c…", ""]);
    let series = [series("x", "", 0, &none), series("y", "", 0, &[])];
    let plot = TimePlot::new(&theme, &series, 0, 10 * MILLISECOND).with_empty_text("no values here");
    assert_eq!(drawn(plot, 20, 2), ["no values here", ""]);
}

#[test]
fn clicks_find_times() {
    let set = values(&[(0, 10.0), (1, 20.0)]);
    let series = [series("set point", "%", 0, &set)];
    let theme = plain_theme(LineCharacters::Unicode);
    let plot = TimePlot::new(&theme, &series, 100, 299);
    let area = Rect::new(5, 5, 23, 10);
    // "20" and the axis take three columns.
    assert_eq!(plot.dot_columns(area), 40);
    let times = [7, 8, 9, 27, 28].map(|x| plot.time_at(area, x));
    assert_eq!(times, [None, Some(100), Some(110), Some(290), None]);
    assert_eq!(TimePlot::new(&theme, &series, i64::MIN, i64::MAX).time_at(area, 8), Some(i64::MIN));
    assert_eq!(TimePlot::new(&theme, &series, 5, 5).time_at(area, 27), Some(5));
    assert_eq!(TimePlot::new(&theme, &series, 9, 5).time_at(area, 27), Some(9));
}

#[test]
fn series_have_their_looks() {
    let (low, high) = (values(&[(0, 0.0)]), values(&[(0, 10.0)]));
    let series = [series("low", "", 0, &low), series("high", "", 1, &high)];
    let theme = plain_theme(LineCharacters::Unicode);
    let mut buf = Buffer::empty(Rect::new(0, 0, 20, 4));
    TimePlot::new(&theme, &series, 0, 100).render(buf.area, &mut buf);
    assert_eq!(buffer_lines(&buf), ["⠉⠉⠉o⠉⠉⠉⠉⠉⠉⠉o⠉⠉⠉⠉⠉⠉⠉o", "", "", "*⣀⣀⣀⣀⣀⣀⣀*⣀⣀⣀⣀⣀⣀⣀*⣀⣀⣀"]);
    let looks = [3, 0].map(|y| buf[(4, y)].modifier);
    assert_eq!(looks, [0, 1].map(|look| theme.role_style(TextRole::Highlight(look)).add_modifier));
}

#[test]
fn every_small_size_and_strange_value() {
    let strange: Vec<_> = [f64::MIN, f64::MAX, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 5e-324, 0.0]
        .into_iter()
        .enumerate()
        .map(|(t, value)| SampleBucket { t: i64::try_from(t).unwrap(), min: -value, max: value, last: value })
        .collect();
    let series = [
        series("日本語", "bar", 0, &strange),
        series("b", "°C", 9, &strange[1..]),
        series("c", "", 1, &strange[3..4]),
    ];
    for borders in [LineCharacters::Unicode, LineCharacters::Ascii] {
        let theme = plain_theme(borders);
        for (from, to) in
            [(0, 6), (i64::MIN, i64::MAX), (3, 3), (i64::MAX, i64::MIN), (i64::MAX - 1, i64::MAX)]
        {
            let plot = TimePlot::new(&theme, &series, from, to)
                .with_cursors(Some(2), Some(i64::MAX))
                .with_zero(i64::MIN);
            in_every_small_size(|area, buf| {
                plot.render(area, buf);
                let _ = (plot.time_at(area, 3), plot.dot_columns(area));
            });
            let mut buf = Buffer::empty(Rect::new(0, 0, 200, 60));
            plot.render(buf.area, &mut buf);
        }
    }
}

#[test]
fn columns_are_counted_from_a_time() {
    let set = values(&[(0, 10.0), (50, 20.0)]);
    let series = [series("set point", "", 0, &set)];
    let (from, to) = ends(0, 100);
    let theme = plain_theme(LineCharacters::Ascii);
    let plot = TimePlot::new(&theme, &series, from, to);
    // Labels and axis take three columns, which leaves 50 of 2 ms each.
    let area = Rect::new(0, 0, 53, 6);
    assert_eq!(plot.time_beside(area, 9 * MILLISECOND, 0), 10 * MILLISECOND - 1);
    assert_eq!(plot.time_beside(area, 9 * MILLISECOND, 1), 12 * MILLISECOND - 1);
    assert_eq!(plot.time_beside(area, 9 * MILLISECOND, -1), 8 * MILLISECOND - 1);
    assert_eq!(plot.time_beside(area, to, 0), to);
    assert_eq!(plot.time_beside(area, to, 1), to + 2 * MILLISECOND);
    assert_eq!(plot.time_beside(area, from, -1), from - 2 * MILLISECOND);
}

#[test]
fn a_column_is_found_again_by_its_times() {
    let set = values(&[(0, 10.0), (50, 20.0)]);
    let series = [series("set point", "", 0, &set)];
    let theme = plain_theme(LineCharacters::Ascii);
    // 1,000 ns cannot be divided into 47 columns.
    let plot = TimePlot::new(&theme, &series, 5, 1_004);
    let area = Rect::new(0, 0, 47, 4);
    for x in 0..47 {
        let first = plot.time_at(area, x).unwrap();
        let last = plot.time_beside(area, first, 0);
        let column = |time| plot.window.column_of(time, 47);
        assert_eq!((column(first), column(last)), (i64::from(x), i64::from(x)));
        assert!(x == 0 || column(first - 1) == i64::from(x) - 1);
    }
}

#[test]
fn the_legend_can_be_had_as_text() {
    let pressure = values(&[(0, 124.0), (500, 130.0)]);
    let set = values(&[(200, 0.0), (1200, 50.0)]);
    let series = [series("pressure", "bar", 0, &pressure), series("set", "%", 1, &set)];
    let (from, to) = ends(0, 2000);
    let theme = plain_theme(LineCharacters::Unicode);
    let plot = TimePlot::new(&theme, &series, from, to).with_cursors(Some(700 * MILLISECOND), None);
    assert_eq!(
        plot.legend_text(),
        "          A 0.70 s  min  max\npressure       130  124  130 bar\nset              0    0   50 %"
    );
}
