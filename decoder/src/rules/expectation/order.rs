//! `order`: events must follow in a given order.

use super::deadline::MovingDeadline;
use super::moment::EventMoment;
use super::plan::QuotedExpression;
use super::subjects::ExpectationSubjects;
use super::task::ExpectationTask;
use super::words::format_time;
use crate::event::{Event, FrameRange};
use crate::rules::RuleContext;

pub(super) struct OrderTask {
    steps: Vec<QuotedExpression>,
    time: Option<i64>,
    subjects: ExpectationSubjects<SequenceProgress>,
}

/// Progress of a sequence.
#[derive(Debug, Clone, Default)]
struct SequenceProgress {
    /// Index of the next step; 0 before the first one.
    next: usize,
    deadline: MovingDeadline,
    /// Event of the first step.
    begun: EventMoment,
}

pub(super) fn new(steps: &[QuotedExpression], time: Option<i64>, is_per_node: bool) -> OrderTask {
    OrderTask { steps: steps.to_vec(), time, subjects: ExpectationSubjects::new(is_per_node) }
}

impl OrderTask {
    /// Step that the event matches: the next one, the first one again, or one after the next. Earlier steps
    /// may be repeated. Before the first step, later steps are ignored, since the capture may begin in the
    /// middle of a sequence.
    fn matching_step(&self, next: usize, event: &Event, context: &RuleContext<'_>) -> Option<usize> {
        let is =
            |place: &usize| self.steps.get(*place).is_some_and(|step| step.matches_event(event, context));
        let again = (next == 1).then_some(0);
        let behind = if next == 0 { 0..0 } else { next + 1..self.steps.len() };
        std::iter::once(next).chain(again).chain(behind).find(is)
    }
}

impl ExpectationTask for OrderTask {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if self.time.is_some() && !context.has_time {
            return;
        }
        let Some(next) = self.subjects.state_of(event.node).map(|(way, _)| way.next) else { return };
        let step = self.matching_step(next, event, context);
        let (Some(step), Some((way, token))) = (step, self.subjects.state_of(event.node)) else { return };
        if step == 0 {
            (way.next, way.begun) = (1, EventMoment::moment_of(event));
            if let Some(time) = self.time {
                way.deadline.set_deadline(context.now.saturating_add(time), token, context);
            }
            return;
        }
        if step == next && step + 1 < self.steps.len() {
            way.next += 1;
            return;
        }
        way.next = 0;
        way.deadline.cancel_deadline();
        if step == next {
            return context.count_pass();
        }
        let frames = FrameRange { first: way.begun.frames.first, last: event.frames.last };
        let missing = self.steps.get(next).map(ToString::to_string).unwrap_or_default();
        let text = || format!("step {} without step {} before it: {missing}", step + 1, next + 1);
        context.start_finding(event).with_frames(frames).report_finding(text);
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(way) = self.subjects.of_token(token) else { return };
        let Some(due) = way.deadline.take_expired(token, context) else { return };
        let next = std::mem::take(&mut way.next);
        let (begun, limit) = (way.begun.frames.first, format_time(self.time.unwrap_or_default()));
        let missing = self.steps.get(next).map(ToString::to_string).unwrap_or_default();
        let alarm = way.begun.fail_at(due, context);
        alarm.report_finding(|| format!("no step {} within {limit} of {{{begun}}}: {missing}", next + 1));
    }

    fn idle_reason(&self) -> String {
        match self.steps.first() {
            Some(first) => format!("no complete sequence from {first}"),
            None => String::new(),
        }
    }
}
