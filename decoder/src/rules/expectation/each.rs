//! `always` and `never`: each event is checked on its own.

use super::plan::QuotedExpression;
use super::task::Task;
use crate::event::Event;
use crate::rules::Context;

pub(super) struct Always {
    when: QuotedExpression,
    expect: QuotedExpression,
}

pub(super) fn always(when: &QuotedExpression, expect: &QuotedExpression) -> Always {
    Always { when: when.clone(), expect: expect.clone() }
}

impl Task for Always {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if !self.when.matches(event, context) {
            return;
        }
        if self.expect.matches(event, context) {
            return context.pass();
        }
        context.fail(event).report(|| format!("{} does not match: {}", event.kind.name(), self.expect));
    }

    fn idle(&self) -> String {
        self.when.idle()
    }
}

pub(super) struct Never {
    when: QuotedExpression,
    has_failed: bool,
}

pub(super) fn never(when: &QuotedExpression) -> Never {
    Never { when: when.clone(), has_failed: false }
}

impl Task for Never {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if self.when.matches(event, context) {
            self.has_failed = true;
            context.fail(event).report(|| format!("{} matches: {}", event.kind.name(), self.when));
        }
    }

    fn finish(&mut self, known: bool, context: &mut Context<'_>) {
        if known && !self.has_failed {
            context.pass();
        }
    }

    fn idle(&self) -> String {
        String::new()
    }
}
