//! An error that is reported again and again.

use crate::event::{EmcyAction, Event, EventKind};
use crate::finding::About;
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// An EMCY comes once an error: not again with the same code and the same bytes while nothing was cleared.
    ///
    /// # Why it matters
    /// Repetitions load the bus, with the highest priority behind SYNC, just when something is wrong.
    ///
    /// # Source
    /// CiA 301 §7.2.7.1 (transmitted once an error event)
    ///
    /// # What to look at first
    /// An error that comes and goes without 0000; the inhibit time of EMCY (1015).
    ///
    /// # Mutation
    /// duplicate an EMCY
    "emcy-repeated", Note, "an error is reported again while it is active",
    kinds: ["emcy", "boot-up"],
    word: "EMCY",
}

/// Errors of a node that are remembered.
const ACTIVE_LIMIT: usize = 64;

#[derive(Default)]
struct EmcyRepeated {
    active: NodeMap<Vec<(u16, [u8; 5], u64)>>,
}

fn new(_policy: &Policy) -> EmcyRepeated {
    EmcyRepeated::default()
}

impl Rule for EmcyRepeated {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        let EventKind::Emcy(emergency) = &event.kind else {
            self.active.remove(node);
            return;
        };
        let Some(active) = self.active.entry(node) else { return };
        let Some(code) = emergency.code.filter(|_| emergency.action == EmcyAction::Raised) else {
            active.clear();
            return;
        };
        let vendor = emergency.vendor;
        let before = active.iter().find(|(known, bytes, _)| (*known, *bytes) == (code, vendor));
        let Some((.., frame)) = before.copied() else {
            if active.len() < ACTIVE_LIMIT {
                active.push((code, vendor, event.frames.last));
            }
            return context.pass();
        };
        let alarm = context.fail(event).about(About::Code(code));
        alarm.say(|| format!("EMCY {code:04X} again as in {{{frame}}}, with no 0000 between"));
    }
}
