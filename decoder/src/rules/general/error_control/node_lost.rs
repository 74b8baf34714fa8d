//! A monitored node is silent.

use crate::event::{Event, EventKind, FrameRange, Silence};
use crate::finding::{About, Severity};
use crate::rules::rule::{declare_rule, tolerance};
use crate::rules::{Context, NodeMap, NodeSet, Policy, Rule};
use crate::wire::NodeId;
use crate::wire::canopen::{NmtState, ObjectAddress};

declare_rule! {
    /// # What it checks
    /// A node that sends a heartbeat comes later than its producer time (1017) allows, or does not come at all; a
    /// guarded node leaves the requests of its life time (100C × 100D) unanswered. Where 1017 was not seen, the
    /// longest of its usual intervals counts. One finding a silence, with its beginning and end.
    ///
    /// # Why it matters
    /// The node has no supply, was restarted, is off the bus, or so busy that it cannot be relied on.
    ///
    /// # Source
    /// CiA 301 §7.2.8.2.2 (node guarding, heartbeat), §7.5.2.12, §7.5.2.20
    ///
    /// # What to look at first
    /// Its last EMCY and state, whether other nodes are silent too (cable, supply), error frames before it.
    ///
    /// # Mutation
    /// drop all frames of a node from the middle on
    "node-lost", Error, "a monitored node is silent",
    kinds: ["heartbeat", "node-lost", "node-back", "boot-up", "nmt-command"],
    cases: &["7.102"],
    shows: &["7.102"],
    is_timing: true,
    word: "LOST",
    tolerances: &[
        tolerance("warning-percent", 150.0, "%", "of the heartbeat's time, a warning"),
        tolerance("error-percent", 200.0, "%", "of the heartbeat's time, an error; a lost node is one in any case"),
    ],
}

struct NodeLost {
    warning: f64,
    error: f64,
    last: NodeMap<(i64, u64)>,
    lost: NodeSet,
}

fn new(policy: &Policy) -> NodeLost {
    let share = |key| policy.tolerance(&DECLARATION, key) / 100.0;
    NodeLost {
        warning: share("warning-percent"),
        error: share("error-percent"),
        last: NodeMap::default(),
        lost: NodeSet::default(),
    }
}

impl NodeLost {
    fn heartbeat(&mut self, event: &Event, node: NodeId, context: &mut Context<'_>) {
        let now = context.now;
        let Some(last) = self.last.entry(node) else { return };
        let (before, frame) = std::mem::replace(last, (now, event.frames.last));
        // How long a lost node was silent its return tells.
        if self.lost.remove(node) {
            return;
        }
        let producer = context.node(event).and_then(|node| node.store().number(PRODUCER_TIME));
        let Some(time) = producer.filter(|time| frame != 0 && *time != 0) else { return };
        #[expect(clippy::cast_precision_loss, reason = "milliseconds of a heartbeat")]
        let (interval, expected) = (now.saturating_sub(before) as f64 / 1e6, time as f64);
        // One digit of the stamps is no delay.
        if interval <= expected * self.warning + 1.0 {
            return context.pass();
        }
        let severity = if interval > expected * self.error { Severity::Error } else { Severity::Warning };
        let frames = FrameRange { first: frame, last: event.frames.last };
        context
            .fail(event)
            .about(About::Object(PRODUCER_TIME))
            .severity(severity)
            .word("LATE")
            .measure(interval / expected)
            .frames(frames)
            .say(|| format!("heartbeat after {interval:.0} ms; 1017:00 says {expected:.0} ms"));
    }

    fn lost(&self, event: &Event, silence: &Silence, context: &mut Context<'_>) {
        // It may go on with other messages.
        let heartbeat = event.node.and_then(|node| self.last.get(node)).map(|(_, frame)| *frame);
        let heartbeat = heartbeat.filter(|frame| (1..silence.last_frame).contains(frame));
        let heartbeat = heartbeat.filter(|_| silence.monitored_by == "heartbeat");
        let state = silence.last_state.map_or_else(String::new, |state| format!(", was {}", state.name()));
        let code = silence.last_emcy.map_or_else(String::new, |code| format!(", last EMCY {code:04X}"));
        context.fail(event).ongoing().say(|| {
            let (by, last) = (silence.monitored_by, silence.last_frame);
            match heartbeat {
                Some(frame) => format!("no {by} since {{{frame}}}, though it sent {{{last}}}{state}{code}"),
                None => format!("silent since {{{last}}} ({by}){state}{code}"),
            }
        });
    }
}

const PRODUCER_TIME: ObjectAddress = ObjectAddress::new(0x1017, 0);

impl Rule for NodeLost {
    fn event(&mut self, event: &Event, context: &mut Context<'_>) {
        if let EventKind::NmtCommand { to: Some(NmtState::Initialising), target: 0, .. } = event.kind {
            self.last = NodeMap::default();
        }
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Heartbeat { .. } => self.heartbeat(event, node, context),
            EventKind::NodeLost(silence) => {
                self.lost.insert(node);
                self.lost(event, silence, context);
            }
            EventKind::NodeBack(_) => context.close(Some(node), About::Whole),
            // A restart begins anew; how long a reset takes is judged elsewhere.
            EventKind::BootUp { .. } | EventKind::NmtCommand { to: Some(NmtState::Initialising), .. } => {
                self.last.remove(node);
            }
            _ => {}
        }
    }
}
