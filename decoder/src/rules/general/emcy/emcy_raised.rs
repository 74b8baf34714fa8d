//! Errors that a device reports by EMCY.

use std::collections::BTreeMap;

use crate::event::{Certainty, EmcyAction, Event, EventKind, Kind};
use crate::finding::About;
use crate::profile::suggested_error_text;
use crate::query::record;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
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
    kinds: [Kind::Emcy, Kind::NmtState, Kind::BootUp],
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
    /// Time of the first event of a node, in the clock of the bus: the boot may be before the capture.
    first: BTreeMap<NodeId, i64>,
    open: Vec<(NodeId, u16)>,
    early: Vec<Early>,
}

fn new(_policy: &Policy) -> EmcyRaised {
    EmcyRaised::default()
}

impl EmcyRaised {
    fn raised(&mut self, event: &Event, node: NodeId, code: u16, context: &mut Context<'_>) {
        if self.early.iter().any(|early| (early.node, early.code) == (node, code)) {
            return;
        }
        match self.rest_of_start(event, node, context).filter(|rest| *rest > 0) {
            Some(rest) => self.wait(event, (node, code), rest, context),
            None => self.report(event, Shown::Directly, (node, code), context),
        }
    }

    /// Rest of [`START`] in ns; `None` for a node that was operational, or whose state is unknown.
    fn rest_of_start(&self, event: &Event, node: NodeId, context: &Context<'_>) -> Option<i64> {
        let known = context.node(event).filter(|known| known.nmt().is_some())?;
        if self.was_operational.contains(node) {
            return None;
        }
        let boot = known.started().map(|(_, boot)| boot).or_else(|| self.first.get(&node).copied());
        let age = boot.map_or(0, |boot| context.bus.now().saturating_sub(boot));
        Some(START.saturating_sub(age))
    }

    /// Waits until the node is operational or the rest of [`START`] has passed.
    fn wait(&mut self, event: &Event, (node, code): (NodeId, u16), rest: i64, context: &mut Context<'_>) {
        if self.early.len() >= OPEN_LIMIT {
            return;
        }
        let due = context.now.saturating_add(rest);
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

    /// Reports an error at the time of its EMCY: the duration and the frame of the finding are those of this time.
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
        let (is_presumed, until) = match shown {
            Shown::Directly => (event.presumed, ""),
            Shown::Operational(shown) => {
                (shown.presumed, "; reported before the node was operational, not cleared since")
            }
            Shown::Late => {
                (!context.bus.is_settled(Some(node)), "; reported at power-on, not cleared within 5 s")
            }
        };
        let alarm = context.fail(event).presumed(is_presumed).ongoing().about(About::Code(code));
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
        self.first.entry(node).or_insert(context.bus.now());
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
