//! SYNC counter against its sequence and the overflow value (1019).

use crate::event::{Event, EventKind, Kind};
use crate::rules::general::facts::{PRODUCES, confirmed_number};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::{Bus, Node};
use crate::wire::NodeId;

declare_rule! {
    /// # What it checks
    /// The SYNC counter must count up by one from 1. If the producer is known (bit 30 of its 1005), its
    /// overflow value (1019) determines whether there is a counter, and its maximum. If it is unknown, no node
    /// may have the overflow value 0 while SYNC has a counter.
    ///
    /// # Why it matters
    /// TPDOs with a SYNC start value lose their position in the cycle.
    ///
    /// # Source
    /// CiA 301 §7.2.5.3 (SYNC), §7.5.2.22 (1019)
    ///
    /// # What to look at first
    /// Check the bus for a second SYNC producer. Check the capture for lost frames.
    ///
    /// # Mutation
    /// drop a SYNC with a counter
    "sync-counter", Warning, "wrong SYNC counter",
    kinds: [Kind::Sync],
    needs: "SYNC with a counter, or 1019:00 of its producer",
    cases: &["6.6", "6.7", "6.8"],
    shows: &["6.7"],
    word: "SYNC",
}

#[derive(Default)]
struct SyncCounter {
    last_frame: u64,
}

fn new(_policy: &RulePolicy) -> SyncCounter {
    SyncCounter::default()
}

/// The only confirmed SYNC producer, with its overflow value.
fn confirmed_producer(bus: &Bus) -> Option<(NodeId, u64)> {
    let produces = |cob_id: u64| cob_id & PRODUCES != 0;
    let mut all = bus.nodes().filter(|node| confirmed_number(node, 0x1005, 0).is_some_and(produces));
    let one = all.next().filter(|_| all.next().is_none())?;
    Some((one.id(), confirmed_number(one, 0x1019, 0)?))
}

/// First node that expects SYNC without a counter.
fn counterless_consumer(bus: &Bus) -> Option<NodeId> {
    bus.nodes().find(|node| confirmed_number(node, 0x1019, 0) == Some(0)).map(Node::id)
}

impl Rule for SyncCounter {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let EventKind::Sync { counter, expected } = event.kind else { return };
        let before = std::mem::replace(&mut self.last_frame, event.frames.last);
        if let (Some(counter), Some(expected)) = (counter, expected) {
            // Values that are missing after a silence of the bus are a statement about the capture.
            if context.is_across_hole(before) {
                return;
            }
            return context
                .start_finding(event)
                .report_finding(|| format!("SYNC counter {counter} (expected {expected})"));
        }
        if let Some(counter @ (0 | 241..)) = counter {
            return context
                .start_finding(event)
                .report_finding(|| format!("SYNC counter {counter} out of range (1 to 240)"));
        }
        // Without a counter, the look-up is limited to every 64th SYNC.
        if context.traffic.sync_count() % 64 != 1 && counter.is_none() {
            return;
        }
        match (confirmed_producer(context.bus), counter) {
            (Some((node, overflow @ 2..=240)), None) => {
                let alarm = context.start_finding(event).at_node(Some(node));
                alarm.report_finding(|| format!("SYNC without counter (1019:00 = {overflow})"));
            }
            (Some((node, 0)), Some(counter)) => {
                let alarm = context.start_finding(event).at_node(Some(node));
                alarm.report_finding(|| format!("SYNC with counter {counter} (1019:00 = 0)"));
            }
            (Some((node, overflow @ 2..=240)), Some(counter)) if u64::from(counter) > overflow => {
                let alarm = context.start_finding(event).at_node(Some(node));
                alarm.report_finding(|| format!("SYNC counter {counter} > {overflow} (1019:00)"));
            }
            (None, None) => {}
            (None, Some(counter)) => {
                let Some(node) = counterless_consumer(context.bus) else { return context.count_pass() };
                let alarm = context.start_finding(event).at_node(Some(node));
                alarm.report_finding(|| format!("SYNC with counter {counter}, but 1019:00 = 0 in this node"));
            }
            _ => context.count_pass(),
        }
    }
}
