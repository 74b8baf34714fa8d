//! `every`: one event per period.

use super::deadline::MovingDeadline;
use super::moment::EventMoment;
use super::plan::QuotedExpression;
use super::subjects::ExpectationSubjects;
use super::task::ExpectationTask;
use super::words::format_time;
use crate::event::{Event, FrameRange};
use crate::finding::FindingSubject;
use crate::rules::RuleContext;

pub(super) struct EveryTask {
    when: QuotedExpression,
    period: i64,
    tolerance: i64,
    subjects: ExpectationSubjects<RepeatState>,
}

/// The last event, and the deadline of the next one.
#[derive(Debug, Clone, Default)]
struct RepeatState {
    last: Option<LastOccurrence>,
    deadline: MovingDeadline,
    is_late: bool,
}

#[derive(Debug, Clone, Copy)]
struct LastOccurrence {
    time: i64,
    moment: EventMoment,
}

pub(super) fn new(when: &QuotedExpression, period: i64, tolerance: i64, is_per_node: bool) -> EveryTask {
    EveryTask { when: when.clone(), period, tolerance, subjects: ExpectationSubjects::new(is_per_node) }
}

/// Required period as text: `expected 100 ms ± 10 ms`.
fn period_text(period: i64, tolerance: i64) -> String {
    format!("expected {} ± {}", format_time(period), format_time(tolerance))
}

impl ExpectationTask for EveryTask {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if !context.has_time || !self.when.matches_event(event, context) {
            return;
        }
        let (period, tolerance) = (self.period, self.tolerance);
        let Some((course, token)) = self.subjects.state_of(event.node) else { return };
        let now = context.now;
        let seen = LastOccurrence { time: now, moment: EventMoment::moment_of(event) };
        let last = course.last.replace(seen);
        // A late event was already reported at its deadline.
        if let Some(last) = last {
            if std::mem::take(&mut course.is_late) {
                context.close_condition(last.moment.node, FindingSubject::Whole);
            } else {
                let interval = now.saturating_sub(last.time);
                if interval < period.saturating_sub(tolerance) {
                    let frames = FrameRange { first: last.moment.frames.first, last: event.frames.last };
                    let alarm = context.start_finding(event).with_frames(frames);
                    alarm.report_finding(|| {
                        format!("interval {} ({})", format_time(interval), period_text(period, tolerance))
                    });
                } else {
                    context.count_pass();
                }
            }
        }
        course.deadline.set_deadline(now.saturating_add(period).saturating_add(tolerance), token, context);
    }

    fn on_gap(&mut self, context: &mut RuleContext<'_>) {
        self.subjects.for_each(|_, course| {
            course.deadline.cancel_deadline();
            if let Some(last) = course.last.take()
                && std::mem::take(&mut course.is_late)
            {
                context.close_condition(last.moment.node, FindingSubject::Whole);
            }
        });
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(course) = self.subjects.of_token(token) else { return };
        let Some(due) = course.deadline.take_expired(token, context) else { return };
        let Some(last) = course.last else { return };
        course.is_late = true;
        let (wanted, frame) = (period_text(self.period, self.tolerance), last.moment.frames.last);
        let since = context.timestamp_of(last.time);
        let alarm = last.moment.fail_at(due, context).started_at(since);
        alarm.report_finding(|| format!("missing since {{{frame}}} ({wanted})"));
    }

    fn idle_reason(&self) -> String {
        format!("fewer than two events matched {}", self.when)
    }
}
