//! Nodes that start long after the capture begins.

use super::unexpected_boot::{boot_cause, is_first_frame};
use crate::event::{BootCause, Event, Kind};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::statistics::format_span;

declare_rule! {
    /// # What it checks
    /// The first frame of a node is a boot sign, later than `grace-ms` after the start of the capture, without
    /// an NMT reset. A node with earlier frames is judged by `unexpected-boot`.
    ///
    /// # Why it matters
    /// The node was switched on or connected later than the others: its supply is staged, it belongs to an
    /// implement, or it starts slowly. Until then the master had no contact with it.
    ///
    /// # Source
    /// CiA 301 §7.3.2.1 (boot-up). A power-on is never visible, so it is presumed.
    ///
    /// # What to look at first
    /// Check whether the node has a switched supply or is connected during operation. Otherwise measure its
    /// supply and its time from power-on to boot-up.
    ///
    /// # Mutation
    /// insert a boot-up of a new node late in the capture
    "late-start", Note, "node started later than the others",
    kinds: [Kind::BootUp, Kind::Emcy],
    needs: "a boot sign as the first frame of a node",
    is_timing: true,
    word: "START",
    tolerances: &[define_tolerance(
        "grace-ms", 10_000.0, "ms", "after the start of the capture, in which a node is expected to start",
    )],
}

struct LateStart {
    grace: i64,
    began: i64,
}

fn new(policy: &RulePolicy) -> LateStart {
    LateStart { grace: policy.tolerance_ns(&DECLARATION, "grace-ms"), began: 0 }
}

impl Rule for LateStart {
    fn begin_bus(&mut self, context: &mut RuleContext<'_>) {
        self.began = context.now;
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(cause) = boot_cause(event).filter(|_| is_first_frame(event, context)) else { return };
        let after = context.now.saturating_sub(self.began);
        let is_commanded = matches!(cause, BootCause::Commanded { .. });
        if is_commanded || !context.has_time || after < self.grace {
            return context.count_pass();
        }
        let limit = self.grace;
        context.start_finding(event).report_finding(|| {
            let (after, limit) = (format_span(after), format_span(limit));
            format!("late start: first frame {after} after the start of the capture > {limit}, no NMT reset before")
        });
    }
}
