//! TIME runs backwards.

use crate::event::{Event, EventKind};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// Each TIME message tells a later time than the one before, or the same.
    ///
    /// # Why it matters
    /// Logs of devices get out of order; two producers make the clock jump to and fro.
    ///
    /// # Source
    /// CiA 301 §7.2.6 (time stamp object)
    ///
    /// # What to look at first
    /// Whether somebody set the clock; two producers of TIME (bit 30 of 1012).
    ///
    /// # Mutation
    /// swap two TIME messages
    "time-not-monotonic", Warning, "TIME runs backwards",
    kinds: ["time"],
    word: "TIME",
}

#[derive(Default)]
struct TimeNotMonotonic {
    /// Milliseconds since 1984.
    last: Option<i64>,
}

fn new(_policy: &Policy) -> TimeNotMonotonic {
    TimeNotMonotonic::default()
}

/// Milliseconds of a day.
const DAY: i64 = 86_400_000;

impl Rule for TimeNotMonotonic {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::Time { milliseconds, days } = event.kind else { return };
        let now = i64::from(days) * DAY + i64::from(milliseconds);
        let Some(last) = self.last.replace(now) else { return };
        let back = last - now;
        if back <= 0 {
            return context.pass();
        }
        context.fail(event).say(|| format!("TIME goes back by {}.{:03} s", back / 1_000, back % 1_000));
    }
}
