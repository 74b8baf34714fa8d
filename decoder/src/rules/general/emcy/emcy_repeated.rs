//! Repeated EMCY messages for one active error.

use crate::event::{EmcyAction, Event, EventKind, Kind};
use crate::finding::FindingSubject;
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::NodeMap;

declare_rule! {
    /// # What it checks
    /// A node sends an EMCY with the same code and bytes again although no error was cleared since.
    ///
    /// # Why it matters
    /// Repeated EMCY messages load the bus at a priority just below SYNC, at the moment of an error.
    ///
    /// # Source
    /// CiA 301 §7.2.7.1 (transmitted once per error event)
    ///
    /// # What to look at first
    /// Check whether the error disappears without EMCY 0000. Check the inhibit time of EMCY (1015).
    ///
    /// # Mutation
    /// duplicate an EMCY
    "emcy-repeated", Note, "EMCY repeated while the error is active",
    kinds: [Kind::Emcy, Kind::BootUp],
    needs: "two EMCYs with an error from one node",
    word: "EMCY",
}

/// Maximum number of active errors per node.
const ACTIVE_LIMIT: usize = 64;

#[derive(Default)]
struct EmcyRepeated {
    active: NodeMap<Vec<(u16, [u8; 5], u64)>>,
}

fn new(_policy: &RulePolicy) -> EmcyRepeated {
    EmcyRepeated::default()
}

impl Rule for EmcyRepeated {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
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
            return context.count_pass();
        };
        let alarm = context.start_finding(event).with_subject(FindingSubject::Code(code));
        alarm.report_finding(|| format!("EMCY {code:04X} repeated without EMCY 0000 since {{{frame}}}"));
    }
}
