//! Plots as inline SVG.

use std::fmt::Write as _;

use maud::{Markup, html};

use crate::report::model::{ClaimPlot, PlotAxis, SignalCurve};

/// Size of a plot, and margins around its area, in units of the view box.
const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 190.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 18.0;
const BOTTOM: f64 = 34.0;

/// Minimum distance between the numbers of two facts, and half the width of a digit.
const APART: f64 = 12.0;
const LETTER: f64 = 3.5;

/// Desired number of ticks per axis.
const TICKS: f64 = 6.0;

/// Maps positions and values to the view box.
struct ViewBoxScale {
    x: (f64, f64),
    y: (f64, f64),
}

impl ViewBoxScale {
    fn scale_of(plot: &ClaimPlot) -> Self {
        let values = || plot.curves.iter().flat_map(|curve| &curve.points).map(|(_, value)| *value);
        let low = values().fold(f64::INFINITY, f64::min);
        let high = values().fold(f64::NEG_INFINITY, f64::max);
        let room = if high > low { (high - low) * 0.06 } else { high.abs().max(1.0) * 0.1 };
        let (from, to) = plot.range;
        Self { x: (from, if to > from { to } else { from + 1.0 }), y: (low - room, high + room) }
    }

    fn x(&self, at: f64) -> f64 {
        LEFT + (at - self.x.0) / (self.x.1 - self.x.0) * (WIDTH - LEFT - RIGHT)
    }

    fn y(&self, value: f64) -> f64 {
        HEIGHT - BOTTOM - (value - self.y.0) / (self.y.1 - self.y.0) * (HEIGHT - TOP - BOTTOM)
    }
}

/// A figure with its legend.
pub(super) fn render_plot(plot: &ClaimPlot) -> Markup {
    let scale = ViewBoxScale::scale_of(plot);
    let (left, right) = (format_coordinate(LEFT), format_coordinate(WIDTH - RIGHT));
    let (top, bottom) = (format_coordinate(TOP), format_coordinate(HEIGHT - BOTTOM));
    html! {
        figure {
            svg viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img" aria-label=(plot_description(plot)) {
                @for value in round_ticks(scale.y) {
                    line.grid x1=(left) x2=(right) y1=(format_coordinate(scale.y(value))) y2=(format_coordinate(scale.y(value))) {}
                    text x=(format_coordinate(LEFT - 6.0)) y=(format_coordinate(scale.y(value) + 4.0)) text-anchor="end" { (format_number(value)) }
                }
                @for at in round_ticks(scale.x) {
                    line.grid x1=(format_coordinate(scale.x(at))) x2=(format_coordinate(scale.x(at))) y1=(top) y2=(bottom) {}
                    text x=(format_coordinate(scale.x(at))) y=(format_coordinate(HEIGHT - BOTTOM + 14.0)) text-anchor="middle" { (format_number(at)) }
                }
                path.axis d=(format!("M{left} {top}V{bottom}H{right}")) {}
                text x=(right) y=(format_coordinate(HEIGHT - 4.0)) text-anchor="end" { (axis_title(plot)) }
                @if !plot.unit.is_empty() {
                    text x="4" y=(format_coordinate(TOP - 6.0)) { (plot.unit) }
                }
                @for (place, curve) in plot.curves.iter().enumerate() {
                    path class=(curve_class(place)) d=(curve_path(curve, &scale)) {}
                }
                (render_marks(plot, &scale))
            }
            figcaption {
                ul.legend {
                    @for (place, curve) in plot.curves.iter().enumerate() {
                        li {
                            svg viewBox="0 0 40 12" aria-hidden="true" { path class=(curve_class(place)) d="M1 6H39" {} }
                            (curve.name)
                            @if !plot.unit.is_empty() { " [" (plot.unit) "]" }
                            span.quiet { ", " (curve.source) }
                        }
                    }
                }
            }
        }
    }
}

/// Lines at the facts of the story; numbers of close facts share one label.
fn render_marks(plot: &ClaimPlot, scale: &ViewBoxScale) -> Markup {
    let mut labels: Vec<(f64, String)> = Vec::new();
    let is_inside = |at: f64| scale.x.0 <= at && at <= scale.x.1;
    let mut inside: Vec<_> = plot.marks.iter().filter(|mark| is_inside(mark.at)).collect();
    inside.sort_by(|one, other| one.at.total_cmp(&other.at).then(one.number.cmp(&other.number)));
    for mark in &inside {
        let at = scale.x(mark.at);
        match labels.last_mut() {
            Some((last, text)) if at - *last < APART + LETTER * label_width(text) => {
                let _ = write!(text, ",{}", mark.number);
            }
            _ => labels.push((at, mark.number.to_string())),
        }
    }
    html! {
        @for mark in &inside {
            @let at = format_coordinate(scale.x(mark.at));
            line.mark x1=(at) x2=(at) y1=(format_coordinate(TOP)) y2=(format_coordinate(HEIGHT - BOTTOM)) {}
        }
        @for (at, text) in &labels {
            text.marked x=(format_coordinate(*at)) y=(format_coordinate(TOP - 5.0)) text-anchor="middle" { (text) }
        }
    }
}

/// Number of characters of a label.
fn label_width(text: &str) -> f64 {
    f64::from(u16::try_from(text.len()).unwrap_or(u16::MAX))
}

/// Steps: a value holds until the next one.
fn curve_path(curve: &SignalCurve, scale: &ViewBoxScale) -> String {
    let mut path = String::new();
    for (at, value) in &curve.points {
        let (x, y) = (format_coordinate(scale.x(*at)), format_coordinate(scale.y(*value)));
        let _ = if path.is_empty() { write!(path, "M{x} {y}") } else { write!(path, "H{x}V{y}") };
    }
    path
}

const fn curve_class(place: usize) -> &'static str {
    match place {
        0 => "curve c1",
        1 => "curve c2",
        _ => "curve c3",
    }
}

const fn axis_title(plot: &ClaimPlot) -> &'static str {
    match plot.axis {
        PlotAxis::Seconds => "s after the first frame",
        PlotAxis::Frames => "number of the frame",
    }
}

/// The plot in words.
fn plot_description(plot: &ClaimPlot) -> String {
    let (from, to) = plot.range;
    let mut text =
        format!("Plot from {} to {} {}.", format_number(from), format_number(to), axis_title(plot));
    for curve in &plot.curves {
        let values = || curve.points.iter().map(|(_, value)| *value);
        let low = values().fold(f64::INFINITY, f64::min);
        let high = values().fold(f64::NEG_INFINITY, f64::max);
        let unit = &plot.unit;
        let _ = write!(text, " {}: {} to {} {unit}", curve.name, format_number(low), format_number(high));
        for mark in &plot.marks {
            let before = curve.points.iter().rev().find(|(at, _)| *at <= mark.at);
            if let Some((_, value)) = before {
                let _ = write!(text, ", {} at fact {}", format_number(*value), mark.number);
            }
        }
        text.push('.');
    }
    text
}

/// Round positions within a range, about [`TICKS`] of them.
fn round_ticks((from, to): (f64, f64)) -> Vec<f64> {
    let rough = (to - from) / TICKS;
    if !rough.is_finite() || rough <= 0.0 {
        return Vec::new();
    }
    let power = 10_f64.powf(rough.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0];
    let step = steps.into_iter().map(|factor| factor * power).find(|step| *step >= rough);
    let step = step.unwrap_or(power * 10.0);
    let first = (from / step).ceil();
    let places = (0..20_u8).map(|place| (first + f64::from(place)) * step);
    places.take_while(|at| *at <= to + step * 1e-6).collect()
}

/// A coordinate with one decimal.
fn format_coordinate(value: f64) -> String {
    format!("{value:.1}")
}

/// A value with up to three decimals.
fn format_number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round() {
        assert_eq!(round_ticks((2.204, 12.204)), [4.0, 6.0, 8.0, 10.0, 12.0]);
        assert_eq!(round_ticks((-0.5, 1.0)), [-0.5, 0.0, 0.5, 1.0]);
        assert!(round_ticks((1.0, 1.0)).is_empty() && round_ticks((0.0, f64::INFINITY)).is_empty());
    }

    #[test]
    fn numbers_have_no_needless_digits() {
        assert_eq!(
            [format_number(0.1 + 0.2), format_number(-0.0), format_number(12.5), format_number(315.0)],
            ["0.3", "0", "12.5", "315"]
        );
    }

    #[test]
    fn values_hold_until_the_next_one() {
        let scale = ViewBoxScale { x: (0.0, 10.0), y: (0.0, 1.0) };
        let curve =
            SignalCurve { name: String::new(), source: String::new(), points: vec![(0.0, 0.0), (10.0, 1.0)] };
        assert_eq!(curve_path(&curve, &scale), "M58.0 156.0H706.0V18.0");
    }
}
