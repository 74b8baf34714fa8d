//! Toggle bits of guarding.

use crate::event::{Event, EventKind};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeSet, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// The toggle bit of a node's answers to guarding alternates. Heartbeats that happen to come behind a request
    /// are none, and answers between which heartbeats come are not judged: one may have been taken for the other.
    ///
    /// # Why it matters
    /// It is how the master knows that an answer is a new one: else a controller that repeats its last frame passes
    /// for a node that works.
    ///
    /// # Source
    /// CiA 301 §7.2.8.3.2.1 (node guarding)
    ///
    /// # What to look at first
    /// Whether answers are missing in the recording; whether two masters guard the node.
    ///
    /// # Mutation
    /// flip bit 7 of an answer to guarding
    "guard-toggle", Warning, "the toggle bit of guarding does not alternate",
    kinds: ["guard-reply", "heartbeat", "boot-up"],
    cases: &["7.3", "7.203"],
    shows: &["7.3"],
    word: "GUARD",
}

#[derive(Default)]
struct GuardToggle {
    /// Nodes that toggled: they answer guarding.
    toggling: NodeSet,
    /// Nodes that send heartbeats.
    beating: NodeSet,
    /// Nodes that sent one since their last answer.
    between: NodeSet,
}

fn new(_policy: &Policy) -> GuardToggle {
    GuardToggle::default()
}

impl Rule for GuardToggle {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
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
                    context.pass();
                } else if is_guarded {
                    let toggle = u8::from(*toggle);
                    context
                        .fail(event)
                        .say(|| format!("toggle bit {toggle} again in the answer to guarding"));
                }
            }
            _ => {}
        }
    }
}
