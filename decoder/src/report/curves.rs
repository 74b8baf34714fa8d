//! Curves of the signals around a claim, in bounded memory.

use super::model::{ClaimPlot, PlotMark, SignalCurve};
use super::window::ClaimWindow;
use crate::event::{Event, EventKind};
use crate::frame::{BusIndex, Timestamp};
use crate::profile::{DecodedSignal, PayloadLayout, SignalField, SignalId};
use crate::wire::NodeId;

/// Maximum number of signals observed per claim.
const MOST_SIGNALS: usize = 96;

/// Maximum number of plots per claim.
const MOST_PLOTS: usize = 3;

/// Maximum number of signals per plot.
const MOST_CURVES: usize = 3;

/// Number of sections of the horizontal axis; each keeps its first, lowest, highest and last value.
const SECTIONS: usize = 240;

/// Signals of the nodes of a claim.
#[derive(Debug, Clone)]
pub(super) struct ClaimCurves {
    window: ClaimWindow,
    zero: Option<Timestamp>,
    range: (f64, f64),
    bus: BusIndex,
    nodes: Vec<NodeId>,
    /// Objects and names in the findings of the claim.
    subjects: Vec<String>,
    /// Text of the story, which may name signals.
    text: String,
    all: Vec<SignalSamples>,
}

/// Values of one signal.
#[derive(Debug, Clone)]
struct SignalSamples {
    source: String,
    id: SignalId,
    bit: u16,
    name: String,
    unit: String,
    is_assumed: bool,
    is_quantity: bool,
    is_subject: bool,
    changes: u32,
    sections: Vec<AxisSection>,
}

/// Values in one section of the horizontal axis.
#[derive(Debug, Clone, Copy)]
struct AxisSection {
    place: usize,
    first: (f64, f64),
    least: (f64, f64),
    most: (f64, f64),
    last: (f64, f64),
}

impl ClaimCurves {
    /// No values yet. `range` is the part of the axis to draw.
    pub(super) fn new(
        (window, zero): (ClaimWindow, Option<Timestamp>),
        range: (f64, f64),
        (bus, nodes): (BusIndex, Vec<NodeId>),
        (subjects, text): (Vec<String>, String),
    ) -> Self {
        Self { window, zero, range, bus, nodes, subjects, text, all: Vec::new() }
    }

    /// Takes an event of the capture.
    pub(super) fn take_event(&mut self, event: &Event) {
        let is_meant = event.bus == self.bus
            && (self.nodes.is_empty() || event.node.is_none_or(|node| self.nodes.contains(&node)))
            && self.window.contains(event.time, event.frames.last);
        if !is_meant {
            return;
        }
        let Some((layout, payload)) = event.laid_out() else { return };
        let Some(at) = self.window.axis_position(event.time, event.frames.last, self.zero) else { return };
        let source = source_name(event);
        for signal in layout.decode_signals(payload) {
            if let Some(value) = signal.field.plot_number(&signal.value).filter(|value| value.is_finite()) {
                self.add_signal(&source, layout, &signal, (at, value));
            }
        }
    }

    fn add_signal(
        &mut self,
        source: &str,
        layout: &PayloadLayout,
        signal: &DecodedSignal<'_>,
        point: (f64, f64),
    ) {
        let (from, to) = self.range;
        let place = section_of(point.0, from, to);
        let field = signal.field;
        let known = self.all.iter_mut().find(|known| known.is_of(source, field));
        if let Some(known) = known {
            known.is_assumed |= is_assumed(layout, field);
            return known.add_sample(place, point);
        }
        if self.all.len() >= MOST_SIGNALS {
            return;
        }
        let mut samples = SignalSamples::new(source, field, is_assumed(layout, field));
        let id = field.id.to_string();
        let is_named = samples.name.chars().count() > 4 && self.text.contains(&samples.name);
        samples.is_subject = is_named || (!id.is_empty() && self.subjects.contains(&id));
        samples.add_sample(place, point);
        self.all.push(samples);
    }

    /// Plots of the most relevant signals: those that the findings name, then those that change.
    pub(super) fn build_plots(mut self, marks: &[PlotMark]) -> Vec<ClaimPlot> {
        self.all.retain(|it| it.sections.len() > 1 && it.is_quantity && (it.changes > 0 || it.is_subject));
        self.all.sort_by_key(|it| (!it.is_subject, it.unit.is_empty(), std::cmp::Reverse(it.changes.min(8))));
        let mut plots: Vec<ClaimPlot> = Vec::new();
        for samples in self.all {
            let unit = samples.unit.clone();
            let curve = samples.build_curve();
            let has_room = plots.len() < MOST_PLOTS;
            match plots.iter_mut().find(|plot| plot.unit == unit && plot.curves.len() < MOST_CURVES) {
                Some(plot) => plot.curves.push(curve),
                None if has_room => plots.push(ClaimPlot {
                    unit,
                    axis: self.window.axis_unit(),
                    range: self.range,
                    curves: vec![curve],
                    marks: marks.to_vec(),
                }),
                None => {}
            }
        }
        plots
    }
}

impl SignalSamples {
    fn new(source: &str, field: &SignalField, is_assumed: bool) -> Self {
        let meaning = field.meaning.as_deref();
        let name = match (field.name(), field.id) {
            (Some(name), _) => name.to_owned(),
            (None, SignalId::Name) => format!("bit {}", field.bit),
            (None, id) => id.to_string(),
        };
        // A word of bits or a state is described by the story; as a number it has no scale.
        let is_quantity = meaning.is_some_and(|it| it.bits.is_none() && it.values.is_none());
        Self {
            source: source.to_owned(),
            id: field.id,
            bit: field.bit,
            name,
            unit: meaning.map_or_else(String::new, |meaning| meaning.unit.clone()),
            is_assumed,
            is_quantity,
            is_subject: false,
            changes: 0,
            sections: Vec::new(),
        }
    }

    fn is_of(&self, source: &str, field: &SignalField) -> bool {
        let unit = field.meaning.as_deref().map_or("", |meaning| meaning.unit.as_str());
        let is_named = field.id != SignalId::Name || field.name().is_none_or(|name| name == self.name);
        self.id == field.id && self.bit == field.bit && is_named && self.source == source && self.unit == unit
    }

    fn add_sample(&mut self, place: usize, point: (f64, f64)) {
        let before = self.sections.last().map(|section| section.last.1);
        if before.is_some_and(|before| (before - point.1).abs() > f64::EPSILON) {
            self.changes = self.changes.saturating_add(1);
        }
        let has_room = self.sections.len() <= SECTIONS;
        match self.sections.last_mut() {
            Some(section) if section.place >= place => {
                section.last = point;
                if point.1 < section.least.1 {
                    section.least = point;
                }
                if point.1 > section.most.1 {
                    section.most = point;
                }
            }
            _ if has_room => {
                self.sections.push(AxisSection {
                    place,
                    first: point,
                    least: point,
                    most: point,
                    last: point,
                });
            }
            _ => {}
        }
    }

    fn build_curve(self) -> SignalCurve {
        let mut points = Vec::new();
        for section in self.sections {
            let mut own = [section.first, section.least, section.most, section.last];
            own.sort_by(|one, other| one.0.total_cmp(&other.0));
            for point in own {
                if points.last() != Some(&point) {
                    points.push(point);
                }
            }
        }
        let mark = if self.is_assumed { "?" } else { "" };
        SignalCurve { name: format!("{}{mark}", self.name), source: self.source, points }
    }
}

/// Section of a position, 0 to [`SECTIONS`].
fn section_of(at: f64, from: f64, to: f64) -> usize {
    #[expect(clippy::cast_precision_loss, reason = "a small constant")]
    let part = (at - from) / (to - from).max(f64::EPSILON) * SECTIONS as f64;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates")]
    let place = part as usize;
    place.min(SECTIONS)
}

fn is_assumed(layout: &PayloadLayout, field: &SignalField) -> bool {
    layout.assumed || field.meaning.as_deref().is_some_and(|meaning| meaning.assumed)
}

/// `TPDO1 of node 2/02`.
fn source_name(event: &Event) -> String {
    let of = event.node.map_or_else(String::new, |node| format!(" of {}", node.sentence_label()));
    match &event.kind {
        EventKind::Pdo(pdo) => format!("{}{of}", pdo.name),
        EventKind::J1939Message(message) => {
            format!("{}{of}", message.name.as_deref().unwrap_or("message"))
        }
        EventKind::Frame(frame) => format!("identifier {}{of}", frame.frame.id),
        _ => format!("transfer{of}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_section_keeps_its_extremes() {
        let field = SignalField::of_object(
            crate::wire::canopen::ObjectAddress { index: 0x5002, sub: 0 },
            0,
            16,
            crate::profile::DataType::Unsigned16,
        );
        let mut samples = SignalSamples::new("TPDO1", &field, true);
        for (at, value) in [(0.0, 1.0), (0.1, 9.0), (0.2, -3.0), (0.3, 2.0)] {
            samples.add_sample(0, (at, value));
        }
        samples.add_sample(5, (5.0, 2.0));
        assert_eq!(samples.changes, 3);
        let curve = samples.build_curve();
        assert_eq!(curve.points, [(0.0, 1.0), (0.1, 9.0), (0.2, -3.0), (0.3, 2.0), (5.0, 2.0)]);
        assert_eq!(curve.name, "5002:00?");
    }

    #[test]
    fn positions_outside_the_range_are_in_the_outer_sections() {
        assert_eq!((section_of(-1.0, 0.0, 10.0), section_of(11.0, 0.0, 10.0)), (0, SECTIONS));
        assert_eq!(section_of(5.0, 0.0, 10.0), SECTIONS / 2);
        assert_eq!(section_of(5.0, 5.0, 5.0), 0);
    }
}
