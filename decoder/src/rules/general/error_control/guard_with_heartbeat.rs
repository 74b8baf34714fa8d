//! A node answers guarding although its heartbeat is on.

use crate::event::{Event, EventKind};
use crate::rules::general::facts::sure;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeSet, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A node whose heartbeat is on (1017 is not 0) answers no guarding request. An answer is one with the toggle bit
    /// set: the others may be heartbeats that come behind a request.
    ///
    /// # Why it matters
    /// Both at once are not permitted: who watches the heartbeat sees bytes with bit 7 that are no state.
    ///
    /// # Source
    /// CiA 301 §7.2.8.2.2 (either of them), §7.5.2.20 (1017: the heartbeat goes before guarding)
    ///
    /// # What to look at first
    /// Why the master guards a node that sends heartbeats.
    ///
    /// # Mutation
    /// insert a write of 1017 while the node is guarded
    "guard-with-heartbeat", Warning, "a node answers guarding although its heartbeat is on",
    kinds: ["guard-request", "guard-reply"],
    cases: &["7.202", "7.203", "7.204", "7.205", "7.206", "7.207"],
    word: "GUARD",
}

#[derive(Default)]
struct GuardWithHeartbeat {
    asked: NodeSet,
}

fn new(_policy: &Policy) -> GuardWithHeartbeat {
    GuardWithHeartbeat::default()
}

impl Rule for GuardWithHeartbeat {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let (Some(id), Some(node)) = (event.node, context.node(event)) else { return };
        let wins = node.device().monitoring.wins.as_deref();
        let Some(time) = sure(node, 0x1017, 0).filter(|time| *time > 0 && wins != Some("guarding")) else {
            return;
        };
        match event.kind {
            // The request before this one had no answer.
            EventKind::GuardRequest if !self.asked.insert(id) => context.pass(),
            EventKind::GuardReply { toggle: true, .. } => {
                self.asked.remove(id);
                context.fail(event).say(|| format!("answers guarding; 1017 = {time} ms"));
            }
            _ => {}
        }
    }
}
