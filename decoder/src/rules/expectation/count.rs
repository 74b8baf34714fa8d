//! `count`: so many events come over the whole capture.

use super::plan::{Asked, Limits};
use super::subjects::Subjects;
use super::task::Task;
use super::words::nth;
use crate::event::{Event, FrameRange};
use crate::rules::Context;
use crate::session::Node;
use crate::wire::NodeId;

pub(super) struct Count {
    when: Asked,
    limits: Limits<u64>,
    subjects: Subjects<u64>,
    is_per_node: bool,
}

pub(super) fn new(when: &Asked, limits: Limits<u64>, is_per_node: bool) -> Count {
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
            alarm.say(|| format!("the {} that matches: {when}; at most {max}", nth(count)));
        }
    }

    fn finish(&mut self, known: bool, context: &mut Context<'_>) {
        if self.is_per_node && known {
            // A node that was heard and sent none of it has sent too few.
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

/// The count at the end: what is too much was told at once.
fn judge(limits: Limits<u64>, when: &Asked, node: Option<NodeId>, count: u64, context: &mut Context<'_>) {
    match limits {
        Limits { max: Some(max), .. } if count > max => {}
        Limits { min: Some(min), .. } if count < min => {
            let last = FrameRange::one(context.bus.last_frame());
            let alarm = context.fail_at(context.now, node, last);
            // Of no node it is about the bus, whatever its protocol.
            let alarm = if node.is_some() { alarm } else { alarm.certain() };
            alarm.say(|| format!("{count} matched: {when}; at least {min}"));
        }
        _ => context.pass(),
    }
}
