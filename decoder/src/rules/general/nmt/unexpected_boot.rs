//! Node restarts without an NMT reset.

use crate::event::{BootCause, Event, EventKind, Kind, StateCertainty};
use crate::finding::Severity;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::Node;
use crate::wire::NodeSet;
use crate::wire::canopen::NmtState;

declare_rule! {
    /// # What it checks
    /// A boot sign occurs although no NMT reset was sent to the node, or to all nodes, since its last frame.
    /// Boot signs are the boot-up message, an empty EMCY, or another sign in the device manual. It is a note
    /// if the whole machine seems to be switched on. The first boot sign of a node within `grace-ms` passes,
    /// unless the node was operational before. The first frame of a node is judged by `late-start`.
    ///
    /// # Why it matters
    /// Supply, watchdog or firmware restarted the device. Settings that were not stored are lost, and outputs
    /// were off.
    ///
    /// # Source
    /// CiA 301 §7.3.2.1 (boot-up), §7.2.8.2 (NMT). A power-on is never visible, so it is presumed.
    ///
    /// # What to look at first
    /// Check the supply of the node at that time. Look for other nodes that restarted together, and for the
    /// last EMCY.
    ///
    /// # Mutation
    /// insert a boot-up of an operational node
    "unexpected-boot", Warning, "node restarted without an NMT reset",
    kinds: [Kind::BootUp, Kind::Emcy, Kind::NmtState],
    needs: "a boot sign",
    cases: &["9.1"],
    word: "BOOT",
    tolerances: &[define_tolerance(
        "grace-ms", 10_000.0, "ms", "after the start of the capture, in which the first boot sign of a node is expected",
    )],
}

struct UnexpectedBoot {
    grace: i64,
    began: i64,
    /// Nodes without grace: booted or operational in the capture.
    seen: NodeSet,
}

fn new(policy: &RulePolicy) -> UnexpectedBoot {
    let grace = policy.tolerance_ns(&DECLARATION, "grace-ms");
    UnexpectedBoot { grace, began: 0, seen: NodeSet::default() }
}

/// Cause of the restart that an event shows.
pub(in crate::rules::general) fn boot_cause(event: &Event) -> Option<BootCause> {
    match &event.kind {
        EventKind::BootUp { cause, .. } => Some(*cause),
        EventKind::Emcy(emergency) => emergency.boot,
        _ => None,
    }
}

/// Whether the event is the first frame of its node.
pub(super) fn is_first_frame(event: &Event, context: &RuleContext<'_>) -> bool {
    context
        .event_node(event)
        .is_some_and(|node| node.first_seen() == event.frames.first && !node.was_present())
}

impl Rule for UnexpectedBoot {
    fn begin_bus(&mut self, context: &mut RuleContext<'_>) {
        self.began = context.now;
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        if let EventKind::NmtState(change) = &event.kind
            && (change.to, change.certainty) == (NmtState::Operational, StateCertainty::Confirmed)
        {
            self.seen.insert(node);
        }
        let Some(cause) = boot_cause(event) else { return };
        let is_first = self.seen.insert(node);
        let BootCause::PresumedPowerOn { sign } = cause else { return context.count_pass() };
        let was_present = context.event_node(event).is_some_and(Node::was_present);
        let is_graced = is_first && !was_present && context.now.saturating_sub(self.began) < self.grace;
        if is_graced || is_first_frame(event, context) {
            return context.count_pass();
        }
        // Nodes that start together indicate a power-on of the machine, which is not a defect of this node.
        let severity = if sign.is_some() { Severity::Note } else { Severity::Warning };
        context.start_finding(event).with_severity(severity).report_finding(|| {
            let sign = sign.map_or_else(String::new, |sign| format!("; {}", sign.words()));
            format!("unexpected boot-up: power cycle or self-reset (no NMT reset before{sign})")
        });
    }
}
