//! `always` and `never`: each event is checked on its own.

use super::plan::QuotedExpression;
use super::task::ExpectationTask;
use crate::event::Event;
use crate::rules::RuleContext;

pub(super) struct AlwaysTask {
    when: QuotedExpression,
    expect: QuotedExpression,
}

pub(super) fn always_task(when: &QuotedExpression, expect: &QuotedExpression) -> AlwaysTask {
    AlwaysTask { when: when.clone(), expect: expect.clone() }
}

impl ExpectationTask for AlwaysTask {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if !self.when.matches_event(event, context) {
            return;
        }
        if self.expect.matches_event(event, context) {
            return context.count_pass();
        }
        context
            .start_finding(event)
            .report_finding(|| format!("{} does not match: {}", event.kind.name(), self.expect));
    }

    fn idle_reason(&self) -> String {
        self.when.idle_reason()
    }
}

pub(super) struct NeverTask {
    when: QuotedExpression,
    has_failed: bool,
}

pub(super) fn never_task(when: &QuotedExpression) -> NeverTask {
    NeverTask { when: when.clone(), has_failed: false }
}

impl ExpectationTask for NeverTask {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if self.when.matches_event(event, context) {
            self.has_failed = true;
            context
                .start_finding(event)
                .report_finding(|| format!("{} matches: {}", event.kind.name(), self.when));
        }
    }

    fn on_end(&mut self, known: bool, context: &mut RuleContext<'_>) {
        if known && !self.has_failed {
            context.count_pass();
        }
    }

    fn idle_reason(&self) -> String {
        String::new()
    }
}
