//! Guarding responses from a node that sends heartbeats.

use crate::event::{Event, EventKind, Kind, MonitoringMethod};
use crate::rules::general::facts::confirmed_number;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeSet;

declare_rule! {
    /// # What it checks
    /// A node with an active heartbeat (1017 is not 0) must not respond to guarding. Only responses with the
    /// toggle bit set count, because the others may be heartbeats that follow a request.
    ///
    /// # Why it matters
    /// Both at once are not permitted. Heartbeat consumers receive bytes with bit 7 set, which is not a valid
    /// state.
    ///
    /// # Source
    /// CiA 301 §7.2.8.2.2 (either of them), §7.5.2.20 (1017: the heartbeat takes precedence over guarding)
    ///
    /// # What to look at first
    /// Disable guarding of this node in the master.
    ///
    /// # Mutation
    /// insert a write of 1017 while the node is guarded
    "guard-with-heartbeat", Warning, "guarding response despite active heartbeat",
    kinds: [Kind::GuardRequest, Kind::GuardReply],
    needs: "a guarding request to a node whose 1017:00 is not 0",
    cases: &["7.202", "7.203", "7.204", "7.205", "7.206", "7.207"],
    word: "GUARD",
}

#[derive(Default)]
struct GuardWithHeartbeat {
    asked: NodeSet,
}

fn new(_policy: &RulePolicy) -> GuardWithHeartbeat {
    GuardWithHeartbeat::default()
}

impl Rule for GuardWithHeartbeat {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let (Some(id), Some(node)) = (event.node, context.event_node(event)) else { return };
        let is_guarded = node.device().monitoring.wins == Some(MonitoringMethod::Guarding);
        let Some(time) = confirmed_number(node, 0x1017, 0).filter(|time| *time > 0 && !is_guarded) else {
            return;
        };
        match event.kind {
            // The previous request had no response.
            EventKind::GuardRequest if !self.asked.insert(id) => context.count_pass(),
            EventKind::GuardReply { toggle: true, .. } => {
                self.asked.remove(id);
                context.start_finding(event).report_finding(|| {
                    format!("guarding response despite active heartbeat (1017:00 = {time} ms)")
                });
            }
            _ => {}
        }
    }
}
