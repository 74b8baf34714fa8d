//! DM1 comes late, or too often, while a fault is active.

use crate::event::{DtcAction, Event, EventKind, FrameRange};
use crate::finding::{About, Severity};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::j1939::Pgn;

declare_rule! {
    /// # What it checks
    /// While a fault is active a device sends DM1 once a second, or as often as its manual says: it comes late, or not
    /// for three periods. Sent much more often although nothing changes it is a note.
    ///
    /// # Why it matters
    /// Displays and masters drop a fault that is not repeated; too many DM1 take up the bus.
    ///
    /// # Source
    /// SAE J1939-73 §5.7.1.2 (transmission rate of DM1)
    ///
    /// # What to look at first
    /// Whether the device is busy with a transfer, other messages of it are late as well, or it left the bus.
    ///
    /// # Mutation
    /// report a fault, then drop one DM1
    "dm1-period", Warning, "DM1 does not come once a second while a fault is active",
    kinds: ["j1939-message", "j1939-transfer", "dtc"],
    is_timing: true,
    word: "DM1",
    tolerances: &[
        tolerance("late-percent", 150.0, "%", "of its period, a warning"),
        tolerance("fast-percent", 50.0, "%", "of its period five times in a row, a note"),
    ],
}

/// Milliseconds between two where the manual says nothing.
const PERIOD: u32 = 1_000;

/// Intervals in a row that are too short.
const IN_A_ROW: u8 = 5;

/// DM1 of a node.
#[derive(Default)]
struct Seen {
    /// Time and frame of the last one.
    last: Option<(i64, u64)>,
    /// Intervals in a row that were short, without a change of what it lists.
    short: u8,
}

struct Dm1Period {
    late: f64,
    fast: f64,
    nodes: NodeMap<Seen>,
}

fn new(policy: &Policy) -> Dm1Period {
    let share = |key| policy.tolerance(&DECLARATION, key) / 100.0;
    Dm1Period { late: share("late-percent"), fast: share("fast-percent"), nodes: NodeMap::default() }
}

impl Dm1Period {
    /// A DM1 in one frame or several.
    fn came(&mut self, event: &Event, node: NodeId, context: &mut Context<'_>) {
        let Some(known) = context.bus.node(node) else { return };
        let period = match known.device().j1939.dm1_period {
            0 => PERIOD,
            period => period,
        };
        // What it lists is told behind it: this is what the one before listed.
        let was_active = known.active_dtcs().next().is_some();
        let Some(seen) = self.nodes.entry(node) else { return };
        let before = seen.last.replace((context.now, event.frames.last));
        let Some((time, frame)) = before.filter(|_| was_active) else {
            seen.short = 0;
            return;
        };
        #[expect(clippy::cast_precision_loss, reason = "milliseconds between two messages")]
        let interval = context.now.saturating_sub(time) as f64 / 1e6;
        let expected = f64::from(period);
        seen.short = if interval < expected * self.fast { seen.short.saturating_add(1) } else { 0 };
        let is_fast = seen.short >= IN_A_ROW;
        let frames = FrameRange { first: frame, last: event.frames.last };
        // One digit of the stamps is no delay.
        if interval > expected * self.late + 1.0 {
            let alarm = context.fail(event).frames(frames).measure(interval / expected);
            alarm.say(|| {
                format!("DM1 after {interval:.0} ms while a fault is active; {expected:.0} ms is due")
            });
        } else if is_fast {
            let alarm = context.fail(event).frames(frames).severity(Severity::Note);
            let alarm = alarm.about(About::Name("too often".into()));
            alarm.say(|| {
                format!("DM1 each {interval:.0} ms though nothing changes; {expected:.0} ms is its period")
            });
        } else {
            context.pass();
        }
    }
}

impl Rule for Dm1Period {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::J1939Message(message) if message.id.pgn == Pgn::DM1 => {
                self.came(event, node, context);
            }
            EventKind::J1939Transfer(transfer) if transfer.pgn == Some(Pgn::DM1) => {
                self.came(event, node, context);
            }
            EventKind::Dtc(dtc) => {
                if let Some(seen) = self.nodes.get_mut(node) {
                    seen.short = 0;
                }
                if dtc.action == DtcAction::NoLongerReported && dtc.by_silence {
                    let (spn, fmi) = (dtc.spn, dtc.fmi);
                    let alarm = context.fail(event).measure(f64::MAX);
                    alarm.say(|| format!("DM1 stopped while SPN {spn} FMI {fmi} was active"));
                }
            }
            _ => {}
        }
    }
}
