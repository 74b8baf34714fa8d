//! The rules and the part of a pass as one observer: the only place that combines their needs.

use std::sync::Arc;

use super::part::{FrameDemand, ReadingPart};
use crate::capture::{BusNames, Notice};
use crate::event::Event;
use crate::finding::Findings;
use crate::frame::Frame;
use crate::replay::PlacedEvent;
use crate::rules::{Engine, Setup};
use crate::session::{Bus, Buses, Observer, Preview};

/// Rules, and the part that receives events and findings.
pub(super) struct JudgedPart<P> {
    /// `None` without rules, and after the end.
    engine: Option<Engine>,
    pub(super) part: P,
    /// Results of the rules; empty before the end.
    pub(super) findings: Findings,
}

/// Passes findings on to a part.
struct FindingForwarder<'a, P>(&'a mut P);

impl<P: ReadingPart> Observer for FindingForwarder<'_, P> {
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.0.finding(event, bus);
    }
}

impl<P: ReadingPart> JudgedPart<P> {
    /// Without `setup`, no rules run.
    pub(super) fn new(setup: Option<Arc<Setup>>, part: P) -> Self {
        Self { engine: setup.map(Engine::new), part, findings: Findings::default() }
    }

    /// Takes the next frames before the events of the first one: as many as can be taken at once. Returns their number;
    /// 0 ends the capture.
    #[inline]
    pub(super) fn frames(&mut self, frames: &[Frame], names: &BusNames) -> usize {
        let demand = self.part.demand();
        if demand >= FrameDemand::Each {
            return usize::from(frames.first().is_some_and(|first| self.frame(first, names)));
        }
        let count = self.engine.as_mut().map_or(frames.len(), |engine| engine.frames(frames));
        if demand == FrameDemand::Batches {
            self.part.frames(frames.get(..count).unwrap_or(frames), names);
        }
        count
    }

    /// Takes the next frame before its events; `false` ends the capture before it.
    pub(super) fn frame(&mut self, frame: &Frame, names: &BusNames) -> bool {
        let demand = self.part.demand();
        if demand >= FrameDemand::Each && self.part.ends_before(frame) {
            return false;
        }
        if demand >= FrameDemand::Batches {
            self.part.frame(frame, names);
        }
        if let Some(engine) = &mut self.engine {
            engine.frame(frame);
        }
        true
    }

    pub(super) fn notice(&mut self, notice: &Notice, names: &BusNames) {
        self.part.notice(notice, names);
    }

    /// Takes an event with its position.
    pub(super) fn placed(&mut self, placed: &PlacedEvent<'_>) {
        let Self { engine, part, .. } = self;
        part.placed(placed);
        if let Some(engine) = engine {
            engine.event(placed.event, placed.bus, &mut |event: &Event, bus: &Bus| {
                part.placed_finding(&PlacedEvent { event, bus, ..*placed });
            });
        }
    }

    /// Advances the time of the rules to that of the buses.
    pub(super) fn advance(&mut self, buses: Buses<'_>) {
        if let Some(engine) = &mut self.engine {
            for bus in buses {
                engine.advance(bus, &mut FindingForwarder(&mut self.part));
            }
        }
    }

    /// Findings up to now, as at an end of the capture; see [`Engine::so_far`].
    pub(super) fn findings_so_far(&mut self, buses: Buses<'_>) -> Findings {
        self.engine.as_mut().map_or_else(Findings::default, |engine| engine.so_far(buses))
    }

    /// Ends the rules and the part, after the last event; no findings are emitted to a part that is done.
    pub(super) fn finish(&mut self, buses: Buses<'_>) {
        if let Some(engine) = self.engine.take().filter(|_| !self.part.is_done()) {
            self.findings = engine.finish(buses, &mut FindingForwarder(&mut self.part));
        }
        self.part.finish(buses);
    }
}

impl<P: ReadingPart> Observer for JudgedPart<P> {
    #[inline]
    fn event(&mut self, event: &Event, bus: &Bus) {
        self.part.event(event, bus);
        if let Some(engine) = &mut self.engine {
            engine.event(event, bus, &mut FindingForwarder(&mut self.part));
        }
    }

    #[inline]
    fn needs(&self, preview: &Preview, bus: &Bus) -> bool {
        self.part.need(preview, bus) || self.engine.as_ref().is_some_and(|engine| engine.needs(preview, bus))
    }

    /// The engine decides last, because it counts the frame in the same call.
    #[inline]
    fn skip(&mut self, preview: &Preview, bus: &Bus) -> bool {
        let is_skipped = !self.part.need(preview, bus)
            && self.engine.as_mut().is_none_or(|engine| engine.skip(preview, bus));
        if is_skipped {
            self.part.skip(preview, bus);
        }
        is_skipped
    }

    fn is_selective(&self, preview: &Preview, bus: &Bus) -> bool {
        self.engine.as_ref().is_some_and(|engine| engine.is_selective(preview, bus))
    }
}
