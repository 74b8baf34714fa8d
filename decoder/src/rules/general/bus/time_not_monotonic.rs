//! TIME runs backwards.

use crate::event::{Event, EventKind, Kind};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};

declare_rule! {
    /// # What it checks
    /// The time in a TIME message is earlier than in the previous one.
    ///
    /// # Why it matters
    /// Device logs get out of order. With two producers, the clock jumps back and forth.
    ///
    /// # Source
    /// CiA 301 §7.2.6 (time stamp object)
    ///
    /// # What to look at first
    /// Check bit 30 of 1012 in all nodes. Two TIME producers, or a clock that was set, explain the jump.
    ///
    /// # Mutation
    /// swap two TIME messages
    "time-not-monotonic", Warning, "TIME runs backwards",
    kinds: [Kind::Time],
    needs: "two TIME messages",
    word: "TIME",
}

#[derive(Default)]
struct TimeNotMonotonic {
    /// Time of the last TIME message, in milliseconds since 1984.
    last: Option<i64>,
}

fn new(_policy: &RulePolicy) -> TimeNotMonotonic {
    TimeNotMonotonic::default()
}

/// Milliseconds per day.
const DAY: i64 = 86_400_000;

impl Rule for TimeNotMonotonic {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::Time { milliseconds, days } = event.kind else { return };
        let now = i64::from(days) * DAY + i64::from(milliseconds);
        let Some(last) = self.last.replace(now) else { return };
        let back = last - now;
        if back <= 0 {
            return context.count_pass();
        }
        context.start_finding(event).report_finding(|| {
            format!("TIME {}.{:03} s earlier than the previous message", back / 1_000, back % 1_000)
        });
    }
}
