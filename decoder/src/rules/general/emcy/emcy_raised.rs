//! A device reports an error.

use crate::event::{EmcyAction, Event, EventKind};
use crate::finding::About;
use crate::query::record;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeSet, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::NmtState;

declare_rule! {
    /// # What it checks
    /// A device sends an EMCY message with a code other than 0000. One finding a code, until 0000 comes.
    ///
    /// # Why it matters
    /// The device itself says that something is wrong.
    ///
    /// # Source
    /// CiA 301 §7.2.7 (emergency object); codes by the device's manual.
    ///
    /// # What to look at first
    /// What the code means by the manual (`cobscope explain`), and what changed just before (`cobscope why`).
    ///
    /// # Mutation
    /// insert an EMCY with a generic error
    "emcy-raised", Warning, "a device reports an error",
    kinds: ["emcy", "nmt-state"],
    word: "EMCY",
}

/// Codes that wait for 0000, of all nodes; further ones are told and never closed.
const OPEN_LIMIT: usize = 4096;

#[derive(Default)]
struct EmcyRaised {
    was_operational: NodeSet,
    open: Vec<(NodeId, u16)>,
}

fn new(_policy: &Policy) -> EmcyRaised {
    EmcyRaised::default()
}

impl EmcyRaised {
    fn raised(&mut self, event: &Event, node: NodeId, code: u16, context: &mut Context<'_>) {
        // What a device tells while it starts is told again once it matters.
        let is_starting = context.node(event).is_some_and(|node| node.nmt().is_some());
        if is_starting && !self.was_operational.contains(node) {
            return;
        }
        if self.open.len() < OPEN_LIMIT && !self.open.contains(&(node, code)) {
            self.open.push((node, code));
        }
        let device = record::device(event, context.bus);
        let alarm = context.fail(event).about(About::Code(code)).ongoing();
        alarm.say(|| format!("EMCY {code:04X} {}", device.error_text(code)));
    }

    fn all_gone(&mut self, node: NodeId, context: &mut Context<'_>) {
        for (_, code) in self.open.extract_if(.., |(of, _)| *of == node) {
            context.close(Some(node), About::Code(code));
        }
    }
}

impl Rule for EmcyRaised {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::NmtState(change) if change.to == NmtState::Operational => {
                self.was_operational.insert(node);
            }
            EventKind::Emcy(emergency) => match (emergency.action, emergency.code) {
                (EmcyAction::Raised, Some(code)) => self.raised(event, node, code, context),
                (EmcyAction::Cleared, _) => context.pass(),
                _ => {
                    context.pass();
                    self.all_gone(node, context);
                }
            },
            _ => {}
        }
    }
}
