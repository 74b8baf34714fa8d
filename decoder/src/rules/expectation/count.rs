//! `count`: limits for the number of events in the whole capture.

use super::plan::{QuotedExpression, ValueLimits};
use super::subjects::ExpectationSubjects;
use super::task::ExpectationTask;
use crate::event::{Event, FrameRange};
use crate::rules::RuleContext;
use crate::session::Node;
use crate::wire::NodeId;

pub(super) struct CountTask {
    when: QuotedExpression,
    limits: ValueLimits<u64>,
    subjects: ExpectationSubjects<u64>,
    is_per_node: bool,
}

pub(super) fn new(when: &QuotedExpression, limits: ValueLimits<u64>, is_per_node: bool) -> CountTask {
    CountTask { when: when.clone(), limits, subjects: ExpectationSubjects::new(is_per_node), is_per_node }
}

impl ExpectationTask for CountTask {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if !self.when.matches_event(event, context) {
            return;
        }
        let Some((count, _)) = self.subjects.state_of(event.node) else { return };
        *count += 1;
        if let Some(max) = self.limits.max
            && *count > max
        {
            let (when, count) = (&self.when, *count);
            #[expect(clippy::cast_precision_loss, reason = "a count for comparing")]
            let alarm = context.start_finding(event).with_measure(count as f64);
            alarm.report_finding(|| format!("match count {count} (max {max}): {when}"));
        }
    }

    fn on_end(&mut self, known: bool, context: &mut RuleContext<'_>) {
        if self.is_per_node && known {
            // A node that sent frames but no matching event has a count of 0.
            for node in context.bus.nodes().filter(|node| node.last_seen().0 > 0).map(Node::id) {
                let _ = self.subjects.state_of(Some(node));
            }
        }
        let (limits, when) = (self.limits, &self.when);
        self.subjects.for_each(|node, count| {
            if *count > 0 || known {
                judge_count(limits, when, node, *count, context);
            }
        });
    }

    fn idle_reason(&self) -> String {
        self.when.idle_reason()
    }
}

/// Checks the count at the end; a count above `max` was reported at once.
fn judge_count(
    limits: ValueLimits<u64>,
    when: &QuotedExpression,
    node: Option<NodeId>,
    count: u64,
    context: &mut RuleContext<'_>,
) {
    match limits {
        ValueLimits { max: Some(max), .. } if count > max => {}
        ValueLimits { min: Some(min), .. } if count < min => {
            let last = FrameRange::one(context.bus.last_frame());
            let alarm = context.fail_at(context.now, node, last);
            // Without a node, the finding is about the bus, independent of its protocol.
            let alarm = if node.is_some() { alarm } else { alarm.mark_certain() };
            alarm.report_finding(|| format!("match count {count} (min {min}): {when}"));
        }
        _ => context.count_pass(),
    }
}
