//! Heartbeats against the producer time.

use std::sync::Arc;

use crate::event::{Event, EventKind, Kind, SdoTransfer};
use crate::finding::FindingSubject;
use crate::rules::general::facts::confirmed_number;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy, TransferSubset};
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// The average heartbeat period of a node over 10 s must equal its producer time (1017, written or read).
    /// With 1017 = 0 the node must not send heartbeats, and the state in a heartbeat must be defined.
    /// `node-lost` reports single late heartbeats.
    ///
    /// # Why it matters
    /// Consumers are configured for this period. Slow heartbeats cause false alarms, and fast ones hide a
    /// loss.
    ///
    /// # Source
    /// CiA 301 §7.2.8.3.2.2 (heartbeat), §7.5.2.20 (1017)
    ///
    /// # What to look at first
    /// Compare 1017 with the steps that the device supports. Check the load of the node, and look for a
    /// second device with this node-ID.
    ///
    /// # Mutation
    /// drop every fifth heartbeat
    "heartbeat-period", Warning, "wrong heartbeat period or NMT state",
    kinds: [
        Kind::Heartbeat, Kind::BootUp, Kind::NodeLost, Kind::LostFrames, Kind::Link, Kind::BusSilent,
        Kind::SdoTransfer,
    ],
    transfers: TransferSubset::Communication,
    needs: "heartbeats over 10 s of a node with a known 1017:00",
    cases: &["7.102", "7.103", "7.202", "7.204", "7.206"],
    shows: &["7.102"],
    is_timing: true,
    word: "BEAT",
    tolerances: &[define_tolerance("warning-percent", 10.0, "%", "permitted deviation of the average")],
}

/// Duration of the average, in nanoseconds.
const WINDOW: i64 = 10_000_000_000;

/// Maximum number of queued heartbeats after the time was set to 0.
const QUEUED: u32 = 2;

#[derive(Default)]
struct PeriodWatch {
    began: Option<i64>,
    beats: i64,
    /// Number of heartbeats since the time was set to 0.
    surplus: u32,
}

struct HeartbeatPeriod {
    share: f64,
    watches: NodeMap<PeriodWatch>,
}

fn new(policy: &RulePolicy) -> HeartbeatPeriod {
    HeartbeatPeriod {
        share: policy.tolerance_value(&DECLARATION, "warning-percent") / 100.0,
        watches: NodeMap::default(),
    }
}

impl HeartbeatPeriod {
    fn on_heartbeat(&mut self, event: &Event, node: NodeId, context: &mut RuleContext<'_>) {
        let time = context.event_node(event).and_then(|node| confirmed_number(node, 0x1017, 0));
        let Some(watch) = self.watches.entry(node) else { return };
        let Some(time) = time else { return };
        if time == 0 {
            watch.surplus += 1;
            if watch.surplus > QUEUED {
                context.start_finding(event).report_finding(|| "heartbeat although 1017:00 = 0".to_owned());
            }
            return;
        }
        watch.surplus = 0;
        let Some(began) = watch.began else {
            watch.began = Some(context.now);
            watch.beats = 0;
            return;
        };
        watch.beats += 1;
        let elapsed = context.now.saturating_sub(began);
        if elapsed < WINDOW {
            return;
        }
        #[expect(clippy::cast_precision_loss, reason = "milliseconds of a heartbeat")]
        let (average, expected) = (elapsed as f64 / 1e6 / watch.beats as f64, time as f64);
        let beats = watch.beats;
        watch.began = Some(context.now);
        watch.beats = 0;
        let off = (average / expected - 1.0).abs();
        // Tolerates the rounding of timestamps, and one heartbeat more or less per window.
        #[expect(clippy::cast_precision_loss, reason = "a small count")]
        let slack = self.share + 1.0 / beats as f64;
        if off <= slack || (average - expected).abs() < 1.0 {
            return context.count_pass();
        }
        let alarm = context.start_finding(event).with_measure(off);
        alarm.report_finding(|| {
            let percent = slack * 100.0;
            format!("average heartbeat period {average:.1} ms (1017:00: {expected:.0} ms ± {percent:.0} %)")
        });
    }
}

fn is_time(transfer: &SdoTransfer) -> bool {
    transfer.object.is_some_and(|object| object.index == 0x1017)
}

impl Rule for HeartbeatPeriod {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match (&event.kind, event.node) {
            (EventKind::Heartbeat { state: None, code }, Some(_)) => {
                let alarm =
                    context.start_finding(event).with_subject(FindingSubject::Name(Arc::from("state")));
                alarm.report_finding(|| format!("undefined NMT state {code:02X}h in heartbeat"));
            }
            (EventKind::Heartbeat { .. }, Some(node)) => self.on_heartbeat(event, node, context),
            (EventKind::SdoTransfer(transfer), Some(node)) if is_time(transfer) => {
                self.watches.remove(node);
            }
            (EventKind::BootUp { .. } | EventKind::NodeLost(_), Some(node)) => {
                self.watches.remove(node);
            }
            (EventKind::LostFrames { .. } | EventKind::Link { .. } | EventKind::BusSilent { .. }, _) => {
                self.watches = NodeMap::default();
            }
            _ => {}
        }
    }
}
