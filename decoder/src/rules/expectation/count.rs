//! `count`: limits for the number of events in the whole capture.

use super::plan::{Limits, QuotedExpression};
use super::subjects::Subjects;
use super::task::Task;
use crate::event::{Event, FrameRange};
use crate::rules::Context;
use crate::session::Node;
use crate::wire::NodeId;

pub(super) struct Count {
    when: QuotedExpression,
    limits: Limits<u64>,
    subjects: Subjects<u64>,
    is_per_node: bool,
}

pub(super) fn new(when: &QuotedExpression, limits: Limits<u64>, is_per_node: bool) -> Count {
    Count { when: when.clone(), limits, subjects: Subjects::new(is_per_node), is_per_node }
}

impl Task for Count {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if !self.when.matches(event, context) {
            return;
        }
        let Some((count, _)) = self.subjects.of(event.node) else { return };
        *count += 1;
        if let Some(max) = self.limits.max
            && *count > max
        {
            let (when, count) = (&self.when, *count);
            #[expect(clippy::cast_precision_loss, reason = "a count for comparing")]
            let alarm = context.fail(event).measure(count as f64);
            alarm.report(|| format!("match count {count} (max {max}): {when}"));
        }
    }

    fn finish(&mut self, known: bool, context: &mut Context<'_>) {
        if self.is_per_node && known {
            // A node that sent frames but no matching event has a count of 0.
            for node in context.bus.nodes().filter(|node| node.last_seen().0 > 0).map(Node::id) {
                let _ = self.subjects.of(Some(node));
            }
        }
        let (limits, when) = (self.limits, &self.when);
        self.subjects.for_each(|node, count| {
            if *count > 0 || known {
                judge(limits, when, node, *count, context);
            }
        });
    }

    fn idle(&self) -> String {
        self.when.idle()
    }
}

/// Checks the count at the end; a count above `max` was reported at once.
fn judge(
    limits: Limits<u64>,
    when: &QuotedExpression,
    node: Option<NodeId>,
    count: u64,
    context: &mut Context<'_>,
) {
    match limits {
        Limits { max: Some(max), .. } if count > max => {}
        Limits { min: Some(min), .. } if count < min => {
            let last = FrameRange::one(context.bus.last_frame());
            let alarm = context.fail_at(context.now, node, last);
            // Without a node, the finding is about the bus, independent of its protocol.
            let alarm = if node.is_some() { alarm } else { alarm.certain() };
            alarm.report(|| format!("match count {count} (min {min}): {when}"));
        }
        _ => context.pass(),
    }
}
