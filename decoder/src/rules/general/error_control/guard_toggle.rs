//! Toggle bit of guarding responses.

use crate::event::{Event, EventKind, Kind};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeSet;

declare_rule! {
    /// # What it checks
    /// The toggle bit of the guarding responses of a node must alternate. Responses with heartbeats between
    /// them are exempt, because a heartbeat after a request looks like a response.
    ///
    /// # Why it matters
    /// The toggle bit shows the master that a response is new. Without it, a stuck controller that repeats
    /// its last frame looks like a working node.
    ///
    /// # Source
    /// CiA 301 §7.2.8.3.2.1 (node guarding)
    ///
    /// # What to look at first
    /// Check whether responses are missing in the capture. Check whether two masters guard the node.
    ///
    /// # Mutation
    /// flip bit 7 of a guarding response
    "guard-toggle", Warning, "guarding toggle bit not alternating",
    kinds: [Kind::GuardReply, Kind::Heartbeat, Kind::BootUp],
    needs: "two guarding responses of a node",
    cases: &["7.3", "7.203"],
    shows: &["7.3"],
    word: "GUARD",
}

#[derive(Default)]
struct GuardToggle {
    /// Nodes that set the toggle bit, and therefore respond to guarding.
    toggling: NodeSet,
    /// Nodes that send heartbeats.
    beating: NodeSet,
    /// Nodes with a heartbeat since their last response.
    between: NodeSet,
}

fn new(_policy: &RulePolicy) -> GuardToggle {
    GuardToggle::default()
}

impl Rule for GuardToggle {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Heartbeat { .. } => {
                self.beating.insert(node);
                self.between.insert(node);
            }
            EventKind::BootUp { .. } => {
                self.beating.remove(node);
                self.toggling.remove(node);
                self.between.remove(node);
            }
            EventKind::GuardReply { toggle, toggle_error, .. } => {
                if *toggle {
                    self.toggling.insert(node);
                }
                let is_apart = !self.between.remove(node);
                let is_guarded = is_apart && self.toggling.contains(node) || !self.beating.contains(node);
                if !toggle_error {
                    context.count_pass();
                } else if is_guarded {
                    let toggle = u8::from(*toggle);
                    context
                        .start_finding(event)
                        .report_finding(|| format!("guarding response repeats toggle bit {toggle}"));
                }
            }
            _ => {}
        }
    }
}
