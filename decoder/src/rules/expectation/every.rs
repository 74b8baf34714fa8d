//! `every`: one event per period.

use super::deadline::Deadline;
use super::moment::Moment;
use super::plan::QuotedExpression;
use super::subjects::Subjects;
use super::task::Task;
use super::words::time;
use crate::event::{Event, FrameRange};
use crate::finding::About;
use crate::rules::Context;

pub(super) struct Every {
    when: QuotedExpression,
    period: i64,
    tolerance: i64,
    subjects: Subjects<RepeatState>,
}

/// The last event, and the deadline of the next one.
#[derive(Debug, Clone, Default)]
struct RepeatState {
    last: Option<LastOccurrence>,
    deadline: Deadline,
    is_late: bool,
}

#[derive(Debug, Clone, Copy)]
struct LastOccurrence {
    time: i64,
    moment: Moment,
}

pub(super) fn new(when: &QuotedExpression, period: i64, tolerance: i64, is_per_node: bool) -> Every {
    Every { when: when.clone(), period, tolerance, subjects: Subjects::new(is_per_node) }
}

/// Required period as text: `expected 100 ms ± 10 ms`.
fn wanted(period: i64, tolerance: i64) -> String {
    format!("expected {} ± {}", time(period), time(tolerance))
}

impl Task for Every {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if !context.has_time || !self.when.matches(event, context) {
            return;
        }
        let (period, tolerance) = (self.period, self.tolerance);
        let Some((course, token)) = self.subjects.of(event.node) else { return };
        let now = context.now;
        let seen = LastOccurrence { time: now, moment: Moment::of(event) };
        let last = course.last.replace(seen);
        // A late event was already reported at its deadline.
        if let Some(last) = last {
            if std::mem::take(&mut course.is_late) {
                context.close(last.moment.node, About::Whole);
            } else {
                let interval = now.saturating_sub(last.time);
                if interval < period.saturating_sub(tolerance) {
                    let frames = FrameRange { first: last.moment.frames.first, last: event.frames.last };
                    let alarm = context.fail(event).frames(frames);
                    alarm.report(|| format!("interval {} ({})", time(interval), wanted(period, tolerance)));
                } else {
                    context.pass();
                }
            }
        }
        course.deadline.set(now.saturating_add(period).saturating_add(tolerance), token, context);
    }

    fn interrupt(&mut self, context: &mut Context<'_>) {
        self.subjects.for_each(|_, course| {
            course.deadline.clear();
            if let Some(last) = course.last.take()
                && std::mem::take(&mut course.is_late)
            {
                context.close(last.moment.node, About::Whole);
            }
        });
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let Some(course) = self.subjects.of_token(token) else { return };
        let Some(due) = course.deadline.passed(token, context) else { return };
        let Some(last) = course.last else { return };
        course.is_late = true;
        let (wanted, frame) = (wanted(self.period, self.tolerance), last.moment.frames.last);
        let since = context.timestamp_of(last.time);
        let alarm = last.moment.fail_at(due, context).since(since);
        alarm.report(|| format!("missing since {{{frame}}} ({wanted})"));
    }

    fn idle(&self) -> String {
        format!("fewer than two events matched {}", self.when)
    }
}
