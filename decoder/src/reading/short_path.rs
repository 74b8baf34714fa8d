//! The rules and the part of a pass as one observer: the only place that combines their needs.

use std::sync::Arc;

use super::part::{FrameDemand, ReadingPart};
use crate::capture::{BusNames, Notice};
use crate::event::Event;
use crate::finding::CaptureFindings;
use crate::frame::Frame;
use crate::replay::PlacedEvent;
use crate::rules::{RuleEngine, RuleSetup};
use crate::session::{Bus, Buses, MessagePreview, Observer};

/// Rules, and the part that receives events and findings.
pub(super) struct JudgedPart<P> {
    /// `None` without rules, and after the end.
    engine: Option<RuleEngine>,
    pub(super) part: P,
    /// Results of the rules; empty before the end.
    pub(super) findings: CaptureFindings,
}

/// Passes findings on to a part.
struct FindingForwarder<'a, P>(&'a mut P);

impl<P: ReadingPart> Observer for FindingForwarder<'_, P> {
    fn on_event(&mut self, event: &Event, bus: &Bus) {
        self.0.finding(event, bus);
    }
}

impl<P: ReadingPart> JudgedPart<P> {
    /// Without `setup`, no rules run.
    pub(super) fn new(setup: Option<Arc<RuleSetup>>, part: P) -> Self {
        Self { engine: setup.map(RuleEngine::new), part, findings: CaptureFindings::default() }
    }

    /// Takes the next frames before the events of the first one: as many as can be taken at once. Returns their number;
    /// 0 ends the capture.
    #[inline]
    pub(super) fn frames(&mut self, frames: &[Frame], names: &BusNames) -> usize {
        let demand = self.part.demand();
        if demand >= FrameDemand::Each {
            return usize::from(frames.first().is_some_and(|first| self.frame(first, names)));
        }
        let count = self.engine.as_mut().map_or(frames.len(), |engine| engine.on_frames(frames));
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
            engine.on_frame(frame);
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
            engine.on_event(placed.event, placed.bus, &mut |event: &Event, bus: &Bus| {
                part.placed_finding(&PlacedEvent { event, bus, ..*placed });
            });
        }
    }

    /// Advances the time of the rules to that of the buses.
    pub(super) fn advance(&mut self, buses: Buses<'_>) {
        if let Some(engine) = &mut self.engine {
            for bus in buses {
                engine.advance_time(bus, &mut FindingForwarder(&mut self.part));
            }
        }
    }

    /// Findings up to now, as at an end of the capture; see [`RuleEngine::so_far`].
    pub(super) fn findings_so_far(&mut self, buses: Buses<'_>) -> CaptureFindings {
        self.engine.as_mut().map_or_else(CaptureFindings::default, |engine| engine.so_far(buses))
    }

    /// Ends the rules and the part, after the last event; no findings are emitted to a part that is done.
    pub(super) fn finish(&mut self, buses: Buses<'_>) {
        if let Some(engine) = self.engine.take().filter(|_| !self.part.is_done()) {
            self.findings = engine.finish_capture(buses, &mut FindingForwarder(&mut self.part));
        }
        self.part.finish(buses);
    }
}

impl<P: ReadingPart> Observer for JudgedPart<P> {
    #[inline]
    fn on_event(&mut self, event: &Event, bus: &Bus) {
        self.part.event(event, bus);
        if let Some(engine) = &mut self.engine {
            engine.on_event(event, bus, &mut FindingForwarder(&mut self.part));
        }
    }

    #[inline]
    fn needs_event(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.part.need(preview, bus)
            || self.engine.as_ref().is_some_and(|engine| engine.needs_event(preview, bus))
    }

    /// The engine decides last, because it counts the frame in the same call.
    #[inline]
    fn skip_event(&mut self, preview: &MessagePreview, bus: &Bus) -> bool {
        let is_skipped = !self.part.need(preview, bus)
            && self.engine.as_mut().is_none_or(|engine| engine.skip_event(preview, bus));
        if is_skipped {
            self.part.skip(preview, bus);
        }
        is_skipped
    }

    fn is_selective(&self, preview: &MessagePreview, bus: &Bus) -> bool {
        self.engine.as_ref().is_some_and(|engine| engine.is_selective(preview, bus))
    }
}
