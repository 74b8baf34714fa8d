//! Late or missing heartbeats and guarding responses of a node.

use crate::event::{Event, EventKind, FrameRange, Kind, MonitoringMethod, NodeSilence};
use crate::finding::{FindingSubject, Severity};
use crate::frame::Timestamp;
use crate::rules::rule::{declare_rule, define_tolerance};
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::session::StreamService;
use crate::wire::canopen::{NmtState, ObjectAddress};
use crate::wire::{NodeId, NodeMap, NodeSet};

declare_rule! {
    /// # What it checks
    /// The heartbeat of a node is later than its producer time (1017) allows, or a guarded node does not
    /// respond for its life time (100C × 100D). If 1017 is unknown, the longest usual interval applies. Or a node with
    /// a heartbeat restarts without an NMT reset, and sends none for 5 s and three intervals. There is one finding per
    /// silence, with its duration.
    ///
    /// # Why it matters
    /// The node has no supply, has restarted, is off the bus, or is overloaded.
    ///
    /// # Source
    /// CiA 301 §7.2.8.2.2 (node guarding, heartbeat), §7.5.2.12, §7.5.2.20
    ///
    /// # What to look at first
    /// Check supply and cable of the node if all its messages are missing, otherwise its heartbeat time (1017)
    /// and load. Check its last EMCY and state, whether other nodes are silent too, and the error frames before.
    ///
    /// # Mutation
    /// drop all frames of a node in the second half
    "node-lost", Error, "monitored node late or silent",
    kinds: [Kind::Heartbeat, Kind::NodeLost, Kind::NodeBack, Kind::BootUp, Kind::NmtCommand],
    needs: "a heartbeat producer or a guarded node",
    cases: &["7.102"],
    shows: &["7.102"],
    is_timing: true,
    word: "LOST",
    tolerances: &[
        define_tolerance("warning-percent", 150.0, "%", "of the producer time, a warning"),
        define_tolerance("error-percent", 200.0, "%", "of the producer time, an error; a lost node is always an error"),
    ],
}

struct NodeLost {
    warning: f64,
    error: f64,
    last: NodeMap<(i64, u64)>,
    lost: NodeSet,
    /// Losses by guarding that wait for other frames of the node, which would show that only guarding stopped.
    held: NodeMap<Event>,
}

/// Time in ns for which a loss by guarding waits for other frames of the node.
const HELD_TIME: i64 = 5_000_000_000;

fn new(policy: &RulePolicy) -> NodeLost {
    let share = |key| policy.tolerance_value(&DECLARATION, key) / 100.0;
    NodeLost {
        warning: share("warning-percent"),
        error: share("error-percent"),
        last: NodeMap::default(),
        lost: NodeSet::default(),
        held: NodeMap::default(),
    }
}

impl NodeLost {
    /// Reports a loss by guarding that no other frame of the node contradicted.
    fn report_held(&mut self, node: NodeId, context: &mut RuleContext<'_>) {
        if let Some(event) = self.held.remove(node)
            && let EventKind::NodeLost(silence) = &event.kind
        {
            self.on_lost(&event, silence, context);
        }
    }

    fn on_heartbeat(&mut self, event: &Event, node: NodeId, context: &mut RuleContext<'_>) {
        let now = context.now;
        let Some(last) = self.last.entry(node) else { return };
        let (before, frame) = std::mem::replace(last, (now, event.frames.last));
        // The end of a silence is not a late heartbeat; the `node-back` event has its duration.
        if self.lost.remove(node) || context.is_across_hole(frame) {
            return;
        }
        let producer = context.event_node(event).and_then(|node| node.store().number(PRODUCER_TIME));
        let Some(time) = producer.filter(|time| frame != 0 && *time != 0) else { return };
        #[expect(clippy::cast_precision_loss, reason = "milliseconds of a heartbeat")]
        let (interval, expected) = (now.saturating_sub(before) as f64 / 1e6, time as f64);
        // Tolerates the rounding of timestamps.
        if interval <= expected * self.warning + 1.0 {
            return context.count_pass();
        }
        let (severity, share) = if interval > expected * self.error {
            (Severity::Error, self.error)
        } else {
            (Severity::Warning, self.warning)
        };
        let frames = FrameRange { first: frame, last: event.frames.last };
        context
            .start_finding(event)
            .with_subject(FindingSubject::Object(PRODUCER_TIME))
            .with_severity(severity)
            .with_word("LATE")
            .with_measure(interval / expected)
            .with_frames(frames)
            .report_finding(|| {
                let limit = expected * share;
                format!("heartbeat interval {interval:.0} ms > {limit:.0} ms ({share} × 1017:00)")
            });
    }

    fn on_lost(&self, event: &Event, silence: &NodeSilence, context: &mut RuleContext<'_>) {
        // The node may still send other messages.
        let heartbeat = event.node.and_then(|node| self.last.get(node)).map(|(_, frame)| *frame);
        let heartbeat = heartbeat.filter(|frame| (1..silence.last_frame).contains(frame));
        let heartbeat = heartbeat.filter(|_| silence.monitored_by == MonitoringMethod::Heartbeat);
        let since = event.time.map(|time| Timestamp(time.0.saturating_sub(silence.gap)));
        context.start_finding(event).started_at(since).report_finding(|| {
            let last = silence.last_frame;
            let by = silence.monitored_by.message();
            let details = [
                heartbeat.map(|_| format!("last frame {{{last}}}")),
                silence.last_state.map(|state| format!("last state {}", state.name())),
                silence.last_emcy.map(|code| format!("last EMCY {code:04X}")),
                silence.others_continue.then(|| silence.others_text().to_owned()),
            ];
            let details: Vec<String> = details.into_iter().flatten().collect();
            let details =
                if details.is_empty() { String::new() } else { format!(" ({})", details.join(", ")) };
            match silence.boot_frame {
                Some(boot) => format!("no {by} since the boot-up {{{boot}}}{details}"),
                None => format!("no {by} after {{{}}}{details}", heartbeat.unwrap_or(last)),
            }
        });
    }
}

const PRODUCER_TIME: ObjectAddress = ObjectAddress::new(0x1017, 0);

/// Whether a node sent PDOs in the capture.
fn sends_pdos(node: NodeId, context: &RuleContext<'_>) -> bool {
    let mut streams = context.bus.streams();
    streams.any(|stream| stream.service == StreamService::TransmittedPdo && stream.node == Some(node))
}

impl Rule for NodeLost {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        if let EventKind::NmtCommand { to: Some(NmtState::Initialising), target: 0, .. } = event.kind {
            self.last = NodeMap::default();
        }
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::Heartbeat { .. } => self.on_heartbeat(event, node, context),
            EventKind::NodeLost(silence) => {
                self.lost.insert(node);
                let is_held = self.held.remove(node).is_some();
                let is_by_guarding = silence.monitored_by == MonitoringMethod::Guarding;
                if is_by_guarding && !silence.others_continue && !is_held && sends_pdos(node, context) {
                    context.wake_at(context.now.saturating_add(HELD_TIME), node.number().into());
                    return self.held.insert(node, event.clone());
                }
                self.on_lost(event, silence, context);
            }
            EventKind::NodeBack(_) => {
                self.report_held(node, context);
                context.close_condition(Some(node), FindingSubject::Whole);
            }
            // A restart starts a new series; other rules check the duration of a reset.
            EventKind::BootUp { .. } | EventKind::NmtCommand { to: Some(NmtState::Initialising), .. } => {
                self.last.remove(node);
            }
            _ => {}
        }
    }

    fn on_wake(&mut self, token: u64, context: &mut RuleContext<'_>) {
        if let Ok(node) = u8::try_from(token) {
            self.report_held(NodeId::Canopen(node), context);
        }
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        let held: Vec<NodeId> = self.held.iter().map(|(node, _)| node).collect();
        for node in held {
            self.report_held(node, context);
        }
    }
}
