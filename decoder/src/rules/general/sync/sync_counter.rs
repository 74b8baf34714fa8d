//! The counter of SYNC.

use crate::event::{Event, EventKind};
use crate::rules::general::facts::{PRODUCES, sure};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, Policy, Rule};
use crate::session::Bus;
use crate::wire::NodeId;

declare_rule! {
    /// # What it checks
    /// The counter of SYNC counts up by one from 1; it is there if and only if the producer's overflow value (1019)
    /// says so, where the producer is known (bit 30 of its 1005), and does not run beyond that value.
    ///
    /// # Why it matters
    /// TPDOs with a SYNC start value lose their place in the cycle.
    ///
    /// # Source
    /// CiA 301 §7.2.5.3 (SYNC), §7.5.2.22 (1019)
    ///
    /// # What to look at first
    /// Whether frames were lost in the recording; two producers of SYNC.
    ///
    /// # Mutation
    /// drop a SYNC with a counter
    "sync-counter", Warning, "the counter of SYNC is wrong",
    kinds: ["sync"],
    cases: &["6.6", "6.7", "6.8"],
    shows: &["6.7"],
    word: "SYNC",
}

struct SyncCounter;

fn new(_policy: &Policy) -> SyncCounter {
    SyncCounter
}

/// The one node that is known to produce SYNC, with its overflow value.
fn producer(bus: &Bus) -> Option<(NodeId, u64)> {
    let produces = |cob_id: u64| cob_id & PRODUCES != 0;
    let mut all = bus.nodes().filter(|node| sure(node, 0x1005, 0).is_some_and(produces));
    let one = all.next().filter(|_| all.next().is_none())?;
    Some((one.id(), sure(one, 0x1019, 0)?))
}

impl Rule for SyncCounter {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let EventKind::Sync { counter, expected } = event.kind else { return };
        if let (Some(counter), Some(expected)) = (counter, expected) {
            return context.fail(event).say(|| format!("counter {counter} instead of {expected}"));
        }
        if let Some(counter @ (0 | 241..)) = counter {
            return context.fail(event).say(|| format!("counter {counter}, which is none of 1 to 240"));
        }
        // Looked up only where there is something to compare.
        if context.traffic.syncs() % 64 != 1 && counter.is_none() {
            return;
        }
        match (producer(context.bus), counter) {
            (Some((node, overflow @ 2..=240)), None) => {
                let alarm = context.fail(event).node(Some(node));
                alarm.say(|| format!("SYNC without a counter; 1019 = {overflow}"));
            }
            (Some((node, 0)), Some(counter)) => {
                let alarm = context.fail(event).node(Some(node));
                alarm.say(|| format!("SYNC with counter {counter}; 1019 = 0"));
            }
            (Some((node, overflow @ 2..=240)), Some(counter)) if u64::from(counter) > overflow => {
                let alarm = context.fail(event).node(Some(node));
                alarm.say(|| format!("counter {counter} runs beyond 1019 = {overflow}"));
            }
            (None, None) => {}
            _ => context.pass(),
        }
    }
}
