//! `within`: an event must follow another one within a time.

use std::collections::VecDeque;

use super::deadline::MovingDeadline;
use super::moment::EventMoment;
use super::plan::QuotedExpression;
use super::subjects::ExpectationSubjects;
use super::task::ExpectationTask;
use super::words::format_time;
use crate::event::Event;
use crate::rules::RuleContext;

/// Maximum number of pending events; further ones are ignored.
const WAITING_LIMIT: usize = 256;

pub(super) struct WithinTask {
    when: QuotedExpression,
    expect: QuotedExpression,
    time: i64,
    subjects: ExpectationSubjects<PendingEvents>,
}

/// Pending events, oldest first; one expected event completes all of them.
#[derive(Debug, Clone, Default)]
struct PendingEvents {
    events: VecDeque<PendingTrigger>,
    deadline: MovingDeadline,
}

#[derive(Debug, Clone, Copy)]
struct PendingTrigger {
    due: i64,
    moment: EventMoment,
}

pub(super) fn new(
    when: &QuotedExpression,
    expect: &QuotedExpression,
    time: i64,
    is_per_node: bool,
) -> WithinTask {
    let subjects = ExpectationSubjects::new(is_per_node);
    WithinTask { when: when.clone(), expect: expect.clone(), time, subjects }
}

impl ExpectationTask for WithinTask {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if !context.has_time {
            return;
        }
        let Some((waiting, token)) = self.subjects.state_of(event.node) else { return };
        if !waiting.events.is_empty() && self.expect.matches_event(event, context) {
            for _ in waiting.events.drain(..) {
                context.count_pass();
            }
            waiting.deadline.cancel_deadline();
        }
        if waiting.events.len() < WAITING_LIMIT && self.when.matches_event(event, context) {
            let due = context.now.saturating_add(self.time);
            if waiting.events.is_empty() {
                waiting.deadline.set_deadline(due, token, context);
            }
            waiting.events.push_back(PendingTrigger { due, moment: EventMoment::moment_of(event) });
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(waiting) = self.subjects.of_token(token) else { return };
        let Some(due) = waiting.deadline.take_expired(token, context) else { return };
        while let Some(begun) = waiting.events.pop_front_if(|begun| begun.due <= due) {
            let (expect, time, frame) = (&self.expect, format_time(self.time), begun.moment.frames.last);
            let alarm = begun.moment.fail_at(begun.due, context);
            alarm.report_finding(|| format!("no match within {time} of {{{frame}}}: {expect}"));
        }
        if let Some(next) = waiting.events.front() {
            waiting.deadline.set_deadline(next.due, token, context);
        }
    }

    fn idle_reason(&self) -> String {
        self.when.idle_reason()
    }
}
