//! A deadline that moves.

use crate::rules::Context;

/// A deadline that only ever moves on: one entry waits in the queue, and asks again when it comes due.
#[derive(Debug, Clone, Default)]
pub(super) struct Deadline {
    due: Option<i64>,
    is_queued: bool,
}

impl Deadline {
    /// Sets or moves it.
    pub(super) fn set(&mut self, due: i64, token: u64, context: &mut Context<'_>) {
        self.due = Some(due);
        if !std::mem::replace(&mut self.is_queued, true) {
            context.wake_at(due, token);
        }
    }

    /// There is none any more.
    pub(super) fn clear(&mut self) {
        self.due = None;
    }

    /// The entry came due: when the deadline was, where it has passed; else the entry waits again.
    pub(super) fn passed(&mut self, token: u64, context: &mut Context<'_>) -> Option<i64> {
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
