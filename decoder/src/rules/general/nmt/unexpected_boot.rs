//! A node starts without having been told to.

use crate::event::{BootCause, Event, EventKind};
use crate::finding::Severity;
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeSet, Policy, Rule};

declare_rule! {
    /// # What it checks
    /// A boot sign (boot-up message, empty EMCY message, or what else the device's manual names) comes without
    /// an NMT reset to the node, or to all, since its last frame.
    ///
    /// # Why it matters
    /// Supply, watchdog or firmware restarted the device: settings that were not stored are gone, outputs were off.
    ///
    /// # Source
    /// CiA 301 §7.3.2.1 (boot-up), §7.2.8.2 (NMT). A power-on is never visible, so it is presumed.
    ///
    /// # What to look at first
    /// The supply of the node in that moment, other nodes that restarted together, the last EMCY before.
    ///
    /// # Mutation
    /// insert a boot-up of an operational node
    "unexpected-boot", Warning, "a node restarted and nobody told it to",
    kinds: ["boot-up", "emcy"],
    cases: &["9.1"],
    word: "BOOT",
    tolerances: &[tolerance(
        "grace-ms", 10_000.0, "ms", "from the beginning of the capture, in which a node's first boot sign is expected",
    )],
}

struct UnexpectedBoot {
    grace: i64,
    began: Option<i64>,
    seen: NodeSet,
}

fn new(policy: &Policy) -> UnexpectedBoot {
    let grace = policy.nanoseconds(&DECLARATION, "grace-ms");
    UnexpectedBoot { grace, began: None, seen: NodeSet::default() }
}

impl Rule for UnexpectedBoot {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let began = *self.began.get_or_insert(context.now);
        let cause = match &event.kind {
            EventKind::BootUp { cause, .. } => *cause,
            EventKind::Emcy(emergency) => match emergency.boot {
                Some(cause) => cause,
                None => return,
            },
            _ => return,
        };
        let Some(node) = event.node else { return };
        let is_first = self.seen.insert(node);
        let BootCause::PresumedPowerOn { sign } = cause else { return context.pass() };
        if is_first && context.now.saturating_sub(began) < self.grace {
            return context.pass();
        }
        // A machine that is switched on starts its nodes together: worth knowing, no defect of this one.
        let severity = if sign.is_some() { Severity::Note } else { Severity::Warning };
        context.fail(event).severity(severity).say(|| {
            let sign = sign.map_or_else(String::new, |sign| format!(", {}", sign.words()));
            format!("restarted without an NMT reset: power-on or a restart of its own{sign}")
        });
    }
}
