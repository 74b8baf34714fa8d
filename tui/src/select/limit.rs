//! End of the part of a capture that a command reads: `--at` and `--to`.

use cobscope_decoder::event::Event;
use cobscope_decoder::frame::{Frame, Timestamp};
use cobscope_decoder::reading::{FrameDemand, ReadingPart};
use cobscope_decoder::session::{Bus, MessagePreview};

use super::bound::{RangeBound, Span};
use super::clock::BoundSide;

/// End of the part of a capture that is read.
#[derive(Debug, Default)]
pub struct TimeLimit {
    bounds: Vec<(BoundSide, RangeBound)>,
    first: Option<Timestamp>,
    /// The bound that ended reading.
    passed: Option<RangeBound>,
}

impl TimeLimit {
    /// The capture ends at the earlier one of both moments.
    pub fn new(at: Option<RangeBound>, to: Option<RangeBound>) -> Self {
        let bounds = [(BoundSide::At, at), (BoundSide::To, to)];
        let bounds = bounds.into_iter().filter_map(|(side, bound)| Some((side, bound?))).collect();
        Self { bounds, ..Self::default() }
    }

    /// Takes the first frame of the capture.
    ///
    /// # Errors
    /// If a bound is not possible for this capture; see [`RangeBound::resolve_bound`].
    pub fn begin_capture(&mut self, first: &Frame, span: Span<'_>) -> anyhow::Result<()> {
        self.first = first.time;
        for (side, bound) in &mut self.bounds {
            *bound = bound.resolve_bound(*side, first, span)?;
        }
        Ok(())
    }

    /// Timestamp of the first frame.
    pub fn first_time(&self) -> Option<Timestamp> {
        self.first
    }

    /// The bound that ended reading, as text; `None` if all frames were read.
    pub fn passed_bound(&self) -> Option<String> {
        Some(self.passed?.bound_text(self.first))
    }

    /// The end as text; `None` without a limit.
    pub fn end_text(&self) -> Option<String> {
        let bound = self.passed.or_else(|| self.bounds.first().map(|(_, bound)| *bound))?;
        Some(bound.bound_text(self.first))
    }
}

/// A part that ends the capture at the limit.
impl ReadingPart for TimeLimit {
    fn event(&mut self, _event: &Event, _bus: &Bus) {}

    fn need(&self, _preview: &MessagePreview, _bus: &Bus) -> bool {
        false
    }

    fn demand(&self) -> FrameDemand {
        if self.bounds.is_empty() { FrameDemand::None } else { FrameDemand::Each }
    }

    fn ends_before(&mut self, frame: &Frame) -> bool {
        let first = self.first;
        let is_passed = |(_, bound): &&(BoundSide, RangeBound)| bound.is_before(frame, first);
        let passed = self.bounds.iter().find(is_passed).map(|(_, bound)| *bound);
        self.passed = self.passed.or(passed);
        passed.is_some()
    }

    fn end_moment(&self) -> Option<String> {
        self.passed_bound()
    }
}
