//! A device goes on to produce SYNC though it was told not to.

use crate::event::{Event, EventKind, FrameRange, SdoTransfer};
use crate::rules::general::facts::{PRODUCES, number};
use crate::rules::rule::declare_rule;
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::ObjectAddress;

declare_rule! {
    /// # What it checks
    /// A device whose producer bit (bit 30 of 1005) was set and then cleared goes on to send SYNC: three more come at
    /// the old pace, and no other node is known to produce it. Who else may send SYNC is often not on the bus, so
    /// nothing else is judged; while a conformance test waits for silence any SYNC counts.
    ///
    /// # Why it matters
    /// Two producers on one bus: devices work at twice the rate, outputs change between the controller's cycles.
    ///
    /// # Source
    /// CiA 301 §7.2.5.2, §7.5.2.5 (1005, bit 30 "gen.")
    ///
    /// # What to look at first
    /// 1005 and 1006 of all nodes; whether the master took over the same period.
    ///
    /// # Mutation
    /// clear bit 30 of 1005 in the middle
    "sync-producer", Warning, "SYNC goes on though its producer was switched off",
    kinds: ["sync", "sdo-transfer", "boot-up", "test-case"],
    cases: &["6.2", "6.4", "9.2", "9.3"],
    word: "SYNC",
}

const COB_ID_SYNC: ObjectAddress = ObjectAddress::new(0x1005, 0);

/// SYNCs at the old pace from which on it is no chance.
const IN_A_ROW: u8 = 3;

/// A node that stopped producing, as it says.
struct Cleared {
    node: NodeId,
    frame: u64,
    /// Its bit had been set in this capture.
    was_set: bool,
    /// Pace before, where it is known.
    period: Option<i64>,
    in_a_row: u8,
}

#[derive(Default)]
struct SyncProducer {
    /// Nodes by their bit as it was last seen.
    produces: NodeMap<bool>,
    /// Of one of them it is set.
    is_produced: bool,
    /// Time of the last SYNC, and the interval before it.
    last: Option<(i64, Option<i64>)>,
    cleared: Option<Cleared>,
    /// A case of a conformance test is open.
    is_in_case: bool,
}

fn new(_policy: &Policy) -> SyncProducer {
    SyncProducer::default()
}

impl SyncProducer {
    fn learn(&mut self, event: &Event, node: NodeId, transfer: &SdoTransfer) {
        let Some(value) = number(transfer).filter(|_| transfer.object == Some(COB_ID_SYNC)) else { return };
        let produces = value & PRODUCES != 0;
        let before = self.produces.get(node).copied();
        self.produces.insert(node, produces);
        self.count();
        let was_set = before == Some(true);
        if produces {
            self.cleared = None;
        } else if was_set || self.is_in_case && self.cleared.is_none() {
            let period = self.last.and_then(|(_, interval)| interval).filter(|_| was_set);
            self.cleared = Some(Cleared { node, frame: event.frames.last, was_set, period, in_a_row: 0 });
        }
    }

    fn count(&mut self) {
        self.is_produced = self.produces.iter().any(|(_, produces)| *produces);
    }

    fn sync(&mut self, event: &Event, context: &mut Context<'_>) {
        let now = context.now;
        let interval = self.last.map(|(last, _)| now.saturating_sub(last)).filter(|_| context.has_time);
        self.last = Some((now, interval));
        if self.is_produced {
            return context.pass();
        }
        let is_in_case = self.is_in_case;
        let Some(cleared) = &mut self.cleared else { return };
        let is_same = matches!((interval, cleared.period), (Some(interval), Some(period))
            if interval > 0 && interval.saturating_sub(period).abs() <= period / 10);
        cleared.in_a_row = if is_same { cleared.in_a_row.saturating_add(1) } else { 0 };
        let is_wrong = cleared.was_set && (is_in_case || cleared.in_a_row >= IN_A_ROW);
        if is_wrong {
            let (node, frame) = (cleared.node, cleared.frame);
            let frames = FrameRange { first: frame, last: event.frames.last };
            self.cleared = None;
            let alarm = context.fail(event).node(Some(node)).frames(frames);
            return alarm.say(|| format!("SYNC goes on behind {{{frame}}}, which cleared bit 30 of 1005"));
        }
        // Another one sends it: whose silence it would be, nobody can tell.
        if is_in_case || !is_same {
            self.cleared = None;
        }
    }
}

impl Rule for SyncProducer {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Sync { .. }, _) => self.sync(event, context),
            (EventKind::SdoTransfer(transfer), Some(node)) => self.learn(event, node, transfer),
            (EventKind::BootUp { .. }, Some(node)) => {
                self.produces.remove(node);
                self.count();
                if self.cleared.as_ref().is_some_and(|cleared| cleared.node == node) {
                    self.cleared = None;
                }
            }
            (EventKind::TestCase(marker), _) => {
                let is_end = marker.result.is_some();
                if self.cleared.take().is_some() && is_end && self.is_in_case {
                    context.pass();
                }
                self.is_in_case = !is_end;
            }
            _ => {}
        }
    }
}
