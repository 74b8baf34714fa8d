//! Guarding requests without a response.

use crate::event::{Event, EventKind, FrameRange, Kind, MonitoringMethod};
use crate::rules::rule::declare_rule;
use crate::rules::{Rule, RuleContext, RulePolicy};
use crate::wire::canopen::nmt::NmtService;
use crate::wire::{NodeId, NodeMap};

declare_rule! {
    /// # What it checks
    /// A guarded node does not respond to one or more guarding requests before it responds again or is lost.
    /// Nodes that have not responded since their start, or that send heartbeats, are exempt. So are requests
    /// within 20 ms, which may come from two masters.
    ///
    /// # Why it matters
    /// After a few missed responses, the master treats the node as lost and stops the machine.
    ///
    /// # Source
    /// CiA 301 §7.2.8.3.2.1 (node guarding)
    ///
    /// # What to look at first
    /// Check the load of the bus and of the node. Check the capture for lost frames.
    ///
    /// # Mutation
    /// drop a guarding response
    "guard-no-answer", Warning, "guarding request without response",
    kinds: [
        Kind::GuardRequest, Kind::GuardReply, Kind::Heartbeat, Kind::BootUp, Kind::NmtCommand, Kind::NodeLost,
        Kind::LostFrames, Kind::Link, Kind::BusSilent,
    ],
    needs: "a guarding request to a node that has responded",
    cases: &["7.2", "7.4", "7.203"],
    shows: &["7.2"],
    word: "GUARD",
}

/// Minimum interval between two requests of one master, in nanoseconds.
const TOGETHER: i64 = 20_000_000;

#[derive(Default)]
struct UnansweredGuarding {
    /// The node responds to guarding requests.
    answers: bool,
    /// Time and frame of the open request.
    open: Option<(i64, u64)>,
    /// Consecutive requests without a response; `frames` has the first and the last of them.
    missed: u64,
    frames: FrameRange,
    /// Time of the first of them.
    requested: i64,
}

#[derive(Default)]
struct GuardNoAnswer {
    nodes: NodeMap<UnansweredGuarding>,
}

fn new(_policy: &RulePolicy) -> GuardNoAnswer {
    GuardNoAnswer::default()
}

impl UnansweredGuarding {
    fn on_request(&mut self, now: i64, has_time: bool, frame: u64) {
        if let Some((asked, first)) = self.open {
            if has_time && now.saturating_sub(asked) < TOGETHER {
                return;
            }
            if self.answers {
                if self.missed == 0 {
                    (self.requested, self.frames.first) = (asked, first);
                }
                self.frames.last = first;
                self.missed = self.missed.saturating_add(1);
            }
        }
        self.open = Some((now, frame));
    }

    /// Reports the requests without a response.
    fn report_missed(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        let (missed, frames) = (std::mem::take(&mut self.missed), self.frames);
        if missed == 0 {
            return;
        }
        #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
        let alarm = context.start_finding(event).with_frames(frames).with_measure(missed as f64);
        let alarm = alarm.requested_at(self.requested);
        alarm.report_finding(|| missed_text(missed, frames));
    }
}

fn missed_text(missed: u64, frames: FrameRange) -> String {
    match missed {
        1 => format!("guarding request {{{}}} without response", frames.first),
        _ => format!(
            "{missed} consecutive guarding requests without response {{{}-{}}}",
            frames.first, frames.last
        ),
    }
}

impl GuardNoAnswer {
    fn on_reset(&mut self, service: NmtService, target: u8) {
        if !matches!(service, NmtService::ResetNode | NmtService::ResetCommunication) {
            return;
        }
        if target == 0 {
            self.nodes = NodeMap::default();
        } else {
            self.nodes.remove(NodeId::Canopen(target));
        }
    }
}

impl Rule for GuardNoAnswer {
    fn on_event(&mut self, event: &Event, context: &mut RuleContext<'_>) {
        match event.kind {
            EventKind::NmtCommand { service, target, .. } => return self.on_reset(service, target),
            // The lost frames may include responses.
            EventKind::LostFrames { .. } | EventKind::Link { .. } | EventKind::BusSilent { .. } => {
                return self.nodes = NodeMap::default();
            }
            _ => {}
        }
        let Some(node) = event.node else { return };
        match &event.kind {
            EventKind::GuardRequest if !event.presumed => {
                let (now, has_time) = (context.now, context.has_time);
                if let Some(guarded) = self.nodes.entry(node) {
                    guarded.on_request(now, has_time, event.frames.last);
                }
            }
            EventKind::GuardReply { .. } => {
                let Some(guarded) = self.nodes.get_mut(node) else { return };
                guarded.answers = true;
                if guarded.open.take().is_some() && guarded.missed == 0 {
                    context.count_pass();
                }
                guarded.report_missed(event, context);
            }
            EventKind::NodeLost(silence) if silence.monitored_by == MonitoringMethod::Guarding => {
                if let Some(mut guarded) = self.nodes.remove(node) {
                    guarded.report_missed(event, context);
                }
            }
            EventKind::BootUp { .. } | EventKind::Heartbeat { .. } => {
                self.nodes.remove(node);
            }
            _ => {}
        }
    }

    fn on_end(&mut self, context: &mut RuleContext<'_>) {
        for (node, guarded) in self.nodes.iter().filter(|(_, guarded)| guarded.missed > 0) {
            let (missed, frames) = (guarded.missed, guarded.frames);
            #[expect(clippy::cast_precision_loss, reason = "a measure to compare")]
            let alarm = context.fail_at(context.now, Some(node), frames).with_measure(missed as f64);
            let alarm = alarm.requested_at(guarded.requested);
            alarm.report_finding(|| missed_text(missed, frames));
        }
    }
}
