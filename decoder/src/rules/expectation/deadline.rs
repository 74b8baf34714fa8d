//! A deadline that is postponed repeatedly.

use crate::rules::RuleContext;

/// Deadline that only moves to later times: one wake-up is pending and is requested again when it expires too
/// early.
#[derive(Debug, Clone, Default)]
pub(super) struct MovingDeadline {
    due: Option<i64>,
    is_queued: bool,
}

impl MovingDeadline {
    /// Sets or postpones the deadline.
    pub(super) fn set_deadline(&mut self, due: i64, token: u64, context: &mut RuleContext<'_>) {
        self.due = Some(due);
        if !std::mem::replace(&mut self.is_queued, true) {
            context.wake_at(due, token);
        }
    }

    /// Cancels the deadline.
    pub(super) fn cancel_deadline(&mut self) {
        self.due = None;
    }

    /// Handles the wake-up: returns the deadline if it has passed, else requests a new wake-up.
    pub(super) fn take_expired(&mut self, token: u64, context: &mut RuleContext<'_>) -> Option<i64> {
        self.is_queued = false;
        let due = self.due?;
        if due <= context.now {
            self.due = None;
            return Some(due);
        }
        self.is_queued = true;
        context.wake_at(due, token);
        None
    }
}
