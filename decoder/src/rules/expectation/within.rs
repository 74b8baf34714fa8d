//! `within`: an event must follow another one within a time.

use std::collections::VecDeque;

use super::deadline::Deadline;
use super::moment::Moment;
use super::plan::QuotedExpression;
use super::subjects::Subjects;
use super::task::Task;
use super::words::time;
use crate::event::Event;
use crate::rules::Context;

/// Maximum number of pending events; further ones are ignored.
const WAITING_LIMIT: usize = 256;

pub(super) struct Within {
    when: QuotedExpression,
    expect: QuotedExpression,
    time: i64,
    subjects: Subjects<PendingEvents>,
}

/// Pending events, oldest first; one expected event completes all of them.
#[derive(Debug, Clone, Default)]
struct PendingEvents {
    events: VecDeque<PendingTrigger>,
    deadline: Deadline,
}

#[derive(Debug, Clone, Copy)]
struct PendingTrigger {
    due: i64,
    moment: Moment,
}

pub(super) fn new(
    when: &QuotedExpression,
    expect: &QuotedExpression,
    time: i64,
    is_per_node: bool,
) -> Within {
    let subjects = Subjects::new(is_per_node);
    Within { when: when.clone(), expect: expect.clone(), time, subjects }
}

impl Task for Within {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if !context.has_time {
            return;
        }
        let Some((waiting, token)) = self.subjects.of(event.node) else { return };
        if !waiting.events.is_empty() && self.expect.matches(event, context) {
            for _ in waiting.events.drain(..) {
                context.pass();
            }
            waiting.deadline.clear();
        }
        if waiting.events.len() < WAITING_LIMIT && self.when.matches(event, context) {
            let due = context.now.saturating_add(self.time);
            if waiting.events.is_empty() {
                waiting.deadline.set(due, token, context);
            }
            waiting.events.push_back(PendingTrigger { due, moment: Moment::of(event) });
        }
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let Some(waiting) = self.subjects.of_token(token) else { return };
        let Some(due) = waiting.deadline.passed(token, context) else { return };
        while let Some(begun) = waiting.events.pop_front_if(|begun| begun.due <= due) {
            let (expect, time, frame) = (&self.expect, time(self.time), begun.moment.frames.last);
            let alarm = begun.moment.fail_at(begun.due, context);
            alarm.report(|| format!("no match within {time} of {{{frame}}}: {expect}"));
        }
        if let Some(next) = waiting.events.front() {
            waiting.deadline.set(next.due, token, context);
        }
    }

    fn idle(&self) -> String {
        self.when.idle()
    }
}
