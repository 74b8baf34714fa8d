//! An event that a later finding refers to, for example if its successor is missing.

use crate::event::{Event, FrameRange};
use crate::rules::{FindingAlarm, RuleContext};
use crate::wire::NodeId;

/// Node and frames of an event.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct EventMoment {
    pub(super) node: Option<NodeId>,
    pub(super) frames: FrameRange,
    is_presumed: bool,
}

impl EventMoment {
    pub(super) fn moment_of(event: &Event) -> Self {
        Self { node: event.node, frames: event.frames, is_presumed: event.presumed }
    }

    /// Starts a finding at a deadline that expired after the event.
    pub(super) fn fail_at<'b, 'a>(&self, at: i64, context: &'b mut RuleContext<'a>) -> FindingAlarm<'b, 'a> {
        context.fail_at(at, self.node, self.frames).with_presumption(self.is_presumed)
    }
}
