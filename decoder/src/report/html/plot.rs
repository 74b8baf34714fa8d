//! Plots as inline SVG.

use std::fmt::Write as _;

use maud::{Markup, html};

use crate::report::model::{Curve, Plot, PlotAxis};

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
struct Scale {
    x: (f64, f64),
    y: (f64, f64),
}

impl Scale {
    fn of(plot: &Plot) -> Self {
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
pub(super) fn plot(plot: &Plot) -> Markup {
    let scale = Scale::of(plot);
    let (left, right) = (one(LEFT), one(WIDTH - RIGHT));
    let (top, bottom) = (one(TOP), one(HEIGHT - BOTTOM));
    html! {
        figure {
            svg viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img" aria-label=(description(plot)) {
                @for value in ticks(scale.y) {
                    line.grid x1=(left) x2=(right) y1=(one(scale.y(value))) y2=(one(scale.y(value))) {}
                    text x=(one(LEFT - 6.0)) y=(one(scale.y(value) + 4.0)) text-anchor="end" { (number(value)) }
                }
                @for at in ticks(scale.x) {
                    line.grid x1=(one(scale.x(at))) x2=(one(scale.x(at))) y1=(top) y2=(bottom) {}
                    text x=(one(scale.x(at))) y=(one(HEIGHT - BOTTOM + 14.0)) text-anchor="middle" { (number(at)) }
                }
                path.axis d=(format!("M{left} {top}V{bottom}H{right}")) {}
                text x=(right) y=(one(HEIGHT - 4.0)) text-anchor="end" { (axis(plot)) }
                @if !plot.unit.is_empty() {
                    text x="4" y=(one(TOP - 6.0)) { (plot.unit) }
                }
                @for (place, curve) in plot.curves.iter().enumerate() {
                    path class=(class(place)) d=(path(curve, &scale)) {}
                }
                (marks(plot, &scale))
            }
            figcaption {
                ul.legend {
                    @for (place, curve) in plot.curves.iter().enumerate() {
                        li {
                            svg viewBox="0 0 40 12" aria-hidden="true" { path class=(class(place)) d="M1 6H39" {} }
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
fn marks(plot: &Plot, scale: &Scale) -> Markup {
    let mut labels: Vec<(f64, String)> = Vec::new();
    let is_inside = |at: f64| scale.x.0 <= at && at <= scale.x.1;
    let mut inside: Vec<_> = plot.marks.iter().filter(|mark| is_inside(mark.at)).collect();
    inside.sort_by(|one, other| one.at.total_cmp(&other.at).then(one.number.cmp(&other.number)));
    for mark in &inside {
        let at = scale.x(mark.at);
        match labels.last_mut() {
            Some((last, text)) if at - *last < APART + LETTER * count(text) => {
                let _ = write!(text, ",{}", mark.number);
            }
            _ => labels.push((at, mark.number.to_string())),
        }
    }
    html! {
        @for mark in &inside {
            @let at = one(scale.x(mark.at));
            line.mark x1=(at) x2=(at) y1=(one(TOP)) y2=(one(HEIGHT - BOTTOM)) {}
        }
        @for (at, text) in &labels {
            text.marked x=(one(*at)) y=(one(TOP - 5.0)) text-anchor="middle" { (text) }
        }
    }
}

/// Number of characters of a label.
fn count(text: &str) -> f64 {
    f64::from(u16::try_from(text.len()).unwrap_or(u16::MAX))
}

/// Steps: a value holds until the next one.
fn path(curve: &Curve, scale: &Scale) -> String {
    let mut path = String::new();
    for (at, value) in &curve.points {
        let (x, y) = (one(scale.x(*at)), one(scale.y(*value)));
        let _ = if path.is_empty() { write!(path, "M{x} {y}") } else { write!(path, "H{x}V{y}") };
    }
    path
}

const fn class(place: usize) -> &'static str {
    match place {
        0 => "curve c1",
        1 => "curve c2",
        _ => "curve c3",
    }
}

const fn axis(plot: &Plot) -> &'static str {
    match plot.axis {
        PlotAxis::Seconds => "s after the first frame",
        PlotAxis::Frames => "number of the frame",
    }
}

/// The plot in words.
fn description(plot: &Plot) -> String {
    let (from, to) = plot.range;
    let mut text = format!("Plot from {} to {} {}.", number(from), number(to), axis(plot));
    for curve in &plot.curves {
        let values = || curve.points.iter().map(|(_, value)| *value);
        let low = values().fold(f64::INFINITY, f64::min);
        let high = values().fold(f64::NEG_INFINITY, f64::max);
        let unit = &plot.unit;
        let _ = write!(text, " {}: {} to {} {unit}", curve.name, number(low), number(high));
        for mark in &plot.marks {
            let before = curve.points.iter().rev().find(|(at, _)| *at <= mark.at);
            if let Some((_, value)) = before {
                let _ = write!(text, ", {} at fact {}", number(*value), mark.number);
            }
        }
        text.push('.');
    }
    text
}

/// Round positions within a range, about [`TICKS`] of them.
fn ticks((from, to): (f64, f64)) -> Vec<f64> {
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
fn one(value: f64) -> String {
    format!("{value:.1}")
}

/// A value with up to three decimals.
fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round() {
        assert_eq!(ticks((2.204, 12.204)), [4.0, 6.0, 8.0, 10.0, 12.0]);
        assert_eq!(ticks((-0.5, 1.0)), [-0.5, 0.0, 0.5, 1.0]);
        assert!(ticks((1.0, 1.0)).is_empty() && ticks((0.0, f64::INFINITY)).is_empty());
    }

    #[test]
    fn numbers_have_no_needless_digits() {
        assert_eq!(
            [number(0.1 + 0.2), number(-0.0), number(12.5), number(315.0)],
            ["0.3", "0", "12.5", "315"]
        );
    }

    #[test]
    fn values_hold_until_the_next_one() {
        let scale = Scale { x: (0.0, 10.0), y: (0.0, 1.0) };
        let curve =
            Curve { name: String::new(), source: String::new(), points: vec![(0.0, 0.0), (10.0, 1.0)] };
        assert_eq!(path(&curve, &scale), "M58.0 156.0H706.0V18.0");
    }
}
