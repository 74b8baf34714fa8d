//! `count` with `per_seconds`: limits for the number of events per window. The first event opens a window;
//! windows follow each other until one is empty. The next event then opens a window again.

use super::deadline::MovingDeadline;
use super::moment::EventMoment;
use super::plan::{QuotedExpression, ValueLimits};
use super::subjects::ExpectationSubjects;
use super::task::ExpectationTask;
use super::words::format_time;
use crate::event::Event;
use crate::rules::RuleContext;

pub(super) struct WindowsTask {
    when: QuotedExpression,
    limits: ValueLimits<u64>,
    window: i64,
    subjects: ExpectationSubjects<OpenWindow>,
}

/// The current window.
#[derive(Debug, Clone, Default)]
struct OpenWindow {
    count: u64,
    /// End of the window in ns; None if no window is open.
    end: Option<i64>,
    deadline: MovingDeadline,
    /// Last event in the window.
    last: EventMoment,
}

pub(super) fn new(
    when: &QuotedExpression,
    limits: ValueLimits<u64>,
    window: i64,
    is_per_node: bool,
) -> WindowsTask {
    WindowsTask { when: when.clone(), limits, window, subjects: ExpectationSubjects::new(is_per_node) }
}

impl ExpectationTask for WindowsTask {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if !context.has_time || !self.when.matches_event(event, context) {
            return;
        }
        let Some((window, token)) = self.subjects.state_of(event.node) else { return };
        if window.end.is_none() {
            let end = context.now.saturating_add(self.window);
            window.end = Some(end);
            window.deadline.set_deadline(end, token, context);
        }
        window.count += 1;
        window.last = EventMoment::moment_of(event);
        if let Some(max) = self.limits.max
            && window.count > max
        {
            let (when, count, length) = (&self.when, window.count, format_time(self.window));
            #[expect(clippy::cast_precision_loss, reason = "a count for comparing")]
            let alarm = context.start_finding(event).with_measure(count as f64);
            alarm.report_finding(|| format!("match count {count} within {length} (max {max}): {when}"));
        }
    }

    fn on_gap(&mut self, _context: &mut RuleContext<'_>) {
        self.subjects.for_each(|_, window| {
            window.deadline.cancel_deadline();
            (window.end, window.count) = (None, 0);
        });
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        let Some(window) = self.subjects.of_token(token) else { return };
        let Some(end) = window.deadline.take_expired(token, context) else { return };
        let count = std::mem::take(&mut window.count);
        match self.limits {
            ValueLimits { max: Some(max), .. } if count > max => {}
            ValueLimits { min: Some(min), .. } if count < min => {
                let (when, length) = (&self.when, format_time(self.window));
                let alarm = window.last.fail_at(end, context);
                alarm.report_finding(|| format!("match count {count} within {length} (min {min}): {when}"));
            }
            _ => context.count_pass(),
        }
        // A long absence of events is reported once, for the first empty window.
        window.end = (count > 0).then(|| end.saturating_add(self.window));
        if let Some(next) = window.end {
            window.deadline.set_deadline(next, token, context);
        }
    }

    fn idle_reason(&self) -> String {
        format!("no complete window of {}: {}", format_time(self.window), self.when)
    }
}
