//! A reading in steps, whose part knows the position of each event.

use std::io::Read;
use std::sync::Arc;

use super::part::ReadingPart;
use super::short_path::JudgedPart;
use crate::capture::CaptureError;
use crate::finding::CaptureFindings;
use crate::frame::Timestamp;
use crate::replay::{CaptureWalk, PlacedEvent, ReplayState};
use crate::rules::RuleSetup;

/// A walk through captures with rules and a part.
pub struct PlacedReading<R, P> {
    /// Reader, and state after the last frame.
    pub walk: CaptureWalk<R>,
    judged: JudgedPart<P>,
    failure: Option<CaptureError>,
}

/// Results of a [`PlacedReading`].
pub struct PlacedSummary<P> {
    /// Findings of all rules.
    pub findings: CaptureFindings,
    /// The part of the pass, after its end.
    pub part: P,
    /// State after the last frame.
    pub end: ReplayState,
}

impl<R: Read, P: ReadingPart> PlacedReading<R, P> {
    /// Starts where a walk is.
    pub fn new(walk: CaptureWalk<R>, setup: &Arc<RuleSetup>, part: P) -> Self {
        Self { walk, judged: JudgedPart::new(Some(Arc::clone(setup)), part), failure: None }
    }

    /// Processes the next frame or notice; `false` at the end, or at an error after which the capture cannot be read.
    pub fn step(&mut self) -> bool {
        let Self { walk, judged, failure } = self;
        let frame = match walk.peek_frame() {
            Ok(frame) => frame.copied(),
            Err(error) => {
                failure.get_or_insert(error);
                None
            }
        };
        if let Some(frame) = &frame {
            judged.frame(frame, walk.buses());
        }
        let step = walk.step_item(&mut |placed: PlacedEvent<'_>| judged.placed(&placed));
        if frame.is_none() && matches!(step, Ok(true)) {
            // A notice: time may have advanced without a frame.
            judged.advance(walk.world.buses());
        }
        step.unwrap_or_else(|error| {
            failure.get_or_insert(error);
            walk.close_conditions(&mut |placed: PlacedEvent<'_>| judged.placed(&placed));
            false
        })
    }

    /// The first error since the last call.
    pub fn take_failure(&mut self) -> Option<CaptureError> {
        self.failure.take()
    }

    /// The part of the pass.
    pub fn part(&self) -> &P {
        &self.judged.part
    }

    /// The part of the pass, to change it.
    pub fn part_mut(&mut self) -> &mut P {
        &mut self.judged.part
    }

    /// Findings up to now, as at an end of the capture, and the zero of their times. Costs a copy of all findings.
    pub fn findings_so_far(&mut self) -> (CaptureFindings, Option<Timestamp>) {
        (self.judged.findings_so_far(self.walk.world.buses()), self.walk.world.first_time())
    }

    /// The results.
    pub fn finish(mut self) -> PlacedSummary<P> {
        self.judged.finish(self.walk.world.buses());
        let JudgedPart { findings, part, .. } = self.judged;
        PlacedSummary { findings, part, end: self.walk.world }
    }
}
