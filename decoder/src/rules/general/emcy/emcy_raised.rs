//! Errors that a device reports by EMCY.

use crate::event::{Certainty, EmcyAction, Event, EventKind};
use crate::finding::About;
use crate::profile::suggested_error_text;
use crate::query::record;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::session::Node;
use crate::wire::canopen::NmtState;
use crate::wire::{NodeId, NodeSet};

declare_rule! {
    /// # What it checks
    /// A device sends an EMCY with a code other than 0000. There is one finding per code, open until EMCY
    /// 0000. A device that starts has 5 s after its boot to clear an error, at most until it is operational.
    ///
    /// # Why it matters
    /// The device itself reports an error.
    ///
    /// # Source
    /// CiA 301 §7.2.7 (emergency object); error codes: manual of the device.
    ///
    /// # What to look at first
    /// Look up the error code in the device manual. `cobscope explain` shows its meaning, and `cobscope why`
    /// the events before it.
    ///
    /// # Mutation
    /// insert an EMCY with a generic error
    "emcy-raised", Warning, "error reported by EMCY",
    kinds: ["emcy", "nmt-state", "boot-up"],
    needs: "an EMCY",
    word: "EMCY",
}

/// Maximum number of open error codes of all nodes; the findings of further codes stay open.
const OPEN_LIMIT: usize = 4096;

/// Time in ns after its boot in which a device may clear an error that it reported at power-on.
const START: i64 = 5_000_000_000;

/// An error reported before its node was operational. An EMCY is sent once (CiA 301 §7.2.7.1), so it is not
/// reported again.
struct Early {
    node: NodeId,
    code: u16,
    due: i64,
    event: Event,
}

/// Event that shows a finding.
#[derive(Clone, Copy)]
enum Shown<'a> {
    /// The EMCY itself.
    Directly,
    /// The state operational, while the error is active.
    Operational(&'a Event),
    /// No event: [`START`] has passed.
    Late,
}

#[derive(Default)]
struct EmcyRaised {
    was_operational: NodeSet,
    open: Vec<(NodeId, u16)>,
    early: Vec<Early>,
}

fn new(_policy: &Policy) -> EmcyRaised {
    EmcyRaised::default()
}

impl EmcyRaised {
    fn raised(&mut self, event: &Event, node: NodeId, code: u16, context: &mut Context<'_>) {
        let is_starting = context.node(event).is_some_and(|node| node.nmt().is_some());
        if is_starting && !self.was_operational.contains(node) {
            return self.wait(event, node, code, context);
        }
        self.report(event, Shown::Directly, (node, code), context);
    }

    /// Waits until the node is operational or [`START`] has passed since its boot.
    fn wait(&mut self, event: &Event, node: NodeId, code: u16, context: &mut Context<'_>) {
        let is_known = self.early.iter().any(|early| (early.node, early.code) == (node, code));
        if is_known || self.early.len() >= OPEN_LIMIT {
            return;
        }
        let boot = context.node(event).and_then(Node::started);
        let age = boot.map_or(0, |(_, boot)| context.bus.now().saturating_sub(boot));
        let due = context.now.saturating_add(START.saturating_sub(age).max(0));
        self.early.push(Early { node, code, due, event: event.clone() });
        context.wake_at(due, 0);
    }

    /// Reports errors of a starting node that were not cleared.
    fn report_early(&mut self, shown: Shown<'_>, is_due: impl Fn(&Early) -> bool, context: &mut Context<'_>) {
        let due: Vec<Early> = self.early.extract_if(.., |early| is_due(early)).collect();
        for early in due {
            self.report(&early.event, shown, (early.node, early.code), context);
        }
    }

    /// Reports an error.
    fn report(
        &mut self,
        event: &Event,
        shown: Shown<'_>,
        (node, code): (NodeId, u16),
        context: &mut Context<'_>,
    ) {
        if self.open.len() < OPEN_LIMIT && !self.open.contains(&(node, code)) {
            self.open.push((node, code));
        }
        let device = record::device(event, context.bus);
        let (alarm, until) = match shown {
            Shown::Directly => (context.fail(event).ongoing(), ""),
            Shown::Operational(shown) => (
                context.fail(shown).since(event.time),
                "; reported before the node was operational, not cleared since",
            ),
            Shown::Late => (
                context.fail_at(context.now, Some(node), event.frames).since(event.time),
                "; reported at power-on, not cleared within 5 s",
            ),
        };
        let alarm = alarm.frames(event.frames).about(About::Code(code));
        alarm.report(|| match suggested_error_text(code).filter(|_| device.error(code).is_none()) {
            Some((profile, text)) => {
                format!("EMCY {code:04X} {}; {profile}: {text}?{until}", device.error_text(code))
            }
            None => format!("EMCY {code:04X} {}{until}", device.error_text(code)),
        });
    }

    fn all_gone(&mut self, node: NodeId, context: &mut Context<'_>) {
        self.early.retain(|early| early.node != node);
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
                if change.certainty == Certainty::Confirmed {
                    self.report_early(Shown::Operational(event), |early| early.node == node, context);
                }
            }
            // A restart ends the errors of the time before it.
            EventKind::BootUp { .. } => self.early.retain(|early| early.node != node),
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
    fn wake(&mut self, _token: u64, context: &mut Context<'_>) {
        let now = context.now;
        self.report_early(Shown::Late, |early| early.due <= now, context);
    }
}
