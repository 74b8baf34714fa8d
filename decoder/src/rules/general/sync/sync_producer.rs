//! SYNC from a node whose producer bit was cleared.

use crate::event::{Event, EventKind, FrameRange, Kind, SdoTransfer};
use crate::rules::general::facts::{PRODUCES, transfer_number};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::wire::canopen::ObjectAddress;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// After the producer bit (bit 30 of 1005) of a device was cleared, three SYNCs still arrive with the
    /// previous period, and no other producer is known. Other cases are exempt, because unknown producers are
    /// common. While a conformance test waits for silence, any SYNC counts.
    ///
    /// # Why it matters
    /// With two producers on one bus, devices work at twice the rate, and outputs change between the cycles
    /// of the controller.
    ///
    /// # Source
    /// CiA 301 §7.2.5.2, §7.5.2.5 (1005, bit 30 "gen.")
    ///
    /// # What to look at first
    /// Check bit 30 of 1005 in all nodes. Check whether the master now sends SYNC with the same period.
    ///
    /// # Mutation
    /// clear bit 30 of 1005 in the middle
    "sync-producer", Warning, "SYNC still sent after producer was disabled",
    kinds: [Kind::Sync, Kind::SdoTransfer, Kind::BootUp, Kind::TestCase],
    transfers: TransferSubset::Communication,
    needs: "bit 30 of 1005:00 cleared in the capture",
    cases: &["6.2", "6.4", "9.2", "9.3"],
    word: "SYNC",
}

const COB_ID_SYNC: ObjectAddress = ObjectAddress::new(0x1005, 0);

/// Consecutive SYNCs with the previous period that rule out a coincidence.
const IN_A_ROW: u8 = 3;

/// Node whose producer bit was cleared.
struct ClearedProducer {
    node: NodeId,
    frame: u64,
    /// The bit was set earlier in this capture.
    was_set: bool,
    /// SYNC period before, in nanoseconds, if known.
    period: Option<i64>,
    in_a_row: u8,
}

#[derive(Default)]
struct SyncProducer {
    /// Latest producer bit per node.
    produces: NodeMap<bool>,
    /// At least one producer bit is set.
    is_produced: bool,
    /// Time of the last SYNC, and the interval before it.
    last: Option<(i64, Option<i64>)>,
    cleared: Option<ClearedProducer>,
    /// A case of a conformance test is open.
    is_in_case: bool,
}

fn new(_policy: &RulePolicy) -> SyncProducer {
    SyncProducer::default()
}

impl SyncProducer {
    fn learn_producer(&mut self, event: &Event, node: NodeId, transfer: &SdoTransfer) {
        let Some(value) = transfer_number(transfer).filter(|_| transfer.object == Some(COB_ID_SYNC)) else {
            return;
        };
        let produces = value & PRODUCES != 0;
        let before = self.produces.get(node).copied();
        self.produces.insert(node, produces);
        self.count_sync();
        let was_set = before == Some(true);
        if produces {
            self.cleared = None;
        } else if was_set || self.is_in_case && self.cleared.is_none() {
            let period = self.last.and_then(|(_, interval)| interval).filter(|_| was_set);
            self.cleared =
                Some(ClearedProducer { node, frame: event.frames.last, was_set, period, in_a_row: 0 });
        }
    }

    fn count_sync(&mut self) {
        self.is_produced = self.produces.iter().any(|(_, produces)| *produces);
    }

    fn on_sync(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let now = context.now;
        let interval = self.last.map(|(last, _)| now.saturating_sub(last)).filter(|_| context.has_time);
        self.last = Some((now, interval));
        if self.is_produced {
            return context.count_pass();
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
            let alarm = context.start_finding(event).at_node(Some(node)).with_frames(frames);
            return alarm
                .report_finding(|| format!("SYNC still sent after 1005:00 bit 30 was cleared {{{frame}}}"));
        }
        // Another producer sends it, so the node cannot be identified.
        if is_in_case || !is_same {
            self.cleared = None;
        }
    }
}

impl Rule for SyncProducer {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Sync { .. }, _) => self.on_sync(event, context),
            (EventKind::SdoTransfer(transfer), Some(node)) => self.learn_producer(event, node, transfer),
            (EventKind::BootUp { .. }, Some(node)) => {
                self.produces.remove(node);
                self.count_sync();
                if self.cleared.as_ref().is_some_and(|cleared| cleared.node == node) {
                    self.cleared = None;
                }
            }
            (EventKind::TestCase(marker), _) => {
                let is_end = marker.result.is_some();
                if self.cleared.take().is_some() && is_end && self.is_in_case {
                    context.count_pass();
                }
                self.is_in_case = !is_end;
            }
            _ => {}
        }
    }
}
