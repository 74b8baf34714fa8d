//! `count` with `per_seconds`: limits for the number of events per window. The first event opens a window;
//! windows follow each other until one is empty. The next event then opens a window again.

use super::deadline::Deadline;
use super::moment::Moment;
use super::plan::{Limits, QuotedExpression};
use super::subjects::Subjects;
use super::task::Task;
use super::words::time;
use crate::event::Event;
use crate::rules::Context;

pub(super) struct Windows {
    when: QuotedExpression,
    limits: Limits<u64>,
    window: i64,
    subjects: Subjects<Window>,
}

/// The current window.
#[derive(Debug, Clone, Default)]
struct Window {
    count: u64,
    /// End of the window in ns; None if no window is open.
    end: Option<i64>,
    deadline: Deadline,
    /// Last event in the window.
    last: Moment,
}

pub(super) fn new(when: &QuotedExpression, limits: Limits<u64>, window: i64, is_per_node: bool) -> Windows {
    Windows { when: when.clone(), limits, window, subjects: Subjects::new(is_per_node) }
}

impl Task for Windows {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if !context.has_time || !self.when.matches(event, context) {
            return;
        }
        let Some((window, token)) = self.subjects.of(event.node) else { return };
        if window.end.is_none() {
            let end = context.now.saturating_add(self.window);
            window.end = Some(end);
            window.deadline.set(end, token, context);
        }
        window.count += 1;
        window.last = Moment::of(event);
        if let Some(max) = self.limits.max
            && window.count > max
        {
            let (when, count, length) = (&self.when, window.count, time(self.window));
            #[expect(clippy::cast_precision_loss, reason = "a count for comparing")]
            let alarm = context.fail(event).measure(count as f64);
            alarm.report(|| format!("match count {count} within {length} (max {max}): {when}"));
        }
    }

    fn interrupt(&mut self, _context: &mut Context<'_>) {
        self.subjects.for_each(|_, window| {
            window.deadline.clear();
            (window.end, window.count) = (None, 0);
        });
    }

    fn wake(&mut self, token: u64, context: &mut Context<'_>) {
        let Some(window) = self.subjects.of_token(token) else { return };
        let Some(end) = window.deadline.passed(token, context) else { return };
        let count = std::mem::take(&mut window.count);
        match self.limits {
            Limits { max: Some(max), .. } if count > max => {}
            Limits { min: Some(min), .. } if count < min => {
                let (when, length) = (&self.when, time(self.window));
                let alarm = window.last.fail_at(end, context);
                alarm.report(|| format!("match count {count} within {length} (min {min}): {when}"));
            }
            _ => context.pass(),
        }
        // A long absence of events is reported once, for the first empty window.
        window.end = (count > 0).then(|| end.saturating_add(self.window));
        if let Some(next) = window.end {
            window.deadline.set(next, token, context);
        }
    }

    fn idle(&self) -> String {
        format!("no complete window of {}: {}", time(self.window), self.when)
    }
}
