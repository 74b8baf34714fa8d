//! DM1 period while a fault is active.

use crate::event::{DtcAction, Event, EventKind, FrameRange, Kind};
use crate::finding::{FindingSubject, Severity};
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{FrameNeed, Rule, RuleContext, RulePolicy};
use crate::wire::j1939::Pgn;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// While a fault is active, a device must send DM1 once per second, or with the period in its manual. DM1
    /// is late, or missing for three periods. DM1 with much shorter intervals, without a change, is a note.
    ///
    /// # Why it matters
    /// Displays and masters drop a fault without repetition. DM1 that is too frequent loads the bus.
    ///
    /// # Source
    /// SAE J1939-73 §5.7.1.2 (transmission rate of DM1)
    ///
    /// # What to look at first
    /// Check whether other messages of the device are late too. Check whether it is busy with a transfer, or
    /// has left the bus.
    ///
    /// # Mutation
    /// report a fault, then drop one DM1
    "dm1-period", Warning, "DM1 late or too frequent",
    kinds: [Kind::J1939Message, Kind::J1939Transfer, Kind::Dtc],
    needs: "DM1 with an active fault",
    is_timing: true,
    word: "DM1",
    tolerances: &[
        define_tolerance("late-percent", 150.0, "%", "of its period, a warning"),
        define_tolerance("fast-percent", 50.0, "%", "of its period, five times in succession, a note"),
    ],
}

/// Default period, in milliseconds.
const PERIOD: u32 = 1_000;

/// Minimum number of consecutive short intervals.
const IN_A_ROW: u8 = 5;

/// DM1 messages of a node.
#[derive(Default)]
struct Dm1Series {
    /// Time and frame of the last DM1.
    last: Option<(i64, u64)>,
    /// Consecutive short intervals without a change of the listed faults.
    short: u8,
}

struct Dm1Period {
    late: f64,
    fast: f64,
    nodes: NodeMap<Dm1Series>,
}

fn new(policy: &RulePolicy) -> Dm1Period {
    let share = |key| policy.tolerance_value(&DECLARATION, key) / 100.0;
    Dm1Period { late: share("late-percent"), fast: share("fast-percent"), nodes: NodeMap::default() }
}

impl Dm1Period {
    /// Checks a DM1 in one frame or in several packets.
    fn on_dm1(&mut self, event: &Event, node: NodeId, context: &mut RuleContext<'_>) {
        let Some(known) = context.bus.node(node) else { return };
        let period = match known.device().j1939.dm1_period {
            0 => PERIOD,
            period => period,
        };
        // Faults in this DM1 are reported by later events, so these are the faults of the previous one.
        let was_active = known.active_dtcs().next().is_some();
        let Some(seen) = self.nodes.entry(node) else { return };
        let before = seen.last.replace((context.now, event.frames.last));
        let Some((time, frame)) = before.filter(|(_, frame)| was_active && !context.is_across_hole(*frame))
        else {
            seen.short = 0;
            return;
        };
        #[expect(clippy::cast_precision_loss, reason = "milliseconds between two messages")]
        let interval = context.now.saturating_sub(time) as f64 / 1e6;
        let expected = f64::from(period);
        seen.short = if interval < expected * self.fast { seen.short.saturating_add(1) } else { 0 };
        let is_fast = seen.short >= IN_A_ROW;
        let frames = FrameRange { first: frame, last: event.frames.last };
        // Tolerates the rounding of timestamps.
        if interval > expected * self.late + 1.0 {
            let alarm = context.start_finding(event).with_frames(frames).with_measure(interval / expected);
            alarm.report_finding(|| {
                let limit = expected * self.late;
                format!(
                    "DM1 interval {interval:.0} ms > {limit:.0} ms with an active fault (period {expected:.0} ms)"
                )
            });
        } else if is_fast {
            let alarm = context.start_finding(event).with_frames(frames).with_severity(Severity::Note);
            let alarm = alarm.with_subject(FindingSubject::Name("too often".into()));
            alarm.report_finding(|| {
                let limit = expected * self.fast;
                format!(
                    "DM1 interval {interval:.0} ms < {limit:.0} ms without a change (period {expected:.0} ms)"
                )
            });
        } else {
            context.count_pass();
        }
    }
}

impl Rule for Dm1Period {
    fn frame_need(&self, event: &Event, _context: &RuleContext<'_>) -> FrameNeed {
        match &event.kind {
            EventKind::J1939Message(message) if message.id.pgn != Pgn::DM1 => FrameNeed::NOTHING,
            _ => FrameNeed::EACH,
        }
    }

    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::J1939Message(message) if message.id.pgn == Pgn::DM1 => {
                self.on_dm1(event, node, context);
            }
            EventKind::J1939Transfer(transfer) if transfer.pgn == Some(Pgn::DM1) => {
                self.on_dm1(event, node, context);
            }
            EventKind::Dtc(dtc) => {
                if let Some(seen) = self.nodes.get_mut(node) {
                    seen.short = 0;
                }
                if dtc.action == DtcAction::NoLongerReported && dtc.by_silence {
                    let (spn, fmi) = (dtc.spn, dtc.fmi);
                    let alarm = context.start_finding(event).with_measure(f64::MAX);
                    alarm.report_finding(|| format!("DM1 missing while SPN {spn} FMI {fmi} is active"));
                }
            }
            _ => {}
        }
    }
}
